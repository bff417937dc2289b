"""Scores over all samples of all walks together, which are not means over walks and have names of their own."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.metrics.position import PercentileMethod, mean, percentile, rms


def pooled(
    errors_by_walk_m: Sequence[FloatArray],
    penalised_by_walk_m: Sequence[FloatArray] = (),
    *,
    method: PercentileMethod = "hazen",
) -> dict[str, float]:
    """Scores of the errors of all walks together; a walk counts by its number of surveyed positions.

    Samples of one walk depend on each other: an interval comes from whole units
    (`statistics.quantile_interval`), never from samples.

    Args:
        errors_by_walk_m: (n,) errors of each walk, as `errors_m` returns them; the order does not matter.
        penalised_by_walk_m: The same with penalties, as `penalised_errors_m` returns them.
        method: How percentiles are interpolated.

    Returns:
        Value by the names in `POOLED`; NaN where there are no errors.

    >>> pooled([np.array([1.0]), np.array([3.0, 5.0])])["pooled_mean_m"]
    3.0
    """
    errors_m = np.sort(np.concatenate([*errors_by_walk_m, np.zeros(0)]))
    penalised_m = np.concatenate([*penalised_by_walk_m, np.zeros(0)])
    return {
        "pooled_mean_m": mean(errors_m),
        "pooled_rmse_m": rms(errors_m),
        **{f"pooled_p{percent}_m": percentile(errors_m, percent / 100, method) for percent in (50, 75, 90, 95)},
        "pooled_p75_level_penalised_m": percentile(penalised_m, 0.75, method),
        "pooled_max_m": float(errors_m[-1]) if len(errors_m) else math.nan,
        "pooled_n": float(len(errors_m)),
    }
