"""People who walk for the training of the network, and for the choice between networks; they occur nowhere else.

Environments draw their people, buildings and phones from other seeds. Half of the walks lead through offices with the
phone in the hand or in a pocket, put elsewhere on the way now and then; the rest are of people with the steps of those
who recorded the public walks through shopping centres.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from pdrbench.recording import Recording
from pdrbench_baselines.li2012.model import at_pace

SEED: Final = 20180717  # of all people here
PEOPLE_PER_BUILDING: Final = 10
SWITCHED_FRACTION: Final = 0.25  # as in OfficePhone-v0
SURVEYOR_FRACTION: Final = 0.3  # ours: of the walks, by people with the steps of surveyors, in the hand
# Step factor, mean and spread; ours: wider than the fit to the recorded walks, and longer, since legs of offices are
# short and slow: on long legs of train and val surveyors go at 1.2 to 1.5 m/s, those of offices at 1.1 with 1.02.
SURVEYOR_STEPS: Final = (1.10, 0.12)
WALK_S: Final = 150.0  # about as long as walks of OfficePhone-v0: turns and starts reveal a person's steps bit by bit
REFERENCE_S: Final = 0.1
RATES_HZ: Final = (50.0, 100.0)
DEVICES: Final = ("phone_mid", "phone_good")
PACES: Final = (0.85, 1.0, 1.15)  # of the preferred cadence; ours, narrower than those of Li et al. 2012


def train_person(number: int, *, group: str = "train", walk_s: float = WALK_S) -> Recording:
    """The walk of one person, with a place of the body every `REFERENCE_S`.

    Args:
        number: Whose.
        group: "train" or "val": people and buildings of the two have no seed in common.
        walk_s: How long it takes.
    """
    from pdrbench_sim.buildings.office import make_office
    from pdrbench_sim.people.person import SURVEYORS, draw_person
    from pdrbench_sim.record import Setup, make_scene, simulate_walk

    root = [SEED, {"train": 0, "val": 1}[group]]
    rng = np.random.default_rng([*root, 0, number])
    where = np.random.default_rng([*root, 1, number // PEOPLE_PER_BUILDING])
    office = make_office(where, num_levels=2, area_m2=float(where.uniform(1500.0, 4000.0)))
    scene = make_scene(where, office)
    is_surveyor = rng.random() < SURVEYOR_FRACTION
    person = draw_person(rng, replace(SURVEYORS, step_factor=SURVEYOR_STEPS) if is_surveyor else None)
    pace = float(rng.choice(PACES))
    if not is_surveyor:
        person = at_pace(person, pace)
    first, other = ("hand", "pocket") if is_surveyor or number % 2 == 0 else ("pocket", "hand")
    switch_s = walk_s * float(rng.uniform(0.3, 0.7))
    switches = ((switch_s, other),) if rng.random() < SWITCHED_FRACTION and not is_surveyor else ()
    setup = Setup(
        first,
        switches=switches,
        device=str(rng.choice(DEVICES)),
        rate_hz=float(rng.choice(RATES_HZ)),
        sensors=("accel", "gyro", "rotation"),
        reference_s=REFERENCE_S,
    )
    name = f"{'surveyor' if is_surveyor else first}-{number}"
    recording = simulate_walk(scene, [*root, 2, number], setup, duration_s=walk_s, person=person, name=name)
    # Surveyors of the shopping centres have no known height; without one the network may expect their steps.
    return replace(recording, subject={}) if is_surveyor else recording
