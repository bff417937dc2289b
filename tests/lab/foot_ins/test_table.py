"""The table of all feet: what disturbances do, and what is chosen with a set left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pdrbench.trajectory import Trajectory
from pdrbench_lab.foot_ins.experiments import FootWalk
from pdrbench_lab.foot_ins.table import CLIP_RADPS, DISTURBANCES, FILTERS, chosen_without, line, scores
from pdrbench_sim.foot.known_walk import walk


def a_walk() -> FootWalk:
    motion = walk(20)
    xy_m, nought = motion.position_m[:, :2], np.zeros(len(motion.t_s), dtype=np.int64)
    reference = Trajectory(motion.t_s, xy_m, nought, nought == 0)
    return FootWalk(Path("walk"), motion.t_s, motion.accel, motion.gyro, reference)


def test_disturbances_do_what_they_say() -> None:
    whole = a_walk()
    changed = {name: disturb(whole) for name, disturb in DISTURBANCES.items()}
    assert changed["whole"] is whole
    assert np.diff(changed["gap_0.6"].t_s).max() > 0.6 > np.diff(changed["gap_0.2"].t_s).max() > 0.2
    assert np.abs(changed["clipped"].gyro).max() <= CLIP_RADPS
    assert (np.diff(changed["repeated"].gyro, axis=0) == 0).all(axis=1).sum() > (
        (np.diff(whole.gyro, axis=0) == 0).all(axis=1).sum()
    )
    assert len(changed["lost"].t_s) < len(changed["repeated"].t_s) == len(whole.t_s)
    assert all((np.diff(one.t_s) >= 0).all() and len(one.t_s) == len(one.gyro) for one in changed.values())


def test_a_line_has_error_and_share_of_each_set() -> None:
    found = scores({"walks": {"one": [a_walk()]}}, FILTERS["robust"])
    error, inside = found["walks"]["one"][0]
    assert error < 0.2 and inside > 0.9
    assert f"{error:.3f} ({100 * inside:.0f})" in line("robust", found)


def test_the_set_that_is_left_out_has_no_voice() -> None:
    def of(walks_m: float, loops_pct: float) -> dict[str, dict[str, np.ndarray]]:
        return {"walks": {"one": np.array([[walks_m, 1.0]])}, "loops": {"one": np.array([[loops_pct, 1.0]])}}

    assert chosen_without({"a": of(0.3, 0.9), "b": of(0.6, 0.1)}) == {"walks": "b", "loops": "a"}
