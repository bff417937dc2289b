"""Values of claims from one number per walk."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from pdrbench.metrics.statistics import mean_interval
from pdrbench.registry import registered_task
from pdrbench_lab.reproduce.experiments import plan_experiments
from pdrbench_lab.reproduce.reproduction import (
    ClaimError,
    Experiment,
    mean_over_walks,
    median_over_walks,
    ratio_over_seeds,
)


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


def test_walks_of_one_building_count_as_one(rng: np.random.Generator) -> None:
    """Ten buildings with an offset each, of 20 walks: as wide as ten walks, not as two hundred."""
    building = np.repeat(np.arange(10), 20)
    offset = rng.normal(0.0, 1.0, 10)
    runs = [{"error_m": offset[building] + 1e-3 * rng.normal(size=200), "building": building.astype(float)}]
    by_building = mean_over_walks("error_m", "building")(runs)
    low, high = mean_interval(offset)
    assert (by_building.low, by_building.high) == pytest.approx((low, high), abs=1e-3)
    by_walk = mean_over_walks("error_m")(runs)
    assert by_building.high - by_building.low > 3 * (by_walk.high - by_walk.low)
    median = median_over_walks("error_m", "building")(runs)
    assert median.low < median.ours < median.high
    assert median.high - median.low > 0.5  # of independent walks it would be some 0.2
    three = {name: np.asarray(values)[:60] for name, values in runs[0].items()}
    for value in (mean_over_walks, median_over_walks):
        assert math.isnan(value("error_m", "building")([three]).low)
    runs[0]["error_m"][0] = math.nan
    assert mean_over_walks("error_m", "building")(runs).ours == pytest.approx(by_building.ours, abs=0.02)
    with pytest.raises(ClaimError, match="'error_m' holds 200 walks and 'few' the units of 3"):
        mean_over_walks("error_m", "few")([{**runs[0], "few": np.zeros(3)}])


def test_the_ratio_of_means_has_the_interval_of_the_delta_method() -> None:
    same = [{"one": value, "other": 2 * value} for value in (1.0, 2.0, 4.0, 3.0)]
    found = ratio_over_seeds("one", "other")(same)
    assert (found.ours, found.low, found.high) == pytest.approx((0.5, 0.5, 0.5))
    runs = [{"one": one, "other": 4.0} for one in (1.0, 2.0, 4.0, 3.0)]  # of a constant: the interval of the mean
    low, high = mean_interval([one["one"] / 4.0 for one in runs])
    found = ratio_over_seeds("one", "other")(runs)
    assert (found.ours, found.low, found.high) == pytest.approx((0.625, low, high))


def test_seeds_are_averaged_before_walks_and_missing_values_are_left_out() -> None:
    runs = [{"error_m": np.array([1.0, 5.0, math.nan])}, {"error_m": np.array([3.0, 5.0, 2.0])}]
    assert mean_over_walks("error_m")(runs).ours == pytest.approx(3.5)
    assert median_over_walks("error_m")(runs).ours == pytest.approx(3.5)
    nothing = [{"error_m": np.full(3, math.nan)}]
    assert math.isnan(mean_over_walks("error_m")(nothing).ours) and math.isnan(median_over_walks("error_m")([]).ours)


def test_seeds_that_differ_in_walks_are_refused() -> None:
    with pytest.raises(ClaimError, match=r"'error_m' holds \[2, 3\] numbers"):
        mean_over_walks("error_m")([{"error_m": np.zeros(2)}, {"error_m": np.zeros(3)}])


def test_the_experiments_of_a_seed_follow_one_another_and_what_is_timed_comes_last() -> None:
    experiments = [Experiment("clock", "m:f", 1, 1, alone=True), *(Experiment(name, "m:f", 2, 1) for name in "ab")]
    jobs = plan_experiments(experiments, {"clock": 1, "a": 2, "b": 2}, ())
    assert [(job.family, job.seed) for job in jobs] == [("a", 0), ("b", 0), ("a", 1), ("b", 1), ("clock", 0)]


def test_other_recordings_are_measured_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def keys() -> tuple[str, str]:
        registered_task.cache_clear()  # a new process
        experiments = Experiment("loops", "m:f", 1, 1, envs=("FootLoops-v1",)), Experiment("steps", "m:f", 1, 1)
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
