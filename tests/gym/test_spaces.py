from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import EstimateError, UnknownNameError
from pdrbench.gym.spaces import make_action_space, make_observation_space, to_action
from pdrbench.localizer import Estimate


def test_observation_space_is_fixed_and_finite(phone_task) -> None:
    space = make_observation_space(phone_task)
    expected = {"now_s": (1,)}
    for spec in phone_task.sensors:
        expected[spec.name] = (phone_task.capacity[spec.name], len(spec.columns))
        expected[f"{spec.name}_count"] = (1,)
    assert {key: box.shape for key, box in space.items()} == expected
    for box in space.values():
        assert box.dtype == np.float64
        assert np.isfinite(box.low).all() and np.isfinite(box.high).all()


def test_action_space_grows_with_claims_and_refuses_foreign_and_doubled_ones() -> None:
    assert make_action_space(()).shape == (3,)
    every = make_action_space(("sigma", "heading", "converged"))
    assert every.shape == (6,)
    assert every.low[3] == 0.0 and every.low[4] < 0.0 and (every.low[5], every.high[5]) == (0.0, 1.0)
    assert np.isfinite(every.low).all() and np.isfinite(every.high).all()
    with pytest.raises(UnknownNameError, match="did you mean 'sigma'"):
        make_action_space(("sigmas",))
    with pytest.raises(EstimateError, match="once"):
        make_action_space(("sigma", "sigma"))


@pytest.mark.parametrize(
    "answer", [None, "here", Estimate(xy_m=[np.nan, 0.0], level=0), Estimate(xy_m=[1.0, 2.0], level=0.5)]
)
def test_an_answer_that_cannot_be_scored_becomes_nan(answer) -> None:
    assert np.isnan(to_action(answer, ("heading",))).all()


def test_claims_stand_in_the_order_they_were_made() -> None:
    estimate = Estimate(xy_m=[1.0, 2.0], level=3, heading_rad=0.5, sigma_m=4.0, converged=True)
    assert to_action(estimate, ("sigma", "heading")).tolist() == [1.0, 2.0, 3.0, 4.0, 0.5]
    assert to_action(estimate, ("converged", "sigma")).tolist() == [1.0, 2.0, 3.0, 1.0, 4.0]
    assert to_action(estimate).tolist() == [1.0, 2.0, 3.0]
