"""Costs in closed form."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench.metrics.cost import missed, peak_mb, realtime_factor, startup_s, step_percentile_ms


def test_step_times_are_in_milliseconds_beside_realtime_factor_and_missing_answers() -> None:
    step_s = np.array([0.001, 0.002, 0.003, 0.004])
    assert step_percentile_ms(step_s, quantile=0.5) == pytest.approx(2.5)
    assert step_percentile_ms(step_s, quantile=0.75) == pytest.approx(3.5)
    assert step_percentile_ms(step_s, quantile=1.0) == pytest.approx(4.0)
    assert realtime_factor(np.array([0.01, 0.03]), 0.2) == pytest.approx(0.1)
    assert missed({"nan": 3, "late": 2}) == 5.0
    assert missed({}) == 0.0


def test_unknown_costs_are_nan() -> None:
    assert math.isnan(step_percentile_ms(None))
    assert math.isnan(step_percentile_ms(np.full(3, math.nan)))
    assert math.isnan(realtime_factor(None, 0.2))
    assert math.isnan(realtime_factor(np.array([0.1]), None))
    assert math.isnan(startup_s(None))
    assert math.isnan(missed(None))
    assert math.isnan(peak_mb(None))
