"""The Rao-Blackwellised particle filter: every particle is a way with its own map of transitions.

P. Robertson, M. Angermann, B. Krach, "Simultaneous localization and mapping for pedestrians using only foot-mounted
inertial sensors", UbiComp 2009. A particle that leaves hexagon h through edge e has its weight multiplied by
(N_e + alpha) / (N_h + 6 alpha), N being the counts of its own map. Here that is divided by 1/6, its value where nothing
is known: ways through new places weigh nothing, however many hexagons they cross.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import PdrbenchError
from pdrbench.filters import systematic
from pdrbench.geometry import FloatArray, IntArray
from pdrbench_lab.footslam import kernels
from pdrbench_lab.footslam.hexagons import hexagon_of
from pdrbench_lab.footslam.transition_map import TransitionMaps, effective_number, in_place

MAX_STORED: Final = 2**22  # particles of all strides together that are kept for `path`: 84 MB at most, 2000 strides


@dataclass(frozen=True, slots=True)
class OdometryNoise:
    """Errors of strides as a particle draws them; defaults measured on recordings of the literal inertial filter.

    Attributes:
        length_scale: Factor on every length, its mean over walks,
        length_scale_sigma: and its standard deviation over walks.
        length_sigma_m: White error of a length.
        drift_sigma_rad: Of the turn that a walk adds to every stride, over walks.
        drift_walk_rad: Standard deviation by which that turn changes from stride to stride: the correlated part.
        turn_sigma_rad: White error of a turn: a random walk of the heading.
        heading_sigma_rad: White error of the heading of a stride, which the next turn takes back.
        start_heading_rad: Standard deviation of the heading that the briefing gives.
    """

    length_scale: float = 1.018  # 1 / (1 - 0.0177): foot_dual, as woodman2008?learns_drift=true
    length_scale_sigma: float = 0.0123  # stride_errors.json, length_bias_spread
    length_sigma_m: float = 0.0172  # stride_errors.json
    drift_sigma_rad: float = math.radians(0.168)  # root mean square of foot_dual, as woodman2008?learns_drift=true
    drift_walk_rad: float = math.radians(0.01)  # ours: 0.14 degrees a stride after 200 strides
    turn_sigma_rad: float = math.radians(0.336)  # stride_errors.json
    heading_sigma_rad: float = math.radians(0.842)  # stride_errors.json
    start_heading_rad: float = 0.0

    def __post_init__(self) -> None:
        if not self.length_scale > 0:
            raise PdrbenchError(f"footslam: length_scale must be positive; got {self.length_scale!r}")
        for name in self.__slots__:
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise PdrbenchError(f"footslam: {name} is 0 or more; got {getattr(self, name)!r}")


# `pdrbench error-model --filter adaptive --env FootVicon-v1 --env FootWalks-v1`
ADAPTIVE_FILTER: Final = OdometryNoise(
    length_scale=1.0079,
    length_scale_sigma=0.0106,
    length_sigma_m=0.017,
    drift_sigma_rad=math.radians(0.142),
    turn_sigma_rad=math.radians(0.316),
    heading_sigma_rad=math.radians(0.823),
)


@dataclass(frozen=True, slots=True)
class SlamParams:
    """Defaults from Robertson et al. 2009 and its successors unless a line says otherwise.

    Attributes:
        num_particles: Of the cloud.
        radius_m: From the centre of a hexagon to its corners.
        alpha: Prior count of every edge.
        delay: Transitions that have to follow one before it is counted.
        resampled_below: Fraction of particles that are effective below which they are drawn anew.
        uses_map: False: counts weigh nothing, which is dead reckoning with a spread.
    """

    num_particles: int = 2000  # ours: time; the authors take tens of thousands
    radius_m: float = 1.4  # ours: walks through synthetic offices; 0.5 in the papers
    alpha: float = 0.8
    delay: int = 8  # ours: some 20 m
    resampled_below: float = 0.5  # ours
    uses_map: bool = True

    def __post_init__(self) -> None:
        if self.num_particles < 1 or self.delay < 0:
            raise PdrbenchError(
                f"footslam: need num_particles >= 1 and delay >= 0; got {self.num_particles} and {self.delay}"
            )
        for name in ("radius_m", "alpha"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                raise PdrbenchError(f"footslam: {name} must be positive; got {getattr(self, name)!r}")


class SlamCloud:
    """N particles that begin at one place.

    Args:
        xy_m: (2,) where the walk begins.
        heading_rad: In which direction.
        noise: Of the odometry.
        params: Of particles and map.
        rng: Draws everything.
        remembers: Keep what `path` needs.
    """

    def __init__(
        self,
        xy_m: FloatArray,
        heading_rad: float,
        noise: OdometryNoise,
        params: SlamParams,
        rng: np.random.Generator,
        *,
        remembers: bool = False,
    ) -> None:
        count = params.num_particles
        self._params, self._noise, self._rng = params, noise, rng
        draw = rng.standard_normal((count, 3))
        self.state = np.column_stack(
            [
                np.tile(xy_m, (count, 1)),
                heading_rad + noise.start_heading_rad * draw[:, 0],
                noise.drift_sigma_rad * draw[:, 1],
                noise.length_scale * np.maximum(1.0 + noise.length_scale_sigma * draw[:, 2], 0.0),
            ]
        )
        self.maps = TransitionMaps(count, params.delay)
        self._cell = hexagon_of(self.state[:, :2], params.radius_m)
        self._log_weight = np.zeros(count)
        self._sigmas = (noise.drift_walk_rad, noise.turn_sigma_rad, noise.heading_sigma_rad, noise.length_sigma_m)
        self._remembers = remembers
        self._past: list[tuple[NDArray[np.float32], IntArray | None]] = []
        self._remember(None)

    @property
    def weight(self) -> FloatArray:
        """(N,) sums to 1."""
        weight = np.exp(self._log_weight - self._log_weight.max())
        normalised: FloatArray = weight / weight.sum()
        return normalised

    @property
    def best(self) -> int:
        """The heaviest particle."""
        return int(np.argmax(self._log_weight))

    def stride(self, length_m: float, turn_rad: float, level: int) -> None:
        """Propagates by one stride, which ends on a level, and weighs by the transitions that it makes."""
        p = self._params
        self.maps.make_room()
        kernels.stride(
            self.state,
            self._cell,
            self._log_weight,
            self._rng.standard_normal((len(self.state), 4)),
            (length_m, turn_rad),
            level,
            self._sigmas,
            (p.radius_m, p.alpha, float(p.uses_map)),
            self.maps.tables,
        )
        self._remember(self._resample())

    def mean(self) -> tuple[FloatArray, float, float]:
        """Weighted mean of places (2,) and headings, and standard deviation of places per axis."""
        return spread(self.state[:, :3], self.weight)

    def path(self) -> list[tuple[FloatArray, float, float]]:
        """`mean` at the start and after every stride, of the ancestors of the particles that are left.

        Of a long walk only the last `MAX_STORED` particles are kept: the list is then shorter than the walk.
        """
        index, found = np.arange(len(self.state)), []
        weight = self.weight
        for state, source in reversed(self._past):
            index = index if source is None else source[index]
            found.append(spread(state[index].astype(np.float64), weight))
        return found[::-1]

    def _resample(self) -> IntArray | None:
        """Draws particles anew where few are effective; their ancestors, or None where none were drawn."""
        count = len(self.state)
        self._log_weight -= self._log_weight.max()
        if effective_number(self._log_weight) >= self._params.resampled_below * count:
            return None
        source = in_place(systematic(self.weight, float(self._rng.random())))
        self.state, self._cell = self.state[source], self._cell[source]
        self._log_weight = np.zeros(count)
        self.maps.replace(source)
        return source

    def _remember(self, source: IntArray | None) -> None:
        """Keeps the state after a stride, and where it was drawn from before the next."""
        if self._remembers:
            self._past.append((self.state[:, :3].astype(np.float32), source))
            if len(self._past) * len(self.state) > MAX_STORED:
                self._past.pop(0)


def spread(state: FloatArray, weight: FloatArray) -> tuple[FloatArray, float, float]:
    """Weighted mean of x, y (2,), mean direction, and standard deviation per axis, of states (N, 3)."""
    mean_m = weight @ state[:, :2]
    heading_rad = math.atan2(float(weight @ np.sin(state[:, 2])), float(weight @ np.cos(state[:, 2])))
    variance_m2 = float(weight @ np.square(state[:, :2] - mean_m).sum(axis=1)) / 2
    return mean_m, heading_rad, math.sqrt(variance_m2)
