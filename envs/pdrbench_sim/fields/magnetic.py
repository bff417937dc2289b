"""The magnetic field in a building, and what a magnetometer makes of it (sources.md 1.7).

The Earth's field, two layers of sources under each level, and single pieces of steel: the structure far below, which
bends the field over metres; the steel of the floor itself, which makes a magnetometer on a shoe useless (W19); and what
stands here and there (lifts, escalators, steel doors), near which a compass can be off by anything. Above its sources a
field is the gradient of a harmonic potential, so that a horizontal wave number k decays with exp(-k height). Each layer
is a sum of such waves, each piece of steel a dipole: neither has curl or divergence, exactly and everywhere above the
floor of a level.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.building import Building, FloorRegion
from pdrbench.errors import MapError, RecordingError
from pdrbench.geometry import FloatArray, IntArray, read_only
from pdrbench.inertial.quaternions import to_world
from pdrbench_sim.fields.dipoles import DipoleParams, Dipoles, draw_dipoles

HIP_M: Final = 1.2  # height above the floor at which phones measured the field
FOOT_M: Final = 0.1  # height above the floor of a unit on a shoe
_ROUNDING_M: Final = 1e-6  # a place on the floor may lie so far below it
_CHUNK: Final = 512  # places at a time: keeps the phases of all waves in the cache


@dataclass(frozen=True, slots=True)
class Sheet:
    """A layer of random sources under a floor, by the spectrum of its field.

    Over horizontal wave numbers k the variance at height h is distributed as k^order exp(-2 k (h + depth)): a Gamma
    law, so that each component falls with (h + depth)^-((order + 1) / 2).
    """

    sigma_ut: float  # standard deviation of each horizontal component at `at_m`; the vertical one has sqrt(2) of it
    at_m: float  # height above the floor at which `sigma_ut` holds
    depth_m: float  # of the sources below the floor
    # 3 for independent dipoles spread over a plane, 2 where moments are correlated over long distances, 5 where those
    # of neighbours balance each other.
    order: int
    num_waves: int  # whose sum it is

    def __post_init__(self) -> None:
        if not (self.sigma_ut >= 0 and self.at_m + self.depth_m > 0 and self.depth_m > 0):
            raise MapError(f"a sheet of sources lies below the floor and has no negative strength; got {self}")
        if self.order < 0 or self.num_waves < 1:
            raise MapError(f"a sheet of sources needs an order of 0 or more and a wave or more; got {self}")


@dataclass(frozen=True, slots=True)
class MagneticParams:
    """The field of the Earth and what steel adds; sources.md 1.7.

    Walks over a field with these parameters, with the phone of `phone_magnetometer`, give |B| less the mean of each
    walk a correlation of .91, .65, .50, .31, .11 and -.08 at 0.75, 2.5, 3.5, 5, 7 and 10 m (medians of sets of six
    floors, 200 floors in all); .91, .64, .49, .30, .12 and 0 are measured [M]. Its standard deviation along a walk is
    3.1 uT in the median; 4.0 uT are published and 2.4 uT were measured on the 15 walks of the fit [M].
    """

    north_ut: float = 31.0  # horizontal component, along +y unless turned; [M]
    declination_rad: float = 0.0  # from +y of the building counter-clockwise to the horizontal component
    down_ut: float = 30.0  # vertical component, along -z; [M]
    # Girders, reinforcement, machines; strength, depth and order are fitted to those [M].
    structure: Sheet = Sheet(sigma_ut=3.2, at_m=HIP_M, depth_m=5.2, order=2, num_waves=32)
    # Steel of a raised floor, whose field falls with the third power of the height (sources.md 1.7); 55 uT at 0.1 m are
    # an assumption [R] that turns headings by 54 degrees there in the median, by 16 at 0.3 m, and by 4 at 1 m together
    # with the rest (W19 [P]). Wavelengths at 0.1 m are about the pitch of such floors, 0.6 m [R].
    panels: Sheet = Sheet(sigma_ut=55.0, at_m=FOOT_M, depth_m=0.2, order=5, num_waves=48)
    # Standard deviation of the logarithm of the structure's strength over levels.
    level_spread: float = 0.45  # assumption [R]
    dipoles: DipoleParams = field(default_factory=DipoleParams)  # lifts, escalators and steel doors


@dataclass(frozen=True, slots=True, eq=False)
class _Waves:
    """Waves of one level: wave vectors (M, 2) in rad/m, phases (M,), amplitudes on the floor (M,) in uT."""

    wave_radpm: FloatArray
    phase_rad: FloatArray
    amplitude_ut: FloatArray

    def at(self, xy_m: FloatArray, above_m: FloatArray) -> FloatArray:
        """(n, 3) gradient of the potential sum of amplitude / k exp(-k above) cos(k xy + phase)."""
        x_radpm, y_radpm = self.wave_radpm.T
        number = np.hypot(x_radpm, y_radpm)
        # Sums row by row, not matrix products: those round otherwise when there are more rows or threads.
        angle_rad = xy_m[:, :1] * x_radpm + xy_m[:, 1:] * y_radpm + self.phase_rad
        strength = self.amplitude_ut * np.exp(-above_m[:, None] * number)
        slope = strength * np.sin(angle_rad)
        x_ut, y_ut = ((slope * (part / number)).sum(axis=1) for part in (x_radpm, y_radpm))
        return -np.column_stack([x_ut, y_ut, (strength * np.cos(angle_rad)).sum(axis=1)])


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """Everything that is magnetic on one level."""

    waves: _Waves
    dipoles: Dipoles

    def at(self, xy_m: FloatArray, above_m: FloatArray) -> FloatArray:
        """(n, 3) uT."""
        return self.waves.at(xy_m, above_m) + self.dipoles.at(xy_m, above_m)


@dataclass(frozen=True, slots=True, eq=False)
class MagneticField:
    """What a compass would meet everywhere in a building."""

    floor_m: FloatArray  # (L,) heights of the levels, increasing
    params: MagneticParams  # earth and steel
    _levels: tuple[_Level, ...] = field(repr=False)

    @property
    def earth_ut(self) -> FloatArray:
        """(3,) the field without the building."""
        turn_rad, north_ut = self.params.declination_rad, self.params.north_ut
        return np.array([-north_ut * math.sin(turn_rad), north_ut * math.cos(turn_rad), -self.params.down_ut])

    def at(self, xyz_m: ArrayLike, ground_m: ArrayLike | None = None) -> FloatArray:
        """The field at places.

        Each level has a field of its own, which holds up to the next floor. Who climbs stairs stays in that of the
        level left until the feet are on the next one, and meets a jump there.

        Args:
            xyz_m: (n, 3), heights from level 0 of the building.
            ground_m: (n,) height of the floor under the feet of the bearer, or one for all: the highest level not above
                it counts. On ground below the lowest level (a raked theatre) sources lie as deep under the ground. None
                where the places themselves are to decide, not the feet.

        Returns:
            (n, 3) uT, building frame.

        Raises:
            MapError: A place is not finite or below the floor.
        """
        place_m = np.asarray(xyz_m, dtype=np.float64)
        if place_m.ndim != 2 or place_m.shape[1] != 3 or not np.isfinite(place_m).all():
            raise MapError(f"places of a magnetic field are finite (n, 3) metres; got shape {place_m.shape}")
        level, above_m = self._heights(place_m[:, 2], ground_m)
        field_ut = np.tile(self.earth_ut, (len(place_m), 1))
        for number, steel in enumerate(self._levels):
            here = np.flatnonzero(level == number)
            for first in range(0, len(here), _CHUNK):
                some = here[first : first + _CHUNK]
                field_ut[some] += steel.at(place_m[some, :2], above_m[some])
        return field_ut

    def _heights(self, z_m: FloatArray, ground_m: ArrayLike | None) -> tuple[IntArray, FloatArray]:
        """(n,) level and (n,) height above its floor."""
        ground = z_m if ground_m is None else np.broadcast_to(np.asarray(ground_m, dtype=np.float64), z_m.shape)
        lowest_m = np.full(len(z_m), self.floor_m[0]) if ground_m is None else ground
        buried = np.flatnonzero(~(z_m >= lowest_m - _ROUNDING_M))
        if len(buried):
            i = buried[0]
            raise MapError(f"place {i} at {z_m[i]:g} m is below the floor at {lowest_m[i]:g} m; give heights above it")
        level = np.maximum(np.searchsorted(self.floor_m, ground + _ROUNDING_M, side="right") - 1, 0)
        above_m = np.maximum(z_m - np.minimum(self.floor_m[level], ground), 0.0)
        return level, above_m


def make_magnetic_field(
    rng: np.random.Generator, building: Building, params: MagneticParams | None = None
) -> MagneticField:
    """Draws the field of a building; the floor of a level is where most of its area lies, stairs aside.

    Args:
        rng: Two fields from generators in the same state are equal byte for byte.
        building: Any.
        params: None for the defaults.
    """
    area_m2: dict[int, dict[float, float]] = {}
    for polygon in building.polygons:
        heights = area_m2.setdefault(polygon.level, {})
        heights[polygon.height_m] = heights.get(polygon.height_m, 0.0) + polygon.area_m2
    floor = sorted((max(found, key=found.__getitem__), level) for level, found in area_m2.items())
    whole = FloorRegion.whole(building)
    level = building.level(whole.polygon)
    parts = [whole.restricted(level == number) for _, number in floor]
    return draw_field(rng, [height_m for height_m, _ in floor], parts, params)


def draw_field(
    rng: np.random.Generator, floor_m: ArrayLike, floors: Sequence[FloorRegion], params: MagneticParams | None
) -> MagneticField:
    """Draws a field whose dipoles lie under the floor of each level; a level more does not change those below it.

    Raises:
        MapError: No level, or heights that do not increase.
    """
    params = params or MagneticParams()
    floor_m = np.array(floor_m, dtype=np.float64)
    if floor_m.ndim != 1 or not len(floor_m) or not np.isfinite(floor_m).all() or not (np.diff(floor_m) > 0).all():
        raise MapError(f"a magnetic field needs the heights of one level or more, increasing; got {floor_m.tolist()}")
    levels = []
    for child, floor in zip(rng.spawn(len(floor_m)), floors, strict=True):
        layers, single = child.spawn(2)
        levels.append(_Level(_draw_waves(layers, params), draw_dipoles(single, floor, params.dipoles)))
    return MagneticField(read_only(floor_m), params, tuple(levels))


def _draw_waves(rng: np.random.Generator, params: MagneticParams) -> _Waves:
    strength = math.exp(params.level_spread * rng.standard_normal())
    wave, phase, amplitude = zip(_draw(rng, params.structure, strength), _draw(rng, params.panels, 1.0), strict=True)
    return _Waves(*(read_only(np.concatenate(parts)) for parts in (wave, phase, amplitude)))


def _draw(rng: np.random.Generator, sheet: Sheet, strength: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Wave vectors, phases and amplitudes on the floor of one sheet.

    Wave numbers are spread evenly over their logarithm and carry what the spectrum has there. Drawn from the spectrum
    at one height, hardly one would be left of those that matter at another.
    """
    from scipy.special import gammaln

    count, shape = sheet.num_waves, sheet.order + 1
    decay_m = 2 * (sheet.at_m + sheet.depth_m)
    # Long waves as they are 4 m up, short ones as they are on the floor; 1e-4 of either is left out.
    low, high = math.log(0.05 / (decay_m + 8.0)), math.log(20.0 / (2 * sheet.depth_m))
    log_number = low + (high - low) * (np.arange(count) + rng.random(count)) / count
    number = np.exp(log_number)
    log_fraction = shape * (log_number + math.log(decay_m)) - number * decay_m - gammaln(shape)
    # A horizontal wave has half of its square as variance, which two components share.
    amplitude = 2 * strength * sheet.sigma_ut * np.sqrt((high - low) / count * np.exp(log_fraction))
    direction_rad = 2 * math.pi * (rng.permutation(count) + rng.random(count)) / count
    wave = number[:, None] * np.column_stack([np.cos(direction_rad), np.sin(direction_rad)])
    return wave, rng.uniform(0, 2 * math.pi, count), amplitude * np.exp(number * sheet.at_m)


