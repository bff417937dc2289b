"""WiFi scans of a phone that walks: what it delivers, with all that it remembers of earlier sweeps (sources.md 1.9).

About every two seconds the phone sweeps the channels and delivers everything that it received during the last half
minute: of each identifier the last reading, and how old that is. A reading belongs to where the phone was then.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pdrbench.errors import PdrbenchError
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench_sim.noise import autoregressive
from pdrbench_sim.radio.networks import BANDS, Networks
from pdrbench_sim.radio.wlan import Receiver


class ScanError(PdrbenchError):
    """A path that no phone can be carried along."""


@dataclass(frozen=True, slots=True)
class ScanParams:
    """How a phone scans; [M] is measured on site 1 of the Indoor Location Competition 2.0, `train` and `radiomap`."""

    period_s: float = 1.85  # no scan takes less; [M] with the next three: 5, 50 and 95 % are 1.94, 2.25 and 3.3 s
    # Median of what it takes more, log-normal, where one sweep receives `period_heard` identifiers.
    period_more_s: float = 0.45  # [M]
    period_heard: float = 190.0  # see there; [M] of 370 that are listed
    # Of the number of identifiers, with which that time rises: channels that talk are listened to for longer.
    period_power: float = 1.3  # fitted; both logarithms correlate by 0.8 over 45 walks
    walk_log_sigma: float = 0.45  # of the logarithm of that time, between walks; [M] what the number does not explain
    period_log_sigma: float = 0.45  # the same, within a walk; [M]
    sweep_jitter_s: float = 0.12  # of the moment at which a channel is listened to; [M]
    memory_s: float = 30.0  # what was not received for so long is no longer delivered; [M] one reading in 500 is older
    reading_sigma_db: float = 1.0  # between the identifiers of one radio, and from sweep to sweep; ours
    door_change_s: float = 60.0  # mean time until a person opens or closes a door; ours
    door_open_fraction: float = 0.6  # of the time; ours


@dataclass(frozen=True, slots=True, eq=False)
class PhonePath:
    """How a phone was carried."""

    t_s: FloatArray  # (T,) rising, two or more, at any rate
    polygon: IntArray  # (T,) int, floor polygon
    xy_m: FloatArray  # (T, 2)
    heading_rad: FloatArray  # (T,) where its bearer faces, unwrapped: the body is behind the phone
    height_m: FloatArray | None = None  # (T,) above level 0; None for that of `PropagationParams` above the floor

    def __post_init__(self) -> None:
        if self.t_s.ndim != 1 or len(self.t_s) < 2 or not (np.diff(self.t_s) > 0).all():
            raise ScanError("scans need a path: two times or more, each later than the one before it")
        parts = [self.polygon, self.xy_m, self.heading_rad, *([] if self.height_m is None else [self.height_m])]
        if {len(part) for part in parts} != {len(self.t_s)}:
            raise ScanError(f"a path of {len(self.t_s)} times needs one polygon, place and heading for each of them")

    def at(self, t_s: FloatArray, values: FloatArray) -> FloatArray:
        """(N,) or (N, 2) of values (T,) or (T, 2) at other times; the first and the last one beyond the ends."""
        columns = values.reshape(len(self.t_s), -1).T
        found: FloatArray = np.column_stack([np.interp(t_s, self.t_s, column) for column in columns])
        return found.reshape(len(t_s), *values.shape[1:])

    def polygon_at(self, t_s: FloatArray) -> IntArray:
        """(N,) floor polygon."""
        last: IntArray = self.polygon[np.clip(np.searchsorted(self.t_s, t_s, side="right") - 1, 0, None)]
        return last


@dataclass(frozen=True, slots=True, eq=False)
class _Sweeps:
    """K sweeps of one walk, the first ones before it."""

    path: PhonePath  # of the phone
    rng: Sequence[np.random.Generator]  # (4,) of the air, of what is noticed, of the clock and of the body
    delivered_s: FloatArray  # (K,)
    swept_s: FloatArray  # (K,) middles
    is_open: BoolArray  # (K, D) doors
    at: IntArray  # (K,) int, number of the place of each sweep, counting those that differ in a row


def scan_walks(
    networks: Networks,
    rngs: Sequence[np.random.Generator],
    paths: Sequence[PhonePath],
    *,
    params: ScanParams | None = None,
    receiver: Receiver | None = None,
    doors_open: bool | None = None,
    heard: float | None = None,
) -> list[FloatArray]:
    """Scans of phones from the beginning to the end of their paths; the walls are looked at once for all.

    The first sweep begins with the path; before it the phone lay there, scanning, for as long as it remembers. All
    channels of a sweep are received where the phone is in its middle, at most 1 m from where it was.

    Args:
        networks: Senders of the building.
        rngs: Everything that changes from walk to walk. A path that goes on has the same scans so far, whatever other
            paths there are.
        paths: Of the phones.
        params: None for the defaults.
        receiver: None for phones that report what is.
        doors_open: All of them, or none; None for doors that people open and close.
        heard: Each of them has the pace of a sweep that receives so many identifiers; None: of its own first one.

    Returns:
        Of each path (n, 5) rows of the `wifi` stream: delivered at, identifier, whole dBm, MHz, age.
    """
    params, receiver = params or ScanParams(), receiver or Receiver()
    at_once = _heard_at_first(networks, paths) if heard is None else np.full(len(paths), heard)
    walks = [
        _sweep(networks, rng, path, heard, params, doors_open)
        for rng, path, heard in zip(rngs, paths, at_once, strict=True)
    ]
    box_dbm = _box_dbm(networks, walks)
    return [_scan(networks, walk, here, params, receiver) for walk, here in zip(walks, box_dbm, strict=True)]


def _heard_at_first(networks: Networks, paths: Sequence[PhonePath]) -> FloatArray:
    """(W,) how many identifiers one sweep is expected to receive where each path begins, with all doors open.

    Whole numbers: the last bits of what is received depend on how many places are asked for at once.
    """
    from scipy.special import ndtr

    wlan, building = networks.field.params, networks.field.building
    polygon = np.array([path.polygon[0] for path in paths])
    height_m = [
        building.height(path.polygon[:1])[0] + wlan.receiver_height_m if path.height_m is None else path.height_m[0]
        for path in paths
    ]
    box_dbm = networks.field.rssi_mean_dbm(building.level(polygon), [path.xy_m[0] for path in paths], height_m)
    width_db = np.array([band.width_db for band in BANDS])[networks.band]
    above_db = box_dbm[:, networks.box] - networks.loss_db - networks.half_dbm
    chance = networks.most * ndtr(above_db / np.hypot(width_db, wlan.fading_sigma_db))
    heard: FloatArray = np.rint(chance.sum(axis=1))
    return heard


def _sweep(
    networks: Networks,
    rng: np.random.Generator,
    path: PhonePath,
    heard: float,
    params: ScanParams,
    doors_open: bool | None,
) -> _Sweeps:
    clock_rng, door_rng, *others = rng.spawn(6)
    median_s = params.period_more_s * (heard / params.period_heard) ** params.period_power
    delivered_s = _deliveries(clock_rng, path.t_s[0], path.t_s[-1], median_s, params)
    swept_s = np.maximum(delivered_s - networks.age_s.mean(), path.t_s[0])
    is_open = _doors(door_rng, delivered_s, networks.field.num_doors, doors_open, params)
    # Before the first sweep on the way the phone lies at one place: the walls are looked at once.
    is_new = np.concatenate([[True], (np.diff(swept_s) > 0) | (is_open[1:] != is_open[:-1]).any(axis=1)])
    return _Sweeps(path, others, delivered_s, swept_s, is_open, np.cumsum(is_new) - 1)


def _box_dbm(networks: Networks, walks: Sequence[_Sweeps]) -> list[FloatArray]:
    """Of each walk (K, A) what would be received of each box without a body."""
    building, height_m = networks.field.building, networks.field.params.receiver_height_m
    where = []
    for walk in walks:
        place = np.unique(walk.at, return_index=True)[1]
        t_s, path = walk.swept_s[place], walk.path
        polygon = path.polygon_at(t_s)
        heights_m = building.height(polygon) + height_m if path.height_m is None else path.at(t_s, path.height_m)
        where.append((building.level(polygon), path.at(t_s, path.xy_m), heights_m, walk.is_open[place]))
    level, xy_m, heights_m, is_open = (np.concatenate(parts) for parts in zip(*where, strict=True))
    mean_dbm = networks.field.rssi_mean_dbm(level, xy_m, heights_m, doors_open=is_open)
    ends = np.cumsum([len(parts[0]) for parts in where])
    return [part[walk.at] for part, walk in zip(np.split(mean_dbm, ends[:-1]), walks, strict=True)]


def _scan(networks: Networks, walk: _Sweeps, box_dbm: FloatArray, params: ScanParams, receiver: Receiver) -> FloatArray:
    air_rng, notice_rng, jitter_rng, body_rng = walk.rng
    xy_m = walk.path.at(walk.swept_s, walk.path.xy_m)
    heading_rad = walk.path.at(walk.swept_s, walk.path.heading_rad)
    max_loss_db = float(body_rng.uniform(*networks.field.params.body_loss_db))
    box_dbm = box_dbm - networks.field.body_loss_db(xy_m, heading_rad, max_loss_db)
    rssi_dbm = box_dbm[:, networks.box] - networks.loss_db + _fading_db(networks, air_rng, walk.delivered_s, params)
    is_noticed = _notice(networks, notice_rng, rssi_dbm)
    jitter_s = params.sweep_jitter_s * jitter_rng.standard_normal(rssi_dbm.shape)
    ago_s = np.maximum(networks.age_s + jitter_s, 0.0)
    reported_dbm = np.clip(np.rint(receiver.reports(rssi_dbm)), -128.0, 127.0)
    return _deliver(networks, walk, ago_s, is_noticed, reported_dbm, params)


def _deliveries(
    rng: np.random.Generator, begin_s: float, end_s: float, median_s: float, params: ScanParams
) -> FloatArray:
    """(K,) when scans are delivered: those during the memory before the path, then until its end."""
    before_rng, after_rng = rng.spawn(2)  # a longer path has the same first scans
    more_s = median_s * math.exp(params.walk_log_sigma * rng.standard_normal())

    def periods_s(rng: np.random.Generator, length_s: float) -> FloatArray:
        count = math.ceil(length_s / params.period_s) + 1
        drawn: FloatArray = more_s * np.exp(params.period_log_sigma * rng.standard_normal(count))
        return np.cumsum(params.period_s + drawn)

    after_s = periods_s(after_rng, end_s - begin_s)
    before_s = periods_s(before_rng, params.memory_s)
    before_s = np.concatenate([[0.0], before_s[before_s < params.memory_s]])[::-1]
    return begin_s + np.concatenate([-before_s, after_s[after_s <= end_s - begin_s]])


def _doors(
    rng: np.random.Generator, t_s: FloatArray, num_doors: int, doors_open: bool | None, params: ScanParams
) -> BoolArray:
    """(K, D) which doors are open: a process of two states."""
    if doors_open is not None:
        return np.full((len(t_s), num_doors), doors_open)
    is_open = rng.random((len(t_s), num_doors)) < params.door_open_fraction
    is_new = rng.random((len(t_s) - 1, num_doors)) >= np.exp(-np.diff(t_s) / params.door_change_s)[:, None]
    for i, new in enumerate(is_new, start=1):
        is_open[i] = np.where(new, is_open[i], is_open[i - 1])
    return is_open


def _fading_db(networks: Networks, rng: np.random.Generator, t_s: FloatArray, params: ScanParams) -> FloatArray:
    """(K, B) first-order autoregressive in time, the same for all identifiers of a radio but for the reading."""
    wlan = networks.field.params
    num_radios = int(networks.radio.max()) + 1
    radio_rng, reading_rng = rng.spawn(2)
    fading = autoregressive(
        radio_rng.standard_normal((len(t_s), num_radios)), wlan.fading_correlation_1s ** np.diff(t_s)
    )
    reading = reading_rng.standard_normal((len(t_s), len(networks)))
    total: FloatArray = wlan.fading_sigma_db * fading[:, networks.radio] + params.reading_sigma_db * reading
    return total


def _notice(networks: Networks, rng: np.random.Generator, rssi_dbm: FloatArray) -> BoolArray:
    """(K, B) what the sweeps receive."""
    from scipy.special import ndtr

    drift = rng.standard_normal(len(BANDS))
    sigma_db, width_db = np.array([(band.half_sigma_db, band.width_db) for band in BANDS]).T
    band = networks.band
    half_dbm = networks.half_dbm + (sigma_db * drift)[band]
    chance = networks.most * ndtr((rssi_dbm - half_dbm) / width_db[band])
    is_noticed: BoolArray = rng.random(rssi_dbm.shape) < chance
    return is_noticed


def _deliver(
    networks: Networks,
    walk: _Sweeps,
    ago_s: FloatArray,
    is_noticed: BoolArray,
    rssi_dbm: FloatArray,
    params: ScanParams,
) -> FloatArray:
    """(n, 5) of every delivery on the way: the last sighting of each identifier that is young enough."""
    delivered_s = walk.delivered_s
    scan = np.arange(len(delivered_s))[:, None]
    last: IntArray = np.maximum.accumulate(np.where(is_noticed, scan, -1), axis=0)
    scan, identifier = np.nonzero((last >= 0) & (delivered_s > walk.path.t_s[0])[:, None])
    seen = last[scan, identifier]
    age_s = delivered_s[scan] - delivered_s[seen] + ago_s[seen, identifier]
    rows = np.column_stack(
        [
            delivered_s[scan],
            networks.id[identifier],
            rssi_dbm[seen, identifier],
            networks.frequency_mhz[identifier],
            age_s,
        ]
    )
    return rows[age_s <= params.memory_s]
