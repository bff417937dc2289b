"""Fingerprints of a survey by access point, and how near a scan is to one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdrbench.geometry import FloatArray, IntArray
from pdrbench.recording import RadioMap

UNHEARD_DBM = -100.0  # below what a phone reports; Frank et al. 2009 as claim F4 reads it


@dataclass(frozen=True, slots=True)
class FingerprintTable:
    """A radio map laid out for matching: one fingerprint a scan, its readings access point by access point.

    Memory is in proportion to the readings, not to scans times access points.

    Attributes:
        access_point: (A,) int, sorted.
        first: (A + 1,) int, access point a owns the readings `first[a]:first[a + 1]`.
        fingerprint: (R,) int, scan of each reading; rising within an access point.
        reading_dbm: (R,) above `UNHEARD_DBM`.
        xy_m: (S, 2).
        level: (S,) int.
    """

    access_point: IntArray
    first: IntArray
    fingerprint: NDArray[np.uint32]
    reading_dbm: FloatArray
    xy_m: FloatArray
    level: IntArray

    @classmethod
    def from_radio_map(cls, radio_map: RadioMap, *, max_age_s: float) -> FingerprintTable:
        """Lays a radio map out, without readings older than `max_age_s`: they were received somewhere else."""
        scan = np.repeat(np.arange(len(radio_map)), np.diff(radio_map.first))
        fresh = radio_map.age_s <= max_age_s
        heard, column = np.unique(radio_map.access_point[fresh], return_inverse=True)
        reading_of, rssi_dbm = column * len(radio_map) + scan[fresh], radio_map.rssi_dbm[fresh]
        order = np.argsort(column.astype(np.min_scalar_type(len(heard))), kind="stable")  # scans are in order already
        is_strongest = np.diff(reading_of[order], append=-1) != 0
        if not is_strongest.all():
            order = np.lexsort((rssi_dbm, reading_of))
        kept = order[is_strongest & (rssi_dbm[order] > UNHEARD_DBM)]
        first = np.searchsorted(column[kept], np.arange(len(heard) + 1))
        return cls(heard, first, scan[fresh][kept].astype(np.uint32), rssi_dbm[kept], radio_map.xy_m, radio_map.level)

    @property
    def column(self) -> IntArray:
        """(R,) place of the access point of each reading in `access_point`."""
        return np.repeat(np.arange(len(self.access_point)), np.diff(self.first))

    @property
    def rssi_dbm(self) -> FloatArray:
        """(S, A) as a dense table, `UNHEARD_DBM` where an access point was not heard, or only long ago."""
        rssi_dbm = np.full((len(self.level), len(self.access_point)), UNHEARD_DBM)
        rssi_dbm[self.fingerprint, self.column] = self.reading_dbm
        return rssi_dbm


def strength(rssi_dbm: FloatArray, power: float) -> FloatArray:
    """RSSI as a positive number that grows with nearness: (rssi - unheard) ** power, 0 where unheard.

    The "powed" representation of Torres-Sospedra et al. 2015; a strong access point counts for more than several weak.
    """
    above: FloatArray = np.maximum(rssi_dbm - UNHEARD_DBM, 0.0)
    return above**power
