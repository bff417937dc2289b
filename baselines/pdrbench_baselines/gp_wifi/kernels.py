"""Compiled: what the readings of a scan say of the places of their fields."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pdrbench.compiled import compiled

MAX_SQUARE = 25.0  # half of a squared deviation; rarer readings are as good as unexpected: e^-25 of 5e4 times as likely


def warm_up() -> None:
    """Compiles it, or loads it from the cache."""
    one = np.ones(1, dtype=np.float32)
    at = np.zeros(1, dtype=np.int32), np.array([0, 1])
    add_readings(np.zeros((1, 1)), *at, one, one, np.ones((1, 3)), np.zeros(1), 25.0)


@compiled
def add_readings(
    found: Any, at: Any, first: Any, mean_dbm: Any, variance_db2: Any, readings: Any, offset_db: Any, noise_db2: float
) -> None:
    """Adds trust * log(1 + odds * density of a reading) to `found` (N, K), as `GpWifiParams` does.

    Args:
        found: (N, K).
        at: (E,) places of the fields of R readings, one field after the other.
        first: (R + 1,) where each field begins.
        mean_dbm: (E,).
        variance_db2: (E,).
        readings: (R, 3) dBm, odds and trust.
        offset_db: (K,).
        noise_db2: Of a reading.
    """
    for r in range(len(readings)):
        dbm, odds, trust = readings[r]
        for e in range(first[r], first[r + 1]):
            half = 0.5 / (variance_db2[e] + noise_db2)
            peak = odds * math.sqrt(half / math.pi)
            for k in range(len(offset_db)):
                off_db = dbm - mean_dbm[e] - offset_db[k]
                square = off_db * off_db * half
                if square < MAX_SQUARE:
                    found[at[e], k] += trust * math.log1p(peak * math.exp(-square))
