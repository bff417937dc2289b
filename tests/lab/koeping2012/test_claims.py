"""The claims of Köping et al. 2012; deterministic ones are measured in one walk."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench_lab.papers.koeping2012 import experiments
from pdrbench_lab.papers.koeping2012.claims import REPRODUCTION
from pdrbench_lab.papers.koeping2012.linear import linear_walk
from pdrbench_lab.reproduce.experiments import plain_numbers


def test_every_claim_of_the_paper_is_listed() -> None:
    assert {claim.id for claim in REPRODUCTION.claims} == {"K2", *(f"K{number}" for number in range(4, 13))}


def numbers_of(name: str) -> dict:
    found = plain_numbers(getattr(experiments, name)(0))
    return {key: np.array(value) if isinstance(value, list) else value for key, value in found.items()}


@pytest.mark.parametrize("name", ["table"])
def test_deterministic_claims_hold_for_one_walk(name: str) -> None:
    numbers = numbers_of(name)
    for claim in REPRODUCTION.claims:
        if claim.experiment == name and claim.gate is not None and claim.id != "K5":  # variances: 5 % of one seed
            assert claim.gate.holds(claim.value([numbers]).ours), claim.what


def test_the_straight_walk_pauses_where_the_paper_does_and_ends_at_14_m() -> None:
    walk = linear_walk(np.random.default_rng([0, 10]))
    assert walk.true_m[0] == pytest.approx(0.0, abs=1e-6) and walk.true_m[-1] == pytest.approx(14.0, abs=1e-3)
    for stop_m in (4.0, 9.0):
        at_rest = walk.t_s[np.abs(walk.true_m - stop_m) < 0.02]
        assert 5.0 < np.ptp(at_rest) < 8.0
    assert walk.end_error_m("raw_m") > 5.0 > walk.end_error_m("corrected_m") > walk.end_error_m("updated_m")


def test_straight_walks_are_the_same_for_the_same_seed() -> None:
    one, same = (linear_walk(np.random.default_rng(4)) for _ in range(2))
    assert one.corrected_m.tobytes() == same.corrected_m.tobytes() and one.on_foot_m == same.on_foot_m
