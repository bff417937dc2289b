"""Compiled: what one reading says of the places of a field."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pdrbench.compiled import compiled

MAX_SQUARE = 25.0  # half of a squared deviation; rarer readings are as good as unexpected: e^-25 of 5e4 times as likely


def warm_up() -> None:
    """Compiles it, or loads it from the cache."""
    one = np.ones(1, dtype=np.float32)
    add_reading(np.zeros((1, 1)), np.zeros(1, dtype=np.int32), one, one, -60.0, np.zeros(1), 25.0, 1.0, 0.1)


@compiled
def add_reading(
    found: Any,
    at: Any,
    mean_dbm: Any,
    variance_db2: Any,
    dbm: float,
    offset_db: Any,
    noise_db2: float,
    odds: float,
    trust: float,
) -> None:
    """Adds trust * log(1 + odds * density of a reading) to `found` (N, K) at places (E,), as `GpWifiParams` does."""
    for e in range(len(at)):
        half = 0.5 / (variance_db2[e] + noise_db2)
        peak = odds * math.sqrt(half / math.pi)
        for k in range(len(offset_db)):
            off_db = dbm - mean_dbm[e] - offset_db[k]
            square = off_db * off_db * half
            if square < MAX_SQUARE:
                found[at[e], k] += trust * math.log1p(peak * math.exp(-square))
