"""Step detection of Li et al. 2012 on simulated and recorded people, and the counter made of it."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.inertial.step_detection import STAGES, find_steps
from pdrbench.localizer import Briefing, Observation
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_lab.papers.li2012 import steps as li2012_steps
from pdrbench_lab.papers.ring_floor import bare_ring
from pdrbench_lab.step_count import StepCount, StepCountParams
from pdrbench_sim.people.route import navigation_mesh


def test_every_stage_leaves_fewer_false_steps():
    found = li2012_steps.handling(0, people=3, duration_s=120.0)
    counts = [found[f"count_{stage}"] for stage in STAGES]
    assert counts[0] > 2 * counts[1] > 2 * counts[2] > 0
    assert found["share_PD"] == 1.0
    assert found["per_min_PD"] == pytest.approx(counts[0] / 6)
    assert found["share_PD+H"] == pytest.approx(counts[1] / counts[0])


def test_the_same_seed_gives_the_same_numbers_and_another_one_others():
    one, same, other = (li2012_steps.handling(seed, people=1, duration_s=60.0) for seed in (1, 1, 2))
    assert one == same != other


def test_a_walk_round_the_corridor_is_known_step_by_step():
    phones, heel_s = li2012_steps.walked(np.random.default_rng(4), navigation_mesh(bare_ring()), 1, 10.0)
    assert set(phones) == {"hand", "pocket"}
    assert (heel_s > 10.0).all() and 80 < len(heel_s) < 180  # 92 m
    gaps_s = np.diff(heel_s)
    assert np.median(gaps_s) == pytest.approx(0.52, abs=0.12) and gaps_s.min() > 0.3
    for rows in phones.values():
        assert (np.diff(rows[:, 0]) > 0).all() and np.diff(rows[:, 0]).max() < 0.05
        steps = find_steps(rows, 50.0, stage="PD+H")
        assert (steps.peak_s > 10.0).sum() == pytest.approx(len(heel_s), abs=0.1 * len(heel_s))


def test_false_and_missed_steps_of_walks():
    found = li2012_steps.walking(0, people=2, laps=1)
    for place in li2012_steps.CARRIED:
        false = [found[f"false_pct_{stage}_{place}"] for stage in STAGES]
        missed = [found[f"missed_pct_{stage}_{place}"] for stage in STAGES]
        assert false[0] > false[1] >= false[2] >= 0
        assert 0 <= missed[0] <= missed[1] <= missed[2] < 10


def test_recorded_steps_in_all_positions(data_root):
    if not (data_root / "phone_steps").is_dir():
        pytest.skip("phone_steps not found")
    found = li2012_steps.recorded(0)
    assert len(found["f1"]) == 36
    assert found["count_size_pct"].mean() <= 1.3 and found["raw_size_pct"].mean() <= 2.0
    assert found["f1"].mean() >= 0.98
    assert all(found[f"f1_{name}"] >= 0.97 for name in ("InHand", "Purse", "Armband", "FrontPocket", "BackPocket"))


def accel_rows(steps: int) -> np.ndarray:
    """A phone that rests, then sees so many steps of half a second, then rests."""
    t_s = np.arange(0.0, 4.0 + 0.5 * steps, 0.02)
    walks = (t_s >= 2.0) & (t_s < 2.0 + 0.5 * steps)
    length = 9.81 - 3.0 * walks * np.sin(4 * np.pi * t_s)
    return np.column_stack([t_s, np.zeros((len(t_s), 2)), length])


def briefing(heading_rad: float | None) -> Briefing:
    start = Start(xy_m=np.array([3.0, 4.0]), level=2, heading_rad=heading_rad)
    return Briefing(building=None, sensors={"accel": sensor_spec("accel")}, period_s=0.5, start=start)


@pytest.mark.parametrize(("heading_rad", "ahead"), [(None, (1.0, 0.0)), (np.pi / 2, (0.0, 1.0))])
def test_a_metre_a_step_along_the_heading(heading_rad, ahead, rng):
    rows, counter = accel_rows(20), StepCount(StepCountParams(adapts=False))
    counter.reset(briefing(heading_rad), rng)
    for part in np.array_split(rows, 28):
        answer = counter.step(Observation(float(part[-1, 0]), {"accel": part}))
    count = np.dot(answer.xy_m - [3.0, 4.0], ahead)
    assert count == pytest.approx(20, abs=2) and answer.level == 2
    np.testing.assert_allclose(answer.xy_m - [3.0, 4.0], np.round(count) * np.array(ahead), atol=1e-9)
    table = counter.revise()
    assert (np.diff(table[:, 0]) > 0).all() and (table[:, 3] == 2).all()
    np.testing.assert_allclose((table[:, 1:3] - [3.0, 4.0]) @ ahead, np.arange(len(table)), atol=1e-9)
    np.testing.assert_allclose(np.diff(table[1:, 0]), 0.5, atol=0.03)
    counter.reset(briefing(heading_rad), rng)
    np.testing.assert_array_equal(counter.step(Observation(0.0, {"accel": rows[:0]})).xy_m, [3.0, 4.0])
