"""Fitting by leaving one set out, on errors that are made up."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench_lab.foot_ins.left_out import GRIDS, START, STRATA, Settings, Stratum, fit, loss, params_of

KNEES = GRIDS[0]
TWO = (Stratum("one", "one", "a", "", 0.1), Stratum("two", "two", "b", "", 0.1))


def made_up(settings: Settings) -> list[tuple[np.ndarray, np.ndarray]]:
    """Set one is best at the first knee and set two at the last; no set minds anything else."""
    good = np.ones(2)
    return [
        (0.1 * (1 + abs(settings[0] - KNEES[0])) * np.ones(2), good),
        (0.1 * (1 + abs(settings[0] - KNEES[-1])) * np.ones(2), good),
    ]


def test_the_set_that_is_left_out_has_no_say() -> None:
    assert fit(made_up, TWO, "two")[0] == KNEES[0]
    assert fit(made_up, TWO, "one")[0] == KNEES[-1]


def test_an_error_at_its_gate_costs_one_and_a_wrong_sigma_more() -> None:
    at_gate = np.full(3, 0.1)
    assert loss([(at_gate, np.ones(3)), (at_gate, np.ones(3))], TWO, "") == pytest.approx(1.0)
    high = 2 * 14.449 / 6  # the 97.5 % quantile of chi-square with 6 degrees of freedom
    wrong = loss([(at_gate, np.full(3, 8.0)), (at_gate, np.ones(3))], TWO, "")
    assert wrong == pytest.approx(1 + np.log(8 / high) / 4, rel=1e-3)
    assert loss([(at_gate, np.full(3, 8.0)), (at_gate, np.ones(3))], TWO, "one") == pytest.approx(1.0)


def test_settings_reach_the_filter_in_the_order_of_the_grids() -> None:
    assert all(value in grid for value, grid in zip(START, GRIDS, strict=True))
    params = params_of((0.01, 12.0))
    assert params.detector.knee_fraction == 0.01
    assert params.clipped_sigma_fraction == 12.0
    assert len({stratum.name for stratum in STRATA}) == len(STRATA)
