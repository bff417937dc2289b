"""Swings are counted in what motion capture saw of a foot."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.trajectory import Trajectory
from pdrbench_lab.foot_ins.swings import num_swings
from pdrbench_sim.foot.known_walk import walk


@pytest.mark.parametrize(("length_m", "number"), [(1.3, 9), (0.2, 9), (0.0, 0)])
def test_a_swing_that_leads_somewhere_counts_once(length_m: float, number: int) -> None:
    motion = walk(9, length_m=length_m, lift_m=0.3)
    count = len(motion)
    places = motion.position_m
    reference = Trajectory(
        motion.t_s, places[:, :2], np.zeros(count, np.int64), np.ones(count, np.bool_), z_m=places[:, 2]
    )
    assert num_swings(reference) == number
