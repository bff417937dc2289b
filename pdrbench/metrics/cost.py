"""What an answer costs: wall time as the evaluating side measured it, and memory.

Never compared across machines without the machine in the table.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.metrics.position import PercentileMethod, percentile


def step_percentile_ms(
    step_s: FloatArray | None, *, quantile: float = 0.5, method: PercentileMethod = "hazen"
) -> float:
    """Percentile of the wall time per step in milliseconds, from (N,) seconds, NaN where not measured.

    `quantile` 1.0 is the slowest step.
    """
    return 1000.0 * percentile(_measured(step_s), quantile, method)


def realtime_factor(step_s: FloatArray | None, period_s: float | None) -> float:
    """Computing time over walking time: sum step_s / (N period_s); below 1 it keeps up."""
    measured_s = _measured(step_s)
    if period_s is None or not len(measured_s):
        return math.nan
    return float(measured_s.sum() / (len(measured_s) * period_s))


def startup_s(reset_s: float | None) -> float:
    """Wall time of `reset` in seconds."""
    return math.nan if reset_s is None else float(reset_s)


def missed(missing: Mapping[str, int] | None) -> float:
    """Number of observations whose answer counts as missing, for whatever reason: late, NaN, wrong shape, nothing."""
    return math.nan if missing is None else float(sum(missing.values()))


def peak_mb(peak_mb: float | None) -> float:
    """Peak memory of the localizer in 10^6 bytes, where it was measured."""
    return math.nan if peak_mb is None else float(peak_mb)


def _measured(step_s: FloatArray | None) -> FloatArray:
    values = np.zeros(0) if step_s is None else np.asarray(step_s, dtype=np.float64)
    return values[np.isfinite(values)]
