from __future__ import annotations

import pytest

from pdrbench_baselines.li2012.localizer import GENERIC
from pdrbench_lab.papers.li2012.model import generic_model


def test_the_generic_model_is_the_fit_of_the_training_population() -> None:
    """Four of the 23 people at three paces: near the stored line, which all of them gave."""
    model, num_steps = generic_model(num_people=4, walk_s=30.0)
    assert num_steps > 300
    for frequency_hz in (1.6, 1.9, 2.2):
        assert model.length_m(frequency_hz) == pytest.approx(GENERIC.length_m(frequency_hz), abs=0.06)
