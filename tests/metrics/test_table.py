"""The table of metrics: complete, consistent, light."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import math
import re
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from pdrbench.metrics import METRICS, POOLED, Metric, pooled, score
from pdrbench.metrics.statistics import SUMMARIES
from pdrbench.metrics.table import check_metric as check_metric_of_others
from pdrbench.registry import PluginError
from pdrbench.trajectory import Estimates, Start, Trajectory

# `make_walk` ends elsewhere, too early, is never lost, and turns by less than a radian
TOO_SHORT = {"loop_closure_pct", "converged_120s", "recovery_s", "eag_turn_mprad"}
HEADING = {name for name in METRICS if name.startswith("heading_")}
UNITS = {
    **{"m": "m", "s": "s", "ms": "ms", "pct": "%", "mb": "MB"},
    **{"deg": "°", "degpmin": "°/min", "mps": "m/s", "mprad": "m/rad"},
}


def function_of(metric: Metric) -> Callable[..., object]:
    module, _, name = metric.target.partition(":")
    function: Callable[..., object] = getattr(importlib.import_module(module), name)
    return function


def test_metrics_fit_their_functions() -> None:
    for metric in (*METRICS.values(), *POOLED.values()):
        check_metric(metric, function_of(metric))


def check_metric(metric: Metric, function: Callable[..., object]) -> None:
    parameters = inspect.signature(function).parameters
    constants = {
        name: parameter.default
        for name, parameter in parameters.items()
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY and name != "wrong_building"
    }
    assert set(metric.constants) <= set(constants), metric.name
    # one function computes all pooled scores, of which only the percentiles have a method
    assert set(metric.constants) == set(constants) or metric.name in POOLED, "every constant is printed with the score"
    assert all(default is not inspect.Parameter.empty for default in constants.values()), metric.name
    assert inspect.getdoc(function), metric.name
    assert metric.better in ("lower", "higher", "none") and metric.over_walks in SUMMARIES, metric.name
    unit = UNITS.get(metric.name.rpartition("_")[2], "")
    assert metric.unit == unit or metric.name.startswith("success_")


def test_pooled_returns_what_the_table_says() -> None:
    assert set(pooled([np.ones(3)])) == set(POOLED)


def make_walk() -> tuple[Estimates, Trajectory]:
    t_s = np.arange(120.0)
    xy_m = np.column_stack([t_s, np.sin(t_s / 10)])
    reference = Trajectory(t_s, xy_m, (t_s > 60).astype(int), np.ones(120, bool), z_m=3.5 * (t_s > 60))
    unclaimed = np.full(120, math.nan)
    return Estimates(
        t_s, xy_m + np.array([3.0, 4.0]), (t_s > 63).astype(float), unclaimed, unclaimed, unclaimed
    ), reference


def test_score_returns_every_metric(two_levels: object) -> None:
    estimates, reference = make_walk()
    estimates = dataclasses.replace(
        estimates, heading_rad=np.full(120, 0.5), sigma_m=np.full(120, 2.5), converged=np.ones(120)
    )
    reference = dataclasses.replace(reference, heading_rad=np.zeros(120))
    scores = score(
        estimates,
        reference,
        two_levels,
        Start(xy_m=np.zeros(2), level=0),
        step_s=np.full(120, 0.002),
        period_s=1.0,
        reset_s=0.25,
        missing={"nan": 2},
        peak_mb=80.0,
    )
    assert list(scores) == list(METRICS)
    assert {name for name, value in scores.items() if math.isnan(value)} == TOO_SHORT
    assert all(type(value) is float for value in scores.values())
    assert scores["ate_m"] == pytest.approx(5.0)
    assert scores["level_change_delay_s"] == 3.0
    assert scores["level_hit_rate"] == pytest.approx(117 / 120)
    assert scores["ve95_m"] == pytest.approx(0.0, abs=1e-9)
    assert scores["step_max_ms"] == pytest.approx(2.0)
    assert scores["anees"] == pytest.approx(2.0)
    assert scores["converged_p75_m"] == pytest.approx(5.0)
    assert scores["heading_mean_deg"] == pytest.approx(math.degrees(0.5))
    assert scores["outside_pct"] > 0
    assert (scores["startup_s"], scores["missed"], scores["peak_mb"], scores["availability"]) == (0.25, 2, 80, 1)


def test_score_needs_nothing_but_positions() -> None:
    estimates, reference = make_walk()
    scores = score(estimates, reference, None, Start(xy_m=np.zeros(2), level=0))
    assert list(scores) == list(METRICS)
    unknown = {name for name, value in scores.items() if math.isnan(value)}
    families = ("cost", "claimed convergence", "uncertainty", "map")
    needy = {name for name, metric in METRICS.items() if metric.family in families}
    assert unknown == needy | TOO_SHORT | HEADING | {"ve50_m", "ve95_m", "se50_m", "se95_m", "availability"}


def test_score_of_nothing_surveyed_is_nan() -> None:
    estimates, reference = make_walk()
    unscored = Trajectory(reference.t_s, reference.xy_m, reference.level, np.zeros(120, bool))
    scores = score(estimates, unscored, None, Start(xy_m=np.zeros(2), level=0), period_s=1.0)
    assert {name for name, value in scores.items() if not math.isnan(value)} == {"n"}


def test_a_strangers_metric_that_raises_leaves_the_walk_its_other_scores(monkeypatch: pytest.MonkeyPatch) -> None:
    from pdrbench.metrics import scoring

    broken = Metric("within_door_m", "m", "lower", "position", "Mine.", "math:hypot", takes=("held",))
    monkeypatch.setattr(scoring, "METRICS", {"mean_m": METRICS["mean_m"], "within_door_m": broken})
    still = Trajectory([0.0, 1.0], [[0, 0], [3, 4]], [0, 0], [False, True])
    answers = Estimates.from_columns(np.array([0.0]), np.array([[0.0], [0.0], [0.0], [np.nan], [np.nan], [np.nan]]))
    with pytest.warns(UserWarning, match=r"'within_door_m' has no value: math:hypot\(held\) raised TypeError"):
        scores = scoring.score(answers, still, None, Start(np.zeros(2), 0))
    assert scores["mean_m"] == pytest.approx(5.0) and np.isnan(scores["within_door_m"])


@pytest.mark.parametrize(
    ("changes", "why"),
    [
        ({"better": "smaller"}, "Invalid enum value 'smaller'"),
        ({"name": "other_m"}, "calls itself 'other_m'"),
        ({"target": "math:no_such"}, "no_such"),
        ({"takes": ("held",)}, "missing a required argument: 'reference'"),
        ({"constants": {"quantil": 0.5}}, "unexpected keyword argument 'quantil'"),
        ({"takes": ("held", "truth")}, "takes 'truth'; a metric can take held, answered"),
    ],
)
def test_a_strangers_metric_that_is_wrong_is_refused(changes: dict[str, Any], why: str) -> None:
    good = dataclasses.replace(METRICS["p75_m"], name="mine_m")
    check_metric_of_others("mine_m", good)
    with pytest.raises(PluginError, match=re.escape(why)):
        check_metric_of_others("mine_m", dataclasses.replace(good, **changes))
    with pytest.raises(PluginError, match=re.escape("is int, not a pdrbench.metrics.Metric")):
        check_metric_of_others("mine_m", 3)