@dataclass(frozen=True, slots=True, eq=False)
class MagnetometerErrors:
    """What one magnetometer makes of a field: soft iron, then hard iron, then noise; all in the body frame."""

    hard_iron_ut: FloatArray = field(default_factory=lambda: np.zeros(3))  # (3,) offset
    soft_iron: FloatArray = field(default_factory=lambda: np.eye(3))  # (3, 3) matrix, the identity for none
    # Standard deviation of white noise on each axis and sample.
    noise_ut: float = 0.4  # assumption [R]: parts sold in phones

    def __post_init__(self) -> None:
        for name, shape in (("hard_iron_ut", (3,)), ("soft_iron", (3, 3))):
            object.__setattr__(self, name, read_only(getattr(self, name)))
            values: FloatArray = getattr(self, name)
            if values.shape != shape or not np.isfinite(values).all():
                raise RecordingError(f"{name} of a magnetometer is finite, of shape {shape}; got {values.tolist()}")
        if not 0 <= self.noise_ut < math.inf:
            raise RecordingError(f"noise of a magnetometer is 0 uT or more; got {self.noise_ut:g}")

    def measure(self, field_ut: ArrayLike, quaternion: ArrayLike, rng: np.random.Generator) -> FloatArray:
        """(n, 3) uT in the body frame.

        Args:
            field_ut: (n, 3) building frame, as `MagneticField.at` has it.
            quaternion: (n, 4) unit Hamilton wxyz, body to building.
            rng: Draws the noise; more samples do not change those before them.
        """
        world, turn = np.asarray(field_ut, dtype=np.float64), np.asarray(quaternion, dtype=np.float64)
        if world.ndim != 2 or world.shape[1] != 3 or turn.shape != (len(world), 4):
            raise RecordingError(
                f"a magnetometer needs (n, 3) fields and (n, 4) attitudes; got {world.shape}, {turn.shape}"
            )
        body = to_world(turn * [1.0, -1.0, -1.0, -1.0], world)
        measured: FloatArray = body @ self.soft_iron.T + self.hard_iron_ut
        measured += self.noise_ut * rng.standard_normal(measured.shape)
        return measured


def draw_magnetometer(
    rng: np.random.Generator,
    *,
    hard_iron_ut: tuple[float, float] = (20.0, 60.0),
    soft_iron: float = 0.05,
    noise_ut: float = 0.4,
) -> MagnetometerErrors:
    """Another device, uncalibrated unless a line says otherwise; all defaults are assumptions [R] (sources.md 1.7).

    Args:
        rng: Draws it.
        hard_iron_ut: Least and largest length of the offset; its direction is anywhere. (0, 0) for a calibrated device.
        soft_iron: Largest change of each element of the matrix, which stays symmetric.
        noise_ut: Standard deviation of the noise.
    """
    direction = rng.standard_normal(3)
    offset_ut = rng.uniform(*hard_iron_ut) * direction / math.hypot(*direction)
    upper = np.triu(rng.uniform(-soft_iron, soft_iron, (3, 3)))
    return MagnetometerErrors(offset_ut, np.eye(3) + upper + np.triu(upper, 1).T, noise_ut)
