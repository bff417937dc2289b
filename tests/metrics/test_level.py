"""Levels: hits, confusion, delay."""

from __future__ import annotations

import math

import numpy as np
import pytest
from tracks import make_answers, make_reference

from pdrbench.metrics import hold_at
from pdrbench.metrics.hold import Held
from pdrbench.metrics.level import level_change_delay_s, level_change_delays_s, level_changes_missed, level_hit_rate
from pdrbench.trajectory import Start, Trajectory


def walk(true: list[int], estimated: list[float], surveyed: object = True) -> tuple[Held, Trajectory]:
    """A walk of one row every two seconds."""
    nowhere = np.zeros((len(true), 2))
    reference = make_reference(nowhere, true, surveyed, t_s=2.0 * np.arange(len(true)))
    estimates = make_answers(reference.t_s, nowhere, estimated)
    return hold_at(estimates, reference.t_s, Start(xy_m=np.zeros(2), level=0)), reference


def test_delays_run_to_the_first_agreement_and_a_change_never_seen_costs_the_stay() -> None:
    held, reference = walk([0, 0, 1, 1, 1, 0, 0], [0, 0, 0, 0, 1, 0, 0])
    delay_s, missed = level_change_delays_s(held, reference)
    assert delay_s.tolist() == [4.0, 0.0]
    assert missed.tolist() == [0.0, 0.0]
    assert level_change_delay_s(held, reference) == 2.0
    held, reference = walk([0, 1, 1, 1, 0, 0, 0], [0] * 7)
    assert level_change_delays_s(held, reference)[0].tolist() == [6.0, 0.0]
    assert level_changes_missed(held, reference) == 0.5
    held, reference = walk([0, 1, 1, 1], [0] * 4)  # the last stay ends with the walk
    assert level_change_delay_s(held, reference) == 4.0
    assert level_changes_missed(held, reference) == 1.0


def test_a_change_in_the_last_row_and_an_early_change_have_no_delay() -> None:
    held, reference = walk([0, 1, 1, 2], [0, 0, 1, 1])
    assert level_change_delays_s(held, reference)[0].tolist() == [2.0]
    held, reference = walk([0, 0, 1, 1], [0, 1, 1, 1])
    assert level_change_delay_s(held, reference) == 0.0
    assert level_hit_rate(held, reference) == 0.75


@pytest.mark.parametrize("metric", [level_change_delay_s, level_changes_missed])
def test_a_walk_on_one_level_has_no_delay(metric: object) -> None:
    assert callable(metric)
    assert math.isnan(metric(*walk([2, 2], [2, 2])))
