"""Every registered metric of one walk."""

from __future__ import annotations

import importlib
import math
import warnings
from collections.abc import Collection, Mapping

from pdrbench.building import Building
from pdrbench.geometry import FloatArray
from pdrbench.metrics.hold import hold_at
from pdrbench.metrics.odometry import resampling_times_s
from pdrbench.metrics.table import INPUTS, METRICS
from pdrbench.trajectory import Estimates, Start, Trajectory


def score(
    estimates: Estimates,
    reference: Trajectory,
    building: Building | None,
    fallback: Start,
    *,
    step_s: FloatArray | None = None,
    period_s: float | None = None,
    reset_s: float | None = None,
    missing: Mapping[str, int] | None = None,
    peak_mb: float | None = None,
    names: Collection[str] | None = None,
    mounting: str = "",
) -> dict[str, float]:
    """Scores one walk by every metric of `METRICS`; NaN where one does not apply, infinite a time that never came.

    Args:
        estimates: What the localizer answered.
        reference: All rows; the surveyed ones are scored, the others give the path its shape and length.
        building: The map, or None; heights need it.
        fallback: Where the pedestrian is taken to be before the first answer: the briefed start, else the centre of
            the building.
        step_s: (N,) wall time of each answer, or None.
        period_s: Time between observations, or None.
        reset_s: Wall time of `reset`, or None.
        missing: Count by reason of answers that count as missing, or None.
        peak_mb: Peak memory in 10^6 bytes, or None.
        names: Metrics that are wanted; None: all.
        mounting: Where the sensors were carried, as `Recording.mounting`.
    """
    given = (
        hold_at(estimates, reference.t_s, fallback),
        hold_at(estimates, estimates.t_s, fallback, slack_s=0.0),
        hold_at(estimates, resampling_times_s(reference), fallback),
        *(reference, building, step_s, period_s, reset_s, missing, peak_mb, mounting),
    )
    inputs = dict(zip(INPUTS, given, strict=True))
    scores = {}
    for name in METRICS if names is None else names:
        metric = METRICS[name]
        try:
            module, _, function = metric.target.partition(":")
            compute = getattr(importlib.import_module(module), function)
            scores[name] = float(compute(*(inputs[taken] for taken in metric.takes), **metric.constants))
        except Exception as error:  # a stranger's metric may raise anything: the walk has its other scores
            if metric.target.startswith("pdrbench."):
                raise
            called = ", ".join((*metric.takes, *metric.constants))
            what = f"metric {name!r} has no value: {metric.target}({called}) raised {type(error).__name__}: {error}"
            warnings.warn(what, stacklevel=2)
            scores[name] = math.nan
    return scores
