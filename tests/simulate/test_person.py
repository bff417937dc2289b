from __future__ import annotations

import numpy as np
import pytest

from pdrbench.simulate.person import Person, PersonParams, draw_person


def test_the_step_length_is_the_published_formula_when_people_do_not_differ():
    alike = PersonParams(
        height_m=(1.80, 0.0), cadence_hz=(1.9, 0.0), step_factor=(1.0, 0.0), step_slope_m_per_hz=(0.3, 0.0)
    )
    person = draw_person(np.random.default_rng(0), alike)
    assert person.step_length_m == pytest.approx(0.7 + 0.371 * 0.05 + 0.227 * 0.11 * 1.80 / 1.75)


def test_people_spread_as_the_table_says():
    rng = np.random.default_rng(1)
    height_m = np.array([draw_person(rng).height_m for _ in range(2000)])
    # Clipped at two sigma a normal law keeps sqrt(E min(z^2, 4)) = 0.96 of its sd, known to 1 / sqrt(2 * 2000) = 1.6 %.
    assert height_m.mean() == pytest.approx(1.70, abs=4 * 0.09 / np.sqrt(2000))
    assert height_m.std() == pytest.approx(0.96 * 0.09, rel=0.06)


def test_steps_follow_the_speed_along_the_personal_line():
    person = Person(1.75, cadence_hz=1.8, step_length_m=0.7, step_slope_m_per_hz=0.3, asymmetry=0.0)
    assert person.step_at(np.array([1.8 * 0.7]))[0] == pytest.approx(0.7)
    cadence_hz = 2.1
    step_m = 0.7 + 0.3 * (cadence_hz - 1.8)
    assert person.step_at(np.array([cadence_hz * step_m]))[0] == pytest.approx(step_m)
    slow_m = person.step_at(np.array([0.0, 0.2]))
    np.testing.assert_allclose(slow_m, 0.45 * 0.7)
