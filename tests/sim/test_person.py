from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench_sim.people.person import Person, PersonError, PersonParams, draw_person


def test_the_step_length_is_the_published_formula_when_people_do_not_differ():
    average = PersonParams(
        height_m=(1.80, 0.0), cadence_hz=(1.9, 0.0), step_factor=(1.0, 0.0), step_slope_m_per_hz=(0.3, 0.0)
    )
    person = draw_person(np.random.default_rng(0), average)
    assert person.step_length_m == pytest.approx(0.7 + 0.371 * 0.05 + 0.227 * 0.11 * 1.80 / 1.75)


def test_steps_follow_the_speed_along_the_personal_line():
    person = Person(1.75, cadence_hz=1.8, step_length_m=0.7, step_slope_m_per_hz=0.3, asymmetry=0.0)
    assert person.step_at(np.array([1.8 * 0.7]))[0] == pytest.approx(0.7)
    cadence_hz = 2.1
    step_m = 0.7 + 0.3 * (cadence_hz - 1.8)
    assert person.step_at(np.array([cadence_hz * step_m]))[0] == pytest.approx(step_m)
    slow_m = person.step_at(np.array([0.0, 0.2]))
    np.testing.assert_allclose(slow_m, 0.45 * 0.7)


@pytest.mark.parametrize(
    ("facts", "named"),
    [
        ({"height_m": 0.0}, "height_m"),
        ({"cadence_hz": -1.8}, "cadence_hz"),
        ({"step_length_m": float("nan")}, "step_length_m"),
        ({"step_slope_m_per_hz": 0.0}, "step_slope_m_per_hz"),
        ({"asymmetry": float("inf")}, "asymmetry"),
    ],
)
def test_impossible_people_are_named(facts, named):
    possible = {"height_m": 1.7, "cadence_hz": 1.9, "step_length_m": 0.7, "step_slope_m_per_hz": 0.3, "asymmetry": 0.0}
    Person(**possible)
    with pytest.raises(PersonError, match=f"{named} of a person is .*; people have"):
        Person(**possible | facts)


@pytest.mark.parametrize("law", [(1.7, -0.1), (1.7, float("nan")), (0.6, 0.09), (float("nan"), 0.0)])
def test_laws_that_could_draw_impossible_people_are_refused(law):
    with pytest.raises(PersonError, match="height_m of people"):
        PersonParams(height_m=law)


def test_a_runner_keeps_the_cadence_and_shortens_the_step():
    person = Person(1.75, cadence_hz=1.8, step_length_m=0.7, step_slope_m_per_hz=0.3, asymmetry=0.01)
    running = replace(person, cadence_hz=2.6, step_length_m=1.0, step_slope_m_per_hz=1.2)
    assert running.step_at(np.array([2.6]))[0] == pytest.approx(1.0)
    # Half the speed: f (1.0 + 1.2 (f - 2.6)) = 1.3 has the root f = 2.24.
    assert 1.3 / running.step_at(np.array([1.3]))[0] == pytest.approx(2.24, abs=0.01)
