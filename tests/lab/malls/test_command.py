"""Figures on the malls: how dense a survey is, what plans get wrong, what a walk's own session is worth."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from pdrbench.registry import make_task
from pdrbench_envs.malls.environment import played_walks
from pdrbench_envs.malls.splits import walks
from pdrbench_lab.malls import own_session
from pdrbench_lab.malls.pairing import clustered_mean
from pdrbench_lab.malls.plans import obstacles_m
from pdrbench_lab.malls.steps import SteppedWalk, fitted, rows_left_out


def test_what_a_leg_has_outside_the_walkable_area_is_its_obstacle() -> None:
    hall = shapely.box(0, 0, 10, 10).difference(shapely.box(4, 4, 6, 6))
    xy_m = np.array([[1.0, 5.0], [9.0, 5.0], [9.0, 1.0], [13.0, 4.0], [5.0, 5.0]])
    # Through the block 2 m; none; out of the hall at a slope of 3 / 4: from x = 10 to 13; back in at y = 5 - 3 / 8
    last_m = math.hypot(8, 1) * (3 + 1) / 8  # outside from x = 13 to 10, in the block from x = 6 to 5
    np.testing.assert_allclose(obstacles_m(hall, xy_m), [2.0, 0.0, 3.75, last_m])


def test_the_standard_error_takes_units_together(rng: np.random.Generator) -> None:
    values = rng.normal(size=12)
    mean, apart = clustered_mean(values, [str(k) for k in range(12)])
    assert (mean, apart) == pytest.approx((values.mean(), values.std(ddof=1) / math.sqrt(12)))
    twice = clustered_mean(np.repeat(values, 3), [str(k) for k in range(12) for _ in range(3)])
    assert twice == pytest.approx((mean, apart))  # what is repeated within a unit adds nothing
    weighted = clustered_mean(values, [str(k) for k in range(12)], np.full(12, 3.0))
    assert weighted == pytest.approx((mean, apart))
    assert math.isnan(clustered_mean(values, ["one"] * 12)[1])


def test_length_and_turn_of_steps_are_found_and_left_out_by_fold(rng: np.random.Generator) -> None:
    made = []
    for number in range(10):
        count = np.full(6, 8.0)
        steps = 8.0 * np.exp(1j * rng.uniform(-3, 3, 6))
        made.append(SteppedWalk("here", str(number), number % 2, 0.7 * np.exp(0.1j) * steps, steps, count))
        made[-1].steps[3] /= 2.0  # of a leg with a detour, which is left out of the fit
    assert fitted(made) == pytest.approx((0.7, 0.1))
    rows = {row["dead reckoning"]: float(row["mean error"].removesuffix(" m")) for row in rows_left_out(made)}
    detour_m = 0.7 * 4.0 / 2.0  # what half the steps of that leg miss, at three of six places
    assert rows["both fitted"] == pytest.approx(detour_m, abs=0.01)
    assert rows["both fitted"] < min(rows["length fitted"], rows["turn fitted"])


@pytest.fixture
def full(data_root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PDRBENCH_DATA", str(data_root))
    if not (data_root / "ilc20_full").is_dir():
        pytest.skip("ilc20_full is not under PDRBENCH_DATA")


def test_the_survey_of_test_is_counted_by_group_and_floor(full: None, command: Any) -> None:
    found = json.loads(command("malls", "survey", "--json").out)
    parts = {row["part"]: row for row in found["parts"]}
    assert parts["test, unseen floor"]["> 10 m"] == 1.0 and parts["test, unseen floor"]["median_m"] is None
    assert sum(row["walks"] for name, row in parts.items() if name.startswith("test")) == 150
    assert sum(row["walks"] for row in found["floors"]) == 150 - parts["test, unseen floor"]["walks"]
    assert sum(row["scans"] for row in found["floors"]) == parts["test, known floor"]["scans"]
    assert all(row["0-3 m"] + row["3-10 m"] + row["> 10 m"] == pytest.approx(1.0, abs=0.011) for row in found["floors"])


def test_faults_of_plans_are_counted_and_no_test_walk_is_named(full: None, command: Any) -> None:
    found = json.loads(command("malls", "plans", "--json").out)
    total = found["floors"][-1]
    assert total["walks"] == 698
    assert total["legs through > 0.5 m"] / total["legs"] == pytest.approx(0.03, abs=0.005)  # as the set's notes say
    assert found["walks"] and not any(walk.startswith("test") for walk in found["walks"])


def test_with_its_own_session_a_survey_has_the_other_walks_of_that_and_no_more(full: None) -> None:
    task, other = make_task("MallPhone-v2"), make_task(f"{own_session.__file__}:known")
    walk = max(task.split("val"), key=lambda walk: len(others(walk)))
    recording = task.load(walk)
    without, within = task.radio_map(recording), other.radio_map(other.load(walk))
    assert without is not None and within is not None
    added = {row.tobytes() for row in within.xy_m} - {row.tobytes() for row in without.xy_m}
    assert 0 < len(added) <= len(within) - len(without)
    assert len(np.unique(within.walk)) - len(np.unique(without.walk)) == len(others(walk))


def others(walk: str) -> list[str]:
    played = played_walks()[walk]
    return [each.path for each in walks() if each.session == played.session and each.path != played.path]
