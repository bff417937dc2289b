"""How far WLAN scans are from the fingerprints of a survey, by the weighted cosine of their strengths."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.radio.fingerprints import FingerprintTable, cosine_distance, strength
from pdrbench.recording import RadioMap, SensorSpec

POWER = 2.5  # of the strength, as the next two chosen on the train and survey walks of MallPhoneLost-v0
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

    Attributes:
        table: (S, A) the survey.
        fingerprints: (S, A) its strengths.
    """

    def __init__(
        self,
        radio_map: RadioMap,
        wifi: SensorSpec,
        *,
        power: float = POWER,
        survey_age_s: float = SURVEY_AGE_S,
        freshness_per_s: float = FRESHNESS_PER_S,
    ) -> None:
        self._power, self._freshness_per_s = power, freshness_per_s
        self._columns = [wifi.index(name) for name in ("access_point", "rssi_dbm", "age_s")]
        self._rows: FloatArray = np.zeros((0, len(wifi.columns)))
        self.table = FingerprintTable.from_radio_map(radio_map, max_age_s=survey_age_s)
        self.fingerprints = strength(self.table.rssi_dbm, power)
        self._squares = self.fingerprints**2

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
        column, known = self.table.columns(readings[:, 0])
        if not known.any():
            return None
        readings, column = readings[known], column[known]
        order = np.argsort(readings[:, 1], kind="stable")  # where one stands twice, the strongest counts
        scan, weight = np.zeros(len(self.table.access_point)), np.ones(len(self.table.access_point))
        scan[column[order]] = strength(readings[order, 1], self._power)
        weight[column[order]] = self._freshness_per_s ** readings[order, 2]
        return cosine_distance(self.fingerprints, scan, weight, self._squares)
