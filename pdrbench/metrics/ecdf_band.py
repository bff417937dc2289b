"""Confidence band of a distribution of errors, by the spread of whole units."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.metrics.statistics import mean_interval


def ecdf_band(
    errors_by_walk: Mapping[str, FloatArray], unit: Mapping[str, str], at_m: FloatArray
) -> tuple[FloatArray, FloatArray] | None:
    """Pointwise 95 % band of the pooled step function.

    At each place the interval of the fraction of errors up to it, as `statistics.mean_interval` has it.

    Args:
        errors_by_walk: (n,) errors of each walk; walks without errors are left out.
        unit: Unit of each walk, as `Task.units` or its building.
        at_m: (G,) where the band is wanted.

    Returns:
        low: (G,).
        high: (G,).
        None where there are fewer than `statistics.MIN_UNITS` units.
    """
    walks = [walk for walk, values in errors_by_walk.items() if len(values)]
    if not walks:
        return None
    count = np.array([len(errors_by_walk[walk]) for walk in walks])
    at_most = np.stack([np.searchsorted(np.sort(errors_by_walk[walk]), at_m, side="right") for walk in walks])
    units = [unit[walk] for walk in walks]
    low, high = mean_interval(at_most / count[:, None], units, weights=count, scale="fraction")
    return None if np.isnan(low).any() else (low, high)
