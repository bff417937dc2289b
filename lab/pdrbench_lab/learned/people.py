"""People who walk for the training of the network, and for the choice between networks; they occur nowhere else.

Environments draw their people, buildings and phones from other seeds. These are of any kind with any phone.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np

from pdrbench.errors import unknown_name
from pdrbench.recording import Recording
from pdrbench_lab.papers.li2012.model import at_pace

SEED: Final = 20180717  # of all people here
PEOPLE_PER_BUILDING: Final = 10
REFERENCE_S: Final = 0.1
RATES_HZ: Final = (50.0, 100.0)
DEVICES: Final = ("phone_mid", "phone_good")
BEARER_S: Final = 120.0
# Kinds of `pdrbench_sim.phone.population` in turn. Hands most of all: there the phone shows least of the gait.
TURNS: Final = (
    *("usual", "gentle", "pocket", "other phone", "slow", "gentle", "swing", "pocket", "usual", "bag"),
    *("gentle", "ear", "slow", "other phone", "cart", "pocket"),
)
OTHER_PHONE_FRACTION: Final = 0.6  # ours: of those whose kind has no phone of its own
# Factor on the steps of the published law, mean and spread, whatever the kind: what a gait looks like must not tell how
# long its steps are. Steps of `gentle` (0.92) and `slow` (0.80) people made walks through a museum 15 % too short.
BEARER_STEPS: Final = (1.0, 0.08)
PACE_RANGE: Final = (0.9, 1.25)  # of the preferred cadence, for a whole walk; ours


def train_bearer(
    number: int, *, group: str = "train", kinds: tuple[str, ...] = TURNS, walk_s: float = BEARER_S
) -> Recording:
    """The walk of one person of `kinds` in turn, of a step factor, a pace and a phone that differ more than theirs.

    Args:
        number: Whose.
        group: "train" or "val": people and buildings of the two have no seed in common.
        kinds: Names of `pdrbench_sim.phone.population.KINDS`.
        walk_s: How long it takes.

    Raises:
        UnknownNameError: There is no such kind.
    """
    from pdrbench_sim.buildings.office import make_office
    from pdrbench_sim.phone.population import KINDS, draw_bearer
    from pdrbench_sim.record import Setup, make_scene, simulate_walk

    name = kinds[number % len(kinds)]
    if name not in KINDS:
        raise unknown_name("kind of people", name, KINDS)
    root = [SEED, {"train": 2, "val": 3}[group]]
    rng = np.random.default_rng([*root, 0, number])
    where = np.random.default_rng([*root, 1, number // PEOPLE_PER_BUILDING])
    scene = make_scene(where, make_office(where, num_levels=2, area_m2=float(where.uniform(1500.0, 5000.0))))
    usual = KINDS[name]
    kind = replace(
        usual,
        person=replace(usual.person, step_factor=BEARER_STEPS),
        is_other_phone=usual.is_other_phone or rng.random() < OTHER_PHONE_FRACTION,
    )
    bearer = draw_bearer(rng, kind)
    person = at_pace(bearer.person, float(rng.uniform(*PACE_RANGE)))
    profile = bearer.manner.profile
    setup = Setup(
        bearer.mounting,
        device=str(rng.choice(DEVICES)),
        rate_hz=float(rng.choice(RATES_HZ)) if profile is None else profile.rate_hz,
        sensors=("accel", "gyro", "rotation"),
        reference_s=REFERENCE_S,
        manner=bearer.manner,
    )
    return simulate_walk(
        scene, [*root, 2, number], setup, duration_s=walk_s, person=person, walk=bearer.walk, name=f"{name}-{number}"
    )
