"""Values of claims from one number per walk."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pdrbench.evaluation.experiments import plan_experiments
from pdrbench.evaluation.reproduction import ClaimError, Experiment, mean_over_walks, median_over_walks
from pdrbench.metrics.statistics import mean_interval
from pdrbench.registry import registered_task


def test_the_mean_over_walks_has_the_interval_of_the_tables(rng: np.random.Generator) -> None:
    values = rng.exponential(size=12)
    found = mean_over_walks("error_m")([{"error_m": values}])
    assert found.ours == pytest.approx(values.mean())
    again = mean_over_walks("error_m")([{"error_m": values[::-1]}])
    assert (found.low, found.high) == pytest.approx((again.low, again.high))
    low, high = mean_interval(values)
    assert (found.low, found.high) == (low, high)


def test_the_median_over_walks_lies_between_two_of_them() -> None:
    found = median_over_walks("error_m")([{"error_m": np.array([5.0, 1.0, 3.0, 2.0, 6.0, 4.0])}])
    assert (found.ours, found.low, found.high) == (3.5, 1.0, 6.0)  # six: 1 - 2 / 2^6 = 97 %, the least above 95 %
    few = median_over_walks("error_m")([{"error_m": np.arange(5.0)}])
    assert few.ours == 2.0 and math.isnan(few.low)


def test_seeds_are_averaged_before_walks_and_missing_values_are_left_out() -> None:
    runs = [{"error_m": np.array([1.0, 5.0, math.nan])}, {"error_m": np.array([3.0, 5.0, 2.0])}]
    assert mean_over_walks("error_m")(runs).ours == pytest.approx(3.5)
    assert median_over_walks("error_m")(runs).ours == pytest.approx(3.5)
    nothing = [{"error_m": np.full(3, math.nan)}]
    assert math.isnan(mean_over_walks("error_m")(nothing).ours) and math.isnan(median_over_walks("error_m")([]).ours)


def test_seeds_that_differ_in_walks_are_refused() -> None:
    with pytest.raises(ClaimError, match=r"'error_m' holds \[2, 3\] numbers"):
        mean_over_walks("error_m")([{"error_m": np.zeros(2)}, {"error_m": np.zeros(3)}])


def test_other_recordings_are_measured_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def keys() -> tuple[str, str]:
        registered_task.cache_clear()  # a new process
        experiments = Experiment("loops", "m:f", 1, 1, envs=("FootLoops-v0",)), Experiment("steps", "m:f", 1, 1)
        recorded, synthetic = plan_experiments(experiments, {"loops": 1, "steps": 1}, ())
        return recorded.key, synthetic.key

    monkeypatch.delenv("PDRBENCH_DATA", raising=False)
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    before = keys()
    other = tmp_path / "foot_loops" / "Measurement_1" / "data_inert.txt"
    other.parent.mkdir(parents=True)
    other.write_text("another loop\n")
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path))
    after = keys()
    registered_task.cache_clear()
    assert before[0] != after[0] and before[1] == after[1]
