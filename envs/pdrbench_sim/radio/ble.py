"""Bluetooth beacons of a building, and which of their advertisements a phone that is carried through it reports."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import FloatArray
from pdrbench_sim.radio.scans import PhonePath
from pdrbench_sim.radio.wlan import PropagationParams, RadioField, make_radio_field

BEACON_WLAN: Final = PropagationParams(
    rssi_1m_dbm=-57.0,  # fitted; nine in ten recorded readings claim -56
    rssi_1m_sigma_db=3.0,  # ours
    exponent=2.2,  # ours: hung low, with shelves and people between
    light_wall_db=3.4,  # sources.md 1.9, as all that is not said here
    shadow_sigma_db=4.5,
    fading_sigma_db=6.0,  # from one advertisement to the next, each on another channel
    detection_dbm=-89.0,  # fitted; recorded readings: 5 % below -94, half below -81 dBm
    detection_width_db=3.0,
    access_point_height_m=2.2,  # ours
)
_GRID_S: Final = 1.0  # the mean is computed so often and interpolated: shadowing changes over metres


@dataclass(frozen=True, slots=True)
class BeaconParams:
    """How beacons send and phones listen; [M] on site 1 of the Indoor Location Competition 2.0, walks `train`."""

    area_per_beacon_m2: float = 350.0  # of floor; fitted: half a minute of walking receives about 20 [M]
    rate_hz: float = 2.0  # advertisements of one beacon; sources.md 1.9
    # Fraction of the time that the phone listens where a beacon sends.
    listens: float = 0.28  # fitted: one beacon gives 0.2 readings a second
    claimed_dbm: float = -56.0  # power at 1 m that beacons claim; [M]
    wlan: PropagationParams = BEACON_WLAN  # how their signals spread; its fading is that between advertisements


@dataclass(frozen=True, slots=True, eq=False)
class Beacons:
    """The beacons of a building: `field.access_points` are the beacons."""

    field: RadioField
    params: BeaconParams


def make_beacons(rng: np.random.Generator, building: Building, params: BeaconParams | None = None) -> Beacons:
    """Hangs beacons evenly over each level, one in `area_per_beacon_m2` and one or more on each.

    Args:
        rng: Two sets from generators in the same state are equal.
        building: Any.
        params: None for the defaults.
    """
    params = params or BeaconParams()
    count = max(len(building.levels), round(building.area_m2 / params.area_per_beacon_m2))
    return Beacons(make_radio_field(rng, building, num_access_points=count, params=params.wlan), params)


def receive_beacons(beacons: Beacons, rng: np.random.Generator, path: PhonePath) -> FloatArray:
    """Advertisements that a phone reports on its path.

    Args:
        beacons: All of the building.
        rng: Everything that changes from walk to walk. A path that goes on has the same rows so far, but for the last
            half second.
        path: Of the phone.

    Returns:
        (n, 4) rows of the `ble` stream: time, beacon, whole dBm, power at 1 m that the beacon claims.
    """
    from scipy.special import ndtr

    params, wlan = beacons.params, beacons.params.wlan
    time_rng, air_rng, notice_rng, body_rng = rng.spawn(4)
    begin_s, length_s = path.t_s[0], path.t_s[-1] - path.t_s[0]
    num_beacons = len(beacons.field.access_points)
    # Every beacon sends evenly, up to 10 ms late (Bluetooth Core 4.4.2.2), from a phase of its own.
    count = math.ceil(length_s * params.rate_hz) + 1
    phase = time_rng.random(num_beacons)
    late_s = 0.01 * time_rng.random((count, num_beacons))
    sent_s = (np.arange(count)[:, None] + phase) / params.rate_hz + late_s
    rssi_dbm = _mean_dbm(beacons, path, float(body_rng.uniform(*wlan.body_loss_db)), begin_s + sent_s)
    rssi_dbm += wlan.fading_sigma_db * air_rng.standard_normal(rssi_dbm.shape)
    chance = params.listens * ndtr((rssi_dbm - wlan.detection_dbm) / wlan.detection_width_db)
    is_heard = (notice_rng.random(rssi_dbm.shape) < chance) & (sent_s <= length_s)
    nth, beacon = np.nonzero(is_heard)
    rows = np.column_stack(
        [
            begin_s + sent_s[nth, beacon],
            beacons.field.access_points.id[beacon],
            np.clip(np.rint(rssi_dbm[nth, beacon]), -128.0, 127.0),
            np.full(len(nth), params.claimed_dbm),
        ]
    )
    return rows[np.argsort(rows[:, 0], kind="stable")]


def _mean_dbm(beacons: Beacons, path: PhonePath, max_loss_db: float, t_s: FloatArray) -> FloatArray:
    """(N, B) RSSI of each beacon at its times (N, B), the body in the way included."""
    grid_s = np.arange(path.t_s[0], path.t_s[-1] + _GRID_S, _GRID_S)
    polygon, xy_m = path.polygon_at(grid_s), path.at(grid_s, path.xy_m)
    building = beacons.field.building
    height_m = (
        building.height(polygon) + beacons.params.wlan.receiver_height_m
        if path.height_m is None
        else path.at(grid_s, path.height_m)
    )
    mean_dbm = beacons.field.rssi_mean_dbm(building.level(polygon), xy_m, height_m)
    mean_dbm -= beacons.field.body_loss_db(xy_m, path.at(grid_s, path.heading_rad), max_loss_db)
    return np.column_stack([np.interp(t, grid_s, mean) for t, mean in zip(t_s.T, mean_dbm.T, strict=True)])
