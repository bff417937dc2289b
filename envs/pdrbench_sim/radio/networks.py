"""Which identifiers the boxes of a WLAN send: several a box, over two bands, and boxes on levels that no plan shows.

A phone lists identifiers (BSSIDs). A box of an office or a mall sends up to a dozen, half of them in each band; routers
of shops and hot spots send one or two. All identifiers of a box share its place and its shadowing, those of one radio
its fading as well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray, IntArray, read_only
from pdrbench_sim.radio.wlan import (
    AccessPoints,
    PropagationParams,
    RadioField,
    draw_opaque_ids,
    make_radio_field,
    radio_field,
)


@dataclass(frozen=True, slots=True)
class Band:
    """Channels that a phone sweeps one after the other, and how well it receives there.

    [M] is measured on site 1 of the Indoor Location Competition 2.0, walks `train` and `radiomap`.
    """

    channels_mhz: tuple[float, ...]  # centres, in the order of the sweep
    fraction: tuple[float, ...]  # (C,) of the radios, by channel
    age_s: tuple[float, float]  # from the sweep of the first and of the last channel to the delivery of the scan
    loss_db: float  # on top of the path loss at 2.4 GHz
    most: float  # fraction of sweeps that notice a strong sender
    half_dbm: float  # noticed half as often as a strong one
    width_db: float  # of the curve in between: the normal distribution function of (RSSI - half) / width
    half_sigma_db: float  # of `half_dbm` between walks: other traffic in the band


LOW_BAND: Final = Band(
    channels_mhz=(2412.0, 2432.0, 2437.0, 2452.0, 2462.0, 2472.0),  # [M] nine in ten readings of the band
    fraction=(0.30, 0.14, 0.11, 0.15, 0.11, 0.19),  # [M]
    age_s=(2.06, 1.38),  # [M]
    loss_db=0.0,
    most=0.93,  # [M]
    half_dbm=-74.0,  # [M] crowded: half of the readings of -75 dBm are not repeated by the next sweep
    width_db=5.0,  # [M]
    half_sigma_db=5.0,  # [M] between walks 17 to 75 % of what was received well is received again
)
MIDDLE_BAND: Final = Band(
    channels_mhz=(5180.0, 5200.0, 5220.0, 5240.0),
    fraction=(0.43, 0.22, 0.19, 0.16),  # [M]
    age_s=(1.35, 1.18),  # [M]
    loss_db=3.0,  # 7.1 dB of free space between 2440 and 5500 MHz, less what more power makes up for; ours
    most=0.96,  # [M]
    half_dbm=-88.0,  # [M]
    width_db=2.5,  # [M]
    half_sigma_db=1.5,  # [M] between walks 82 to 95 % of what was received well is received again
)
RADAR_BAND: Final = Band(
    channels_mhz=(5260.0, 5280.0, 5300.0),
    fraction=(0.39, 0.30, 0.31),  # [M]
    age_s=(0.78, 0.55),  # [M] swept last, in silence and for longer
    loss_db=3.0,  # as above
    most=1.0,  # [M]
    half_dbm=-89.5,  # [M]
    width_db=2.0,  # [M]
    half_sigma_db=1.5,  # as above
)
HIGH_BAND: Final = Band(
    channels_mhz=(5745.0, 5765.0, 5785.0, 5805.0, 5825.0),
    fraction=(0.24, 0.19, 0.18, 0.19, 0.20),  # [M]
    age_s=(1.09, 0.91),  # [M]
    loss_db=3.0,  # as above
    most=0.95,  # [M]
    half_dbm=-87.5,  # [M]
    width_db=2.5,  # [M]
    half_sigma_db=1.5,  # as above
)
BANDS: Final = (LOW_BAND, MIDDLE_BAND, RADAR_BAND, HIGH_BAND)


MALL_WLAN: Final = PropagationParams(  # fitted to the walks of `Band`, by the figures behind each value
    rssi_1m_dbm=-17.0,  # the strongest reading of a scan is about -48 dBm
    rssi_1m_sigma_db=7.5,  # some boxes are received all over a floor, most in one place
    exponent=3.7,  # that of a fit to what is received comes out as 3; stands for shelves and people, too
    heavy_wall_db=14.0,  # of passages: of those at -65 dBm before them two thirds are lost 4 to 14 m on, inside
    shadow_sigma_db=7.0,  # with the next one the variogram: 5.9 dB at 5 m, 7.5 at 12 m, 9.6 at 22 m
    shadow_length_m=10.0,  # the same
    fading_sigma_db=3.0,  # with the body 4.1 dB between walks within a metre
    fading_correlation_1s=0.9,  # sources.md 1.9: up to 0.9
    access_point_height_m=5.0,  # ceilings of malls are high; ours
)


@dataclass(frozen=True, slots=True)
class NetworkParams:
    """How many boxes there are and what they send, in a mall; [M] as for `Band`."""

    # Of floor, for each box on a level of the building.
    area_per_box_m2: float = 120.0  # fitted: a scan lists 370 identifiers
    # Levels beyond the building's own received through the floor, relative to the lowest and the highest one: 1 is one
    # below and one above.
    neighbour_levels: int = 1  # ours
    # Of the boxes belong to the network of the building.
    managed_fraction: float = 0.3  # fitted to the spread of matched scans; [M] of the boxes received 0.14 send a dozen
    # Identifiers of such a box in one band, drawn uniformly from these.
    managed_ids: tuple[int, ...] = (4, 5, 6)  # [M] twelve in both bands are the most frequent
    own_loss_db: float = 9.0  # by so much the other boxes are weaker: small ones, in the back of a shop; fitted with it
    own_ids: float = 0.75  # fraction of the other boxes that send one identifier; the rest send two; [M] 404 of 519
    # Of the other boxes send at 5 GHz; the rest at 2.4 GHz.
    upper_fraction: float = 0.4  # [M] 46 % of all identifiers are at 5 GHz
    # (3,) of the radios at 5 GHz that use each of its three parts.
    band_fraction: tuple[float, float, float] = (0.23, 0.09, 0.68)  # [M]
    hard_of_hearing_db: float = 0.0  # by so much `Band.half_dbm` is higher: other traffic in the building
    sweep_fraction: float = 1.0  # of the beacons that would be noticed, those that a busy phone listens to
    level_height_m: float = 5.0  # between levels that no plan shows; as in the plans of malls
    wlan: PropagationParams = MALL_WLAN  # how radio spreads


def draw_mall_networks(rng: np.random.Generator) -> NetworkParams:
    """Another shopping centre: site 1 and most of what sources.md 1.9 reports of many floors are within reach.

    Reported are medians of floors between 2.5 and 3.75 for the exponent of a fit to what is received, 5.5 to 6.4 dB for
    its residual (site 1: 6.9 dB), between two walks 4.2 to 5.2 dB within a metre (site 1: 4.1 dB) and 6.5 to 8.2 dB
    at 22 m (site 1: 9.6 dB), 40 to 50 % of fresh readings, 333 identifiers a scan (site 1: 350) and 2.2 s between
    scans. The laws are ours: their middle lies near what is reported of many floors, or between that and site 1. What
    site 1 varies more than shadowing of 4.5 dB explains is mostly its service passages, where little is received.
    """
    # Open halls of glass or a warren of full shelves: air and walls go together.
    closed, shadow, fading, sweep = rng.random(4)
    exponent = 2.6 + 1.8 * closed
    light_wall_db = 0.1 + 2.1 * closed
    shadow_sigma_db = 2.6 + 5.8 * shadow
    wlan = replace(
        MALL_WLAN,
        # Planners of networks want the same reach: steeper air gets more power.
        rssi_1m_dbm=MALL_WLAN.rssi_1m_dbm + 19.0 * (exponent - MALL_WLAN.exponent),
        exponent=exponent,
        light_wall_db=light_wall_db,
        shadow_sigma_db=shadow_sigma_db,
        # On the line through 4.5 dB with 5 m, of sources.md 1.9, and 7 dB with 10 m, which site 1 has.
        shadow_length_m=max(5.0 + 2.0 * (shadow_sigma_db - 4.5), 4.0),
        fading_sigma_db=2.1 + 2.5 * fading,
    )
    boxes, ears = rng.standard_normal(2)
    return NetworkParams(
        area_per_box_m2=NetworkParams().area_per_box_m2 * math.exp(0.12 * boxes),
        hard_of_hearing_db=1.0 * ears,
        sweep_fraction=0.80 + 0.28 * sweep,
        wlan=wlan,
    )


OFFICE_NETWORKS: Final = NetworkParams(  # ours: one owner, walls counted one by one
    area_per_box_m2=PropagationParams().area_per_access_point_m2,
    managed_fraction=0.7,
    level_height_m=3.4,
    wlan=PropagationParams(),
)


@dataclass(frozen=True, slots=True, eq=False)
class Networks:
    """Everything that a phone may list in a building."""

    field: RadioField  # boxes and how they spread
    id: IntArray  # (B,) int, opaque, sorted
    box: IntArray  # (B,) int, index into `field.access_points`
    radio: IntArray  # (B,) int, a box has one for each band that it uses
    band: IntArray  # (B,) int, index into `BANDS`
    frequency_mhz: FloatArray  # (B,)
    age_s: FloatArray  # (B,) from the sweep of the channel to the delivery of the scan
    loss_db: FloatArray  # (B,) on top of what the field says of the box
    half_dbm: FloatArray  # (B,) noticed half as often as a strong one
    most: FloatArray  # (B,) fraction of sweeps that notice a strong one

    def __len__(self) -> int:
        return len(self.id)


def make_networks(rng: np.random.Generator, building: Building, params: NetworkParams | None = None) -> Networks:
    """Hangs boxes under the ceilings of a building and of the levels around it, and draws what they send.

    Args:
        rng: Two networks from generators in the same state are equal.
        building: Any.
        params: None for the defaults.
    """
    params = params or NetworkParams()
    field_rng, around_rng, send_rng = rng.spawn(3)
    count = max(len(building.levels), round(building.area_m2 / params.area_per_box_m2))
    spread = make_radio_field(field_rng, building, num_access_points=count, params=params.wlan)
    if params.neighbour_levels:
        boxes = _with_neighbours(around_rng, spread.access_points, building, params)
        spread = radio_field(around_rng, building, boxes, params.wlan)
    return _draw_identifiers(send_rng, spread, params)


def _with_neighbours(
    rng: np.random.Generator, boxes: AccessPoints, building: Building, params: NetworkParams
) -> AccessPoints:
    """Boxes of the building, and as many on each level below and above as on the level that is nearest."""
    parts = [boxes]
    for end, step in ((min(building.levels), -1), (max(building.levels), 1)):
        count = int((boxes.level == end).sum())
        for away in range(1, params.neighbour_levels + 1):
            _, xy_m = building.sample_uniform(rng, count, end)
            height_m = boxes.height_m[boxes.level == end].mean() + step * away * params.level_height_m
            parts.append(
                AccessPoints(
                    id=np.arange(count),
                    xy_m=xy_m,
                    level=np.full(count, end + step * away),
                    height_m=np.full(count, height_m),
                    rssi_1m_dbm=rng.normal(params.wlan.rssi_1m_dbm, params.wlan.rssi_1m_sigma_db, count),
                    frequency_mhz=np.zeros(count),
                )
            )
    columns = ("xy_m", "level", "height_m", "rssi_1m_dbm", "frequency_mhz")
    together = {name: np.concatenate([getattr(part, name) for part in parts]) for name in columns}
    return AccessPoints(id=draw_opaque_ids(rng, sum(map(len, parts))), **together)


def _draw_identifiers(rng: np.random.Generator, spread: RadioField, params: NetworkParams) -> Networks:
    num_boxes = len(spread.access_points)
    is_managed = rng.random(num_boxes) < params.managed_fraction
    is_upper = rng.random(num_boxes) < params.upper_fraction
    part = rng.choice((1, 2, 3), num_boxes, p=params.band_fraction)
    many = rng.choice(params.managed_ids, num_boxes)
    few = 1 + (rng.random(num_boxes) >= params.own_ids)
    count = np.where(is_managed, many, few)
    # Two radios a box: the one at 2.4 GHz, the one at 5 GHz.
    radio_count = np.column_stack(
        [np.where(is_managed | ~is_upper, count, 0), np.where(is_managed | is_upper, count, 0)]
    )
    radio_band = np.column_stack([np.zeros(num_boxes, dtype=np.int64), part])
    radio_mhz, radio_age_s = np.zeros((num_boxes, 2)), np.zeros((num_boxes, 2))
    for number, channels in enumerate(BANDS):
        here = radio_band == number
        nth = rng.choice(len(channels.fraction), here.sum(), p=channels.fraction)
        radio_mhz[here] = np.array(channels.channels_mhz)[nth]
        radio_age_s[here] = np.interp(
            radio_mhz[here], channels.channels_mhz[:: len(channels.fraction) - 1], channels.age_s
        )
    radio = np.repeat(np.arange(2 * num_boxes), radio_count.ravel())
    if not len(radio):
        raise MapError("no box sends anything; ask for more boxes")
    radio = radio[rng.permutation(len(radio))]  # identifiers reveal no box
    band = radio_band.ravel()[radio]
    loss_db = np.array([b.loss_db for b in BANDS])[band] + np.where(is_managed[radio // 2], 0.0, params.own_loss_db)
    return Networks(
        field=spread,
        id=read_only(draw_opaque_ids(rng, len(radio)), np.int64),
        box=read_only(radio // 2, np.int64),
        radio=read_only(radio, np.int64),
        band=read_only(band, np.int64),
        frequency_mhz=read_only(radio_mhz.ravel()[radio]),
        age_s=read_only(radio_age_s.ravel()[radio]),
        loss_db=read_only(loss_db),
        half_dbm=read_only(np.array([b.half_dbm for b in BANDS])[band] + params.hard_of_hearing_db),
        most=read_only(np.minimum(np.array([b.most for b in BANDS])[band] * params.sweep_fraction, 1.0)),
    )
