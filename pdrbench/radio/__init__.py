"""Toolbox for radio: fingerprints, how far a scan is from each of them, and the cells that a floor is divided into."""

from __future__ import annotations

from pdrbench.radio.cells import Cells, divide
from pdrbench.radio.fingerprints import UNHEARD_DBM, FingerprintTable, cosine_distance, strength

__all__ = [
    "UNHEARD_DBM",
    "Cells",
    "FingerprintTable",
    "cosine_distance",
    "divide",
    "strength",
]
