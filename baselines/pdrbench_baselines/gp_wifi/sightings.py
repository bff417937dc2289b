"""When and where access points were sighted: a scan of a phone repeats what was received up to half a minute before.

A reading that is older than the time since the scan before was in that scan already. A radio map has no times, but its
repeats give them: the same reading is older in the next scan by the time between the two. So it is known how long each
scan of a survey lasted, and a sighting is placed on the way between two scans, by its age.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray, IntArray
from pdrbench.recording import RadioMap
from pdrbench_baselines.gp_wifi import kernels

MIN_REPEATS: Final = 4  # by which the time between two scans is known
FIRST_S: Final = 3.0  # of a scan without one before it; a sweep of a phone and its delivery
MAX_SWEEP_S: Final = 6.0  # a scan that comes later than that was preceded by a break
SLACK_S: Final = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class Sightings:
    """A survey, each reading once and where it was received.

    Attributes:
        scan: (R,) int, of S.
        access_point: (R,) int.
        rssi_dbm: (R,).
        xy_m: (R, 2).
        scan_xy_m: (S, 2) where the phone was in the middle of each scan.
        scan_level: (S,) int.
    """

    scan: IntArray
    access_point: IntArray
    rssi_dbm: FloatArray
    xy_m: FloatArray
    scan_xy_m: FloatArray
    scan_level: IntArray


def sightings_of(radio_map: RadioMap) -> Sightings:
    """Places the readings of a survey, and leaves repeats out."""
    lasted_s = scan_times_s(radio_map)
    is_known = np.isfinite(lasted_s)
    before = np.arange(len(radio_map)) - is_known  # the scan before; itself where that is not known
    scan = np.repeat(np.arange(len(radio_map)), np.diff(radio_map.first))
    fresh_s = np.where(is_known, np.minimum(lasted_s, MAX_SWEEP_S) + SLACK_S, FIRST_S)
    new = radio_map.age_s <= fresh_s[scan]
    scan = scan[new]
    back = np.clip(np.where(is_known, 1.0 / np.where(is_known, lasted_s, 1.0), 0.0)[scan] * radio_map.age_s[new], 0, 1)
    return Sightings(
        scan=scan,
        access_point=radio_map.access_point[new],
        rssi_dbm=radio_map.rssi_dbm[new],
        xy_m=radio_map.xy_m[scan] + back[:, None] * (radio_map.xy_m[before] - radio_map.xy_m)[scan],
        scan_xy_m=(radio_map.xy_m + radio_map.xy_m[before]) / 2,
        scan_level=radio_map.level,
    )


def scan_times_s(radio_map: RadioMap) -> FloatArray:
    """(S,) time from the scan before to each one, by how much readings that both hold have aged; NaN where unknown."""
    column = np.searchsorted(np.unique(radio_map.access_point), radio_map.access_point)  # half the memory of an inverse
    goes_on = np.diff(radio_map.walk, prepend=radio_map.walk[:1] - 1) == 0
    readings = radio_map.rssi_dbm.copy(), radio_map.age_s.copy()  # what is read-only would be compiled once more
    return np.asarray(kernels.times_between(radio_map.first.copy(), column, *readings, goes_on, MIN_REPEATS))


class Sweeps:
    """New readings of each scan, while rows of the sensor `wifi` come in."""

    def __init__(self) -> None:
        self._last_s: float | None = None

    def update(self, rows: FloatArray) -> Iterator[tuple[float, FloatArray, float]]:
        """Time of each scan among the next rows, those of its rows that are no repeats, and the time since the last.

        Args:
            rows: (n, 5) time, access point, RSSI, frequency, age.
        """
        for t_s in np.unique(rows[:, 0]).tolist():
            since_s = FIRST_S if self._last_s is None else max(t_s - self._last_s, 0.0)
            here = rows[rows[:, 0] == t_s]
            yield t_s, here[here[:, 4] <= min(since_s, MAX_SWEEP_S) + SLACK_S], since_s
            self._last_s = t_s
