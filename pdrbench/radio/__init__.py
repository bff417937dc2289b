"""Toolbox for radio: fingerprints and how far a scan is from each of them."""

from __future__ import annotations

from pdrbench.radio.fingerprints import UNHEARD_DBM, FingerprintTable, cosine_distance, strength

__all__ = ["UNHEARD_DBM", "FingerprintTable", "cosine_distance", "strength"]
