"""WLAN in a building: access points, what of them is received where, and the survey of it (sources.md 1.9).

The mean follows a multi-wall model along straight rays through the walls of the plan, with shadowing that is the same
at every visit. A scan adds what changes: doors, the body, fading, and whether the receiver notices at all.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.building import Building
from pdrbench.errors import MapError
from pdrbench.geometry import BoolArray, FloatArray, IntArray, read_only
from pdrbench_sim.radio.rays import Obstacles, obstacles

FAINT_DBM: Final = -130.0  # below it no shadowing and no fading brings an access point back: the rest is not counted
CHANNELS_MHZ: Final = (2412.0, 2437.0, 2462.0)  # 1, 6 and 11, which do not overlap
_CANDIDATES: Final = 60  # places that an access point may take, for each that is wanted


@dataclass(frozen=True, slots=True)
class PropagationParams:
    """How radio spreads and is received; sources.md 1.9 unless a line says otherwise."""

    area_per_access_point_m2: float = 70.0  # ours: the median start then needs as many particles as W14's example
    rssi_1m_dbm: float = -20.0  # the 20 dBm that European rules allow at 2.4 GHz, less 40 dB of free space
    rssi_1m_sigma_db: float = 2.0  # between access points; ours
    exponent: float = 2.0  # free space: walls are counted one by one
    light_wall_db: float = 3.4
    heavy_wall_db: float = 6.9
    level_loss_db: float = 18.3
    level_loss_b: float = 0.46
    shadow_sigma_db: float = 4.5
    shadow_length_m: float = 5.0  # correlation falls to 1/e
    fading_sigma_db: float = 3.7  # with the body the nugget of 4.2 dB: time and place within a metre
    fading_correlation_1s: float = 0.8
    body_loss_db: tuple[float, float] = (3.0, 8.0)  # with the back to the access point
    door_loss_db: tuple[float, float] = (2.0, 6.0)  # a closed one
    detection_dbm: float = -88.0  # half of the scans notice it
    detection_width_db: float = 3.0
    access_point_height_m: float = 2.6  # above the floor: under the ceiling; ours
    receiver_height_m: float = 1.0  # above the floor: hip; ours
    num_waves: int = 32  # whose sum is the shadowing of an access point; ours


@dataclass(frozen=True, slots=True)
class Receiver:
    """What one device makes of a signal: offset + slope (RSSI + 60) - 60."""

    offset_db: float = 0.0  # it reports so much too much
    slope: float = 1.0  # its scale about -60 dBm

    def reports(self, rssi_dbm: FloatArray) -> FloatArray:
        """What it reports, before rounding."""
        return self.offset_db + self.slope * (rssi_dbm + 60.0) - 60.0


def draw_receiver(rng: np.random.Generator) -> Receiver:
    """Another device: offset N(0, 4) dB, slope N(1, 0.05), cut at two standard deviations (sources.md 1.9)."""
    offset, slope = np.clip(rng.standard_normal(2), -2, 2)
    return Receiver(float(4.0 * offset), float(1.0 + 0.05 * slope))


@dataclass(frozen=True, slots=True, eq=False)
class AccessPoints:
    """Senders."""

    id: IntArray  # (A,) int, opaque, sorted
    xy_m: FloatArray  # (A, 2)
    level: IntArray  # (A,) int
    height_m: FloatArray  # (A,) above level 0
    rssi_1m_dbm: FloatArray  # (A,) received at 1 m
    frequency_mhz: FloatArray  # (A,)

    def __post_init__(self) -> None:
        for name in ("xy_m", "height_m", "rssi_1m_dbm", "frequency_mhz"):
            object.__setattr__(self, name, read_only(getattr(self, name)))
        for name in ("id", "level"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))
        shapes = {np.shape(a) for a in (self.id, self.level, self.height_m, self.rssi_1m_dbm, self.frequency_mhz)}
        if shapes != {(len(self),)} or self.xy_m.shape != (len(self), 2) or (np.diff(self.id) <= 0).any():
            raise MapError("access points need one of each per sender, sorted by id")

    def __len__(self) -> int:
        return len(self.id)


@dataclass(frozen=True, slots=True, eq=False)
class _Places:
    """Receivers: level (N,), x, y and height (N, 3), and which doors are closed for each (N, D)."""

    level: IntArray
    xyz_m: FloatArray
    is_closed: BoolArray


@dataclass(frozen=True, slots=True, eq=False)
class RadioField:
    """What is received of the access points of a building everywhere in it."""

    building: Building  # its walls and doors stand in the way
    access_points: AccessPoints  # A senders
    params: PropagationParams = field(default_factory=PropagationParams)  # how radio spreads
    shadow_wave_radpm: FloatArray = field(kw_only=True, repr=False)  # (A, M, 3) wave vectors whose sum is the shadowing
    shadow_phase_rad: FloatArray = field(kw_only=True, repr=False)  # (A, M)
    door_loss_db: FloatArray = field(kw_only=True, repr=False)  # (D,) of each door while it is closed

    @property
    def num_doors(self) -> int:
        """Doors of the building, as `pdrbench_sim.radio.rays` numbers them."""
        return len(self.door_loss_db)

    def shadowing_db(self, sender: int, xyz_m: FloatArray) -> FloatArray:
        """(N,) shadowing of one access point at places (N, 3).

        Samples of a Gaussian field whose correlation is exp(-distance / length).
        """
        wave, phase = self.shadow_wave_radpm[sender], self.shadow_phase_rad[sender]
        scale_db = self.params.shadow_sigma_db * math.sqrt(2 / len(phase))
        shadow_db: FloatArray = scale_db * np.cos(xyz_m @ wave.T + phase).sum(axis=1)
        return shadow_db

    def rssi_mean_dbm(
        self, level: ArrayLike, xy_m: ArrayLike, height_m: ArrayLike, *, doors_open: ArrayLike = True
    ) -> FloatArray:
        """What is received before the body, fading and the receiver have their part.

        RSSI(1 m) - 10 n log10(d) - L_w walls - doors - L_f k^((k+2)/(k+1) - b) + shadowing, with d at least 1 m, walls
        and doors counted in plan on the level of the receiver, and k levels between it and the access point (COST 231
        multi-wall model).

        Args:
            level: (N,) or one for all.
            xy_m: (N, 2).
            height_m: (N,) of the receiver above level 0, or one for all.
            doors_open: One bool, or (N,) for all doors at once, or (N, D).

        Returns:
            (N, A); what is below `FAINT_DBM` lacks the walls or the shadowing.
        """
        place_xy_m = np.asarray(xy_m, dtype=np.float64).reshape(-1, 2)
        count = len(place_xy_m)
        where = _Places(
            np.broadcast_to(np.asarray(level), count),
            np.column_stack([place_xy_m, np.broadcast_to(np.asarray(height_m, dtype=np.float64), count)]),
            ~self._doors(doors_open, count),
        )
        params, senders = self.params, self.access_points
        away_m = where.xyz_m - np.column_stack([senders.xy_m, senders.height_m])[:, None]
        distance_m = np.maximum(np.linalg.norm(away_m, axis=2), 1.0)
        rssi_dbm: FloatArray = senders.rssi_1m_dbm[:, None] - 10 * params.exponent * np.log10(distance_m)
        k = np.abs(where.level - senders.level[:, None])
        levels = np.arange(k.max(initial=0) + 1.0)
        rssi_dbm -= (params.level_loss_db * levels ** ((levels + 2) / (levels + 1) - params.level_loss_b))[k]
        for level, here in obstacles(self.building).items():
            on_level = np.flatnonzero(where.level == level)
            for sender in range(len(senders)):
                place = on_level[rssi_dbm[sender, on_level] > FAINT_DBM]
                if len(place):
                    rssi_dbm[sender, place] -= self._obstacle_db(here, senders.xy_m[sender], where, place)
        for sender, heard in enumerate(rssi_dbm > FAINT_DBM):
            rssi_dbm[sender, heard] += self.shadowing_db(sender, where.xyz_m[heard])
        return np.ascontiguousarray(rssi_dbm.T)

    def _obstacle_db(self, here: Obstacles, sender_xy_m: FloatArray, where: _Places, place: IntArray) -> FloatArray:
        """(n,) loss in the walls and closed doors of one level on the way to the given places (n,)."""
        ends = sender_xy_m, where.xyz_m[place, :2]
        light, heavy = here.walls_crossed(*ends)
        loss_db: FloatArray = self.params.light_wall_db * light + self.params.heavy_wall_db * heavy
        if where.is_closed.any():
            nth, door = here.doors_crossed(*ends)
            doors_db = self.door_loss_db[door] * where.is_closed[place[nth], door]
            loss_db += np.bincount(nth, weights=doors_db, minlength=len(place))
        return loss_db

    def _doors(self, doors_open: ArrayLike, count: int) -> BoolArray:
        """(N, D) from one bool, (N,) or (N, D)."""
        given = np.asarray(doors_open)
        if given.dtype != np.bool_ or given.shape not in ((), (count,), (count, self.num_doors)):
            raise MapError(
                f"doors are open or not: give one bool, {count} or {count} x {self.num_doors}; got {given.dtype} "
                f"{given.shape}"
            )
        return np.broadcast_to(given if given.ndim == 2 else given.reshape(-1, 1), (count, self.num_doors))

    def body_loss_db(self, xy_m: FloatArray, heading_rad: FloatArray, max_loss_db: float | FloatArray) -> FloatArray:
        """(K, A): nothing for who faces an access point, all of `max_loss_db` for who turns the back on it.

        Args:
            xy_m: (K, 2) of the receiver.
            heading_rad: (K,) where its bearer faces.
            max_loss_db: One for all, or (K, 1).
        """
        away = self.access_points.xy_m - xy_m[:, None]
        turn_rad = np.arctan2(away[..., 1], away[..., 0]) - heading_rad[:, None]
        loss_db: FloatArray = max_loss_db * (1 - np.cos(turn_rad)) / 2
        return loss_db


def make_radio_field(
    rng: np.random.Generator,
    building: Building,
    *,
    num_access_points: int | None = None,
    params: PropagationParams | None = None,
) -> RadioField:
    """Hangs access points under the ceilings of a building, evenly spread over each level, and draws the rest.

    Args:
        rng: Two fields from generators in the same state are equal.
        building: Any.
        num_access_points: None for one in `area_per_access_point_m2`; each level gets its part by area, 1 or more.
        params: None for the defaults.
    """
    params = params or PropagationParams()
    return radio_field(rng, building, _place(rng, building, num_access_points, params), params)


def radio_field(
    rng: np.random.Generator, building: Building, access_points: AccessPoints, params: PropagationParams
) -> RadioField:
    """Draws the shadowing of given access points, and what each door of the building takes while it is closed."""
    num_senders, num_waves = len(access_points), params.num_waves
    # exp(-r / length) in space is the mixture of Gaussian correlations whose inverse widths are chi-squared with 1
    # degree of freedom: wave vectors are Student-t (Rahimi & Recht 2007; Rasmussen & Williams 2006, section 4.2).
    wave = rng.standard_normal((num_senders, num_waves, 3)) / params.shadow_length_m
    wave /= np.abs(rng.standard_normal((num_senders, num_waves, 1)))
    num_doors = 1 + max(int(here.door.max(initial=-1)) for here in obstacles(building).values())
    return RadioField(
        building,
        access_points,
        params,
        shadow_wave_radpm=read_only(wave),
        shadow_phase_rad=read_only(rng.uniform(0, 2 * math.pi, (num_senders, num_waves))),
        door_loss_db=read_only(rng.uniform(*params.door_loss_db, size=num_doors)),
    )


def _place(
    rng: np.random.Generator, building: Building, num_access_points: int | None, params: PropagationParams
) -> AccessPoints:
    level_m2 = {level: sum(p.area_m2 for p in building.polygons if p.level == level) for level in building.levels}
    wanted = num_access_points or max(1, round(building.area_m2 / params.area_per_access_point_m2))
    if wanted < len(level_m2):
        raise MapError(f"{len(level_m2)} levels need an access point each; got num_access_points={wanted}")
    fractions = _apportioned(np.array(list(level_m2.values())), wanted)
    spread = [_spread(rng, building, level, count) for level, count in zip(level_m2, fractions.tolist(), strict=True)]
    order = rng.permutation(wanted)  # identifiers reveal no level
    polygon, xy_m = (np.concatenate(parts)[order] for parts in zip(*spread, strict=True))
    return AccessPoints(
        id=draw_opaque_ids(rng, wanted),
        xy_m=xy_m,
        level=building.level(polygon),
        height_m=building.height(polygon) + params.access_point_height_m,
        rssi_1m_dbm=rng.normal(params.rssi_1m_dbm, params.rssi_1m_sigma_db, wanted),
        frequency_mhz=rng.choice(CHANNELS_MHZ, wanted),
    )


def _apportioned(area_m2: FloatArray, wanted: int) -> IntArray:
    """Whole numbers of 1 or more that add up to `wanted` and follow the areas."""
    fraction = np.ones(len(area_m2), dtype=np.int64)
    for _ in range(wanted - len(area_m2)):
        fraction[np.argmax(area_m2 / fraction)] += 1
    return fraction


def _spread(rng: np.random.Generator, building: Building, level: int, count: int) -> tuple[IntArray, FloatArray]:
    """Places on a level about as far from each other as can be: centres of clusters of its floor, moved onto it."""
    from scipy.spatial.distance import cdist

    polygon, xy_m = building.sample_uniform(rng, _CANDIDATES * count, level)
    centre = xy_m[rng.choice(len(xy_m), count, replace=False)]
    for _ in range(20):
        of = cdist(xy_m, centre, "sqeuclidean").argmin(axis=1)
        size = np.maximum(np.bincount(of, minlength=count), 1)
        centre = np.column_stack([np.bincount(of, weights=v, minlength=count) / size for v in xy_m.T])
    chosen = cdist(centre, xy_m, "sqeuclidean").argmin(axis=1)
    return polygon[chosen], xy_m[chosen]


def draw_opaque_ids(rng: np.random.Generator, count: int) -> IntArray:
    """(count,) different numbers, sorted, as long as the address of a network card."""
    drawn = np.unique(rng.integers(2**48, size=count))
    while len(drawn) < count:
        drawn = np.unique(np.concatenate([drawn, rng.integers(2**48, size=count - len(drawn))]))
    return drawn
