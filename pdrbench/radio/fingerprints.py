"""Fingerprints as a dense table: one row a surveyed scan, one column an access point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.recording import RadioMap

UNHEARD_DBM = -100.0  # below what a phone reports; Frank et al. 2009 as claim F4 reads it


@dataclass(frozen=True, slots=True)
class FingerprintTable:
    """A radio map laid out for matching.

    Attributes:
        access_point: (A,) int, sorted.
        rssi_dbm: (S, A), `UNHEARD_DBM` where an access point was not heard, or only long ago.
        xy_m: (S, 2).
        level: (S,) int.
    """

    access_point: IntArray
    rssi_dbm: FloatArray
    xy_m: FloatArray
    level: IntArray

    @classmethod
    def from_radio_map(cls, radio_map: RadioMap, *, max_age_s: float) -> FingerprintTable:
        """Lays a radio map out, without readings older than `max_age_s`: they were received somewhere else."""
        scan = np.repeat(np.arange(len(radio_map)), np.diff(radio_map.first))
        fresh = radio_map.age_s <= max_age_s
        heard, column = np.unique(radio_map.access_point[fresh], return_inverse=True)
        rssi_dbm = np.full((len(radio_map), len(heard)), UNHEARD_DBM)
        np.maximum.at(rssi_dbm, (scan[fresh], column), radio_map.rssi_dbm[fresh])
        return cls(heard, rssi_dbm, radio_map.xy_m, radio_map.level)

    def columns(self, access_point: FloatArray) -> tuple[IntArray, BoolArray]:
        """Column of each access point (n,), and whether the table knows it; the column means nothing where not."""
        heard, wanted = self.access_point, access_point.astype(np.int64)
        if not len(heard):
            return np.zeros(len(wanted), dtype=np.int64), np.zeros(len(wanted), dtype=np.bool_)
        column = np.minimum(np.searchsorted(heard, wanted), len(heard) - 1)
        return column, heard[column] == wanted


def strength(rssi_dbm: FloatArray, power: float) -> FloatArray:
    """RSSI as a positive number that grows with nearness: (rssi - unheard) ** power, 0 where unheard.

    The "powed" representation of Torres-Sospedra et al. 2015; a strong access point counts for more than several weak.
    """
    above: FloatArray = np.maximum(rssi_dbm - UNHEARD_DBM, 0.0)
    return above**power


def cosine_distance(
    fingerprints: FloatArray, scan: FloatArray, weight: FloatArray, squares: FloatArray | None = None
) -> FloatArray:
    """One minus the weighted cosine between a scan and each fingerprint; blind to a factor between two phones.

    Args:
        fingerprints: (S, A) strengths.
        scan: (A,) strengths.
        weight: (A,) how much each column counts.
        squares: (S, A) `fingerprints**2`, where that is at hand: it takes most of the time.

    Returns:
        (S,) in [0, 1]; 1 where nothing is shared.
    """
    product = fingerprints @ (weight * scan)
    norms = np.sqrt((fingerprints**2 if squares is None else squares) @ weight) * np.sqrt(weight @ scan**2)
    cosine: FloatArray = np.divide(product, norms, out=np.zeros_like(product), where=norms > 0)
    return 1.0 - cosine
