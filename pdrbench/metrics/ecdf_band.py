"""Confidence band of a distribution of errors, from resampled walks."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.metrics.statistics import CONFIDENCE, MIN_WALKS

DRAWS: Final = 2000  # resamples of the band; the edge of a 95 % band then moves by under 1 % of its width


def ecdf_band(
    errors_by_walk: Mapping[str, FloatArray], site: Mapping[str, str], at_m: FloatArray, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray] | None:
    """Pointwise 95 % percentile band of the pooled step function, from resampled walks.

    Walks are drawn with replacement within each building, since the positions of one walk depend on each other.

    Args:
        errors_by_walk: (n,) errors of each walk; walks without errors are left out. Below five walks the answer is
            None.
        site: Building of each walk; resampling keeps the number of walks of each.
        at_m: (G,) where the band is wanted.
        rng: Draws the walks.

    Returns:
        low: (G,).
        high: (G,).
    """
    walks = [walk for walk, values in errors_by_walk.items() if len(values)]
    if len(walks) < MIN_WALKS:
        return None
    at_most = np.stack([np.searchsorted(np.sort(errors_by_walk[walk]), at_m, side="right") for walk in walks])
    count = np.array([len(errors_by_walk[walk]) for walk in walks])
    where = np.array([site[walk] for walk in walks])
    times = np.zeros((DRAWS, len(walks)))
    for name in np.unique(where):
        members = np.flatnonzero(where == name)
        times[:, members] = rng.multinomial(len(members), np.full(len(members), 1 / len(members)), size=DRAWS)
    fractions = (times @ at_most) / (times @ count)[:, None]
    tail = (1 - CONFIDENCE) / 2
    low, high = np.quantile(fractions, [tail, 1 - tail], axis=0)
    return low, high
