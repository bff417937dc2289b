"""How far WLAN scans are from the fingerprints of a survey, by the weighted strengths that both have."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pdrbench.geometry import FloatArray, IntArray
from pdrbench.radio.fingerprints import FingerprintTable, strength
from pdrbench.recording import RadioMap, SensorSpec

POWER = 2.5  # of the strength, as the next two chosen on the train and survey walks of MallPhoneLost-v2
SURVEY_AGE_S = 12.0  # an older reading of the survey was heard somewhere else
FRESHNESS_PER_S = 0.8  # a reading of the scan counts for 0.8 ** age


class ScanMatcher:
    """Puts scans together from rows of the sensor `wifi` and compares them with a survey.

    Args:
        radio_map: The survey.
        wifi: What the columns of a row are.
        power: Of the strength, see `strength`.
        survey_age_s: Older readings of the survey are left out.
        freshness_per_s: A reading of a scan counts for this to the power of its age in seconds.
        is_ochiai: Whether by Ochiai's distance 1 - sum min(s, f) / sqrt(sum s * sum f), which is Sorensen's with the
            geometric mean of the sums of a scan and a fingerprint, instead of the cosine distance.

    Attributes:
        table: The survey of S scans.
    """

    def __init__(
        self,
        radio_map: RadioMap,
        wifi: SensorSpec,
        *,
        power: float = POWER,
        survey_age_s: float = SURVEY_AGE_S,
        freshness_per_s: float = FRESHNESS_PER_S,
        is_ochiai: bool = False,
    ) -> None:
        from pdrbench.radio.kernels import InvertedLists, distances, inverse_roots

        power = power / 2 if is_ochiai else power  # lists hold roots of strengths, whose squares are summed
        self._is_ochiai, self._power, self._freshness_per_s = is_ochiai, power, freshness_per_s
        self._columns = [wifi.index(name) for name in ("access_point", "rssi_dbm", "age_s")]
        self._rows: FloatArray = np.zeros((0, len(wifi.columns)))
        self.table = FingerprintTable.from_radio_map(radio_map, max_age_s=survey_age_s)
        strengths = strength(self.table.reading_dbm, power)
        norm2: FloatArray = np.bincount(self.table.fingerprint, strengths**2, len(self.table.level)).astype(np.float64)
        self._distances = distances
        self._lists = InvertedLists(
            self.table.access_point, self.table.first, self.table.fingerprint, strengths, norm2, inverse_roots(norm2)
        )

    @property
    def nbytes(self) -> int:
        """Memory of what queries read: 12 bytes a reading and 16 a fingerprint."""
        return sum(array.nbytes for array in self._lists)

    @property
    def fingerprints(self) -> FloatArray:
        """(S, A) strengths of the survey as a dense table."""
        return strength(self.table.rssi_dbm, self._power)

    def forget(self) -> None:
        """Begins another walk."""
        self._rows = self._rows[:0]

    def update(self, rows: FloatArray) -> Iterator[FloatArray | None]:
        """Takes the next rows; yields what `distance` gives of each scan among them, in the order of time.

        A scan that goes on in later rows is compared again then, as a whole.
        """
        if not len(rows):
            return
        both = np.concatenate([self._rows, rows])
        self._rows = both[both[:, 0] == both[-1, 0]]
        for t_s in np.unique(rows[:, 0]).tolist():
            yield self.distance(both[both[:, 0] == t_s][:, self._columns])

    def distance(self, readings: FloatArray) -> FloatArray | None:
        """(S,) of a scan (n, 3) of access point, RSSI, age; None where the survey knows none of its access points."""
        scan = np.array(readings.T, order="C")
        strengths, weight = strength(scan[1], self._power), self._freshness_per_s ** scan[2]
        distance: FloatArray = self._distances(self._lists, scan[0], strengths, weight, self._is_ochiai)
        return distance if len(distance) else None

    def between(self, scans: IntArray) -> FloatArray:
        """(Q, S) distance of some scans of the survey from all of them, whatever the age of a reading."""
        table, distance = self.table, np.ones((len(scans), len(self.table.level)))
        order = np.argsort(table.fingerprint, kind="stable")
        first = np.searchsorted(table.fingerprint[order], np.arange(len(table.level) + 1))
        access_point = table.access_point[table.column].astype(np.float64)
        for q, scan in enumerate(scans.tolist()):
            if len(own := order[first[scan] : first[scan + 1]]):
                strengths = self._lists.strength[own]
                weight = np.ones(len(own))
                distance[q] = self._distances(self._lists, access_point[own], strengths, weight, self._is_ochiai)
        return distance
