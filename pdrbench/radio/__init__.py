"""Toolbox for radio: fingerprints, how far a scan is from each of them, and where access points are visible from."""

from __future__ import annotations

from pdrbench.radio.cells import Cells, divide
from pdrbench.radio.fingerprints import UNHEARD_DBM, FingerprintTable, cosine_distance, strength
from pdrbench.radio.histograms import BestOfThree, HistogramTable
from pdrbench.radio.visibility import VisibilityMap, WlanStart

__all__ = [
    "UNHEARD_DBM",
    "BestOfThree",
    "Cells",
    "FingerprintTable",
    "HistogramTable",
    "VisibilityMap",
    "WlanStart",
    "cosine_distance",
    "divide",
    "strength",
]
