"""Scans as dense rows of signal strengths, which is what packages for fingerprints take."""

from __future__ import annotations

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.radio import UNHEARD_DBM, FingerprintTable
from pdrbench.recording import RadioMap, SensorSpec

MAX_AGE_S = 12.0  # as wifi_knn: an older reading was received somewhere else


class DenseScans:
    """A survey as a table, and the scans of a walk as rows of it.

    Args:
        radio_map: The survey.
        wifi: What the columns of the walk's rows are.

    Attributes:
        rssi_dbm: (S, A), `UNHEARD_DBM` where an access point was not heard.
        xy_m: (S, 2).
        level: (S,) int.
    """

    def __init__(self, radio_map: RadioMap, wifi: SensorSpec) -> None:
        self._table = FingerprintTable.from_radio_map(radio_map, max_age_s=MAX_AGE_S)
        self._columns = [wifi.index(name) for name in ("access_point", "rssi_dbm", "age_s")]
        self._rows: FloatArray = np.zeros((0, len(wifi.columns)))
        self.rssi_dbm, self.xy_m, self.level = self._table.rssi_dbm, self._table.xy_m, self._table.level

    def last(self, rows: FloatArray) -> FloatArray | None:
        """(A,) dBm of the last scan of a walk, given the next rows; None without rows or without anything known."""
        if not len(rows):
            return None
        rows = np.concatenate([self._rows, rows])
        self._rows = rows = rows[rows[:, 0] == rows[-1, 0]]
        access_point, rssi_dbm, age_s = rows[:, self._columns].T
        heard = self._table.access_point
        is_known = np.isin(access_point, heard) & (age_s <= MAX_AGE_S)
        if not is_known.any():
            return None
        column = np.searchsorted(heard, access_point)
        scan_dbm = np.full(self.rssi_dbm.shape[1], UNHEARD_DBM)
        np.maximum.at(scan_dbm, column[is_known], rssi_dbm[is_known])
        return scan_dbm
