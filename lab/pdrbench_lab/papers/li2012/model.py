"""The generic step model of Li et al. 2012 (claim L14): one line through the steps of many simulated people."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial.step_detection import StepDetector
from pdrbench.recording import Recording
from pdrbench.trajectory import Trajectory
from pdrbench_baselines.li2012.map_filter import StepModel

if TYPE_CHECKING:
    from pdrbench_sim.people.person import Person

NUM_PEOPLE: Final = 23  # L14
WALK_S: Final = 45.0  # 23 people at three paces then take more than 4000 steps
PACES: Final = (0.8, 1.0, 1.2)  # of the preferred cadence: slowly, as usual, in a hurry (1.4 to 2.4 Hz, as L21 has it)
SEED: Final = 20120905  # of the training population; environments draw theirs from other seeds
REFERENCE_S: Final = 0.1
SHORTEST_M: Final = 0.3  # a shuffle on the spot is no step of a walk


def generic_model(num_people: int = NUM_PEOPLE, walk_s: float = WALK_S) -> tuple[StepModel, int]:
    """Fits L = a f + b by least squares to the steps of people with a phone in the hand, as the detector sees them.

    The paper does not print a and b of its 23 people; these walk through a simulated office, each at three paces.

    Returns:
        model: The line.
        num_steps: How many steps it is fitted to.
    """
    from pdrbench_sim.buildings.office import make_office
    from pdrbench_sim.people.person import draw_person
    from pdrbench_sim.record import Setup, make_scene, simulate_walk

    scene = make_scene(np.random.default_rng(SEED), make_office(np.random.default_rng(SEED), num_levels=1))
    setup = Setup("hand", device="phone_mid", sensors=("accel",), rate_hz=50.0, reference_s=REFERENCE_S)
    samples = []
    for number in range(num_people):
        person = draw_person(np.random.default_rng((SEED, number)))
        for which, pace in enumerate(PACES):
            seed, walker = (SEED, number, which), at_pace(person, pace)
            samples.append(steps_of(simulate_walk(scene, seed, setup, duration_s=walk_s, person=walker)))
    frequency_hz, length_m = np.concatenate(samples, axis=1)
    a, b = np.polyfit(frequency_hz, length_m, 1)
    return StepModel(float(a), float(b)), len(length_m)


def at_pace(person: Person, pace: float) -> Person:
    """The same person at another cadence, with the steps that go with it."""
    cadence_hz = pace * person.cadence_hz
    longer_m = person.step_slope_m_per_hz * (cadence_hz - person.cadence_hz)
    return replace(person, cadence_hz=cadence_hz, step_length_m=person.step_length_m + longer_m)


def steps_of(recording: Recording) -> FloatArray:
    """(2, K) frequency and true length of the steps that are detected in a recording."""
    steps = StepDetector(recording.streams["accel"].spec.rate_hz or 50.0).update(recording.streams["accel"].rows)
    length_m = walked_m(recording.reference, steps.begin_s, steps.end_s)
    walks = length_m >= SHORTEST_M
    return np.stack([steps.frequency_hz[walks], length_m[walks]])


def walked_m(way: Trajectory, begin_s: FloatArray | float, end_s: FloatArray | float) -> FloatArray:
    """(K,) length of the way of the body between two times."""
    along_m = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way.xy_m, axis=0).T))])
    begin_m, end_m = (np.interp(t_s, way.t_s, along_m) for t_s in (begin_s, end_s))
    return np.asarray(end_m - begin_m)
