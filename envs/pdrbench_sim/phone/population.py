"""How people with phones differ: who walks, how hard, where the phone is, and which phone it is.

`draw_bearer` draws one person of a kind. Kinds are named by `KINDS`; a population is some of them.

The rise of the trunk comes from mechanics. A leg of length l that does not bend carries the hip, over a step of length
s, along an arc that is s^2 / (8 l) high; at the cadence f = v / s its vertical acceleration has the amplitude
(2 pi f)^2 s^2 / (16 l) = pi^2 v^2 / (4 l). Knees and ankles yield: a person has a part of it, the stiffness of the
gait, taken at `PACE_MPS`; from there it grows with the power of the speed measured within walks, less than v^2.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

import numpy as np

from pdrbench_sim.people.person import CUT, Person, PersonParams, draw_person
from pdrbench_sim.people.walker import NATURAL_WALK, WalkParams
from pdrbench_sim.phone.carry import CarryParams
from pdrbench_sim.phone.gait import GaitMotionParams
from pdrbench_sim.phone.heading import AttitudeErrorParams
from pdrbench_sim.units.phone_profiles import draw_phone_profile
from pdrbench_sim.units.profiles import ImuProfile

PACE_MPS: Final = 1.2  # ours: between strolling and hurrying
LEG: Final = 0.53  # length of a leg over body height; [R], as the height of the hip
GAIT: Final = GaitMotionParams()
CARRY: Final = CarryParams()

USUAL: Final = PersonParams()

Law = tuple[float, float]  # median, and standard deviation of the logarithm

# Of held phones between 6 and 25 Hz: [M] site 1 train walks of ILC20 and the first person of `phone_steps`.
SHAKE_HZ: Final = (4.0, 2.5)
SHAKE_S: Final[Law] = (0.040, 0.06)
SHAKE_STEADY: Final = 0.7  # ours: by eye, ripples of recorded steps look alike
HEEL_POWER: Final = 0.5
HEEL_S: Final[Law] = (0.023, 0.2)  # width of a blow in a pocket; [M] above 15 Hz, the first person of `phone_steps`


@dataclass(frozen=True, slots=True)
class BearerKind:
    """How people of one kind differ; a `Law` is log-normal, cut at two standard deviations."""

    what: str  # part of a sentence
    mounting: str = "hand"  # a key of `pdrbench_sim.phone.carry.PLACES`
    person: PersonParams = USUAL  # height, cadence, steps
    walk: WalkParams = NATURAL_WALK  # how they go through buildings
    stiffness: Law = (0.75, 0.30)  # amplitude of the rise over that of a leg that does not bend
    overtones: Law = (1.0, 0.25)  # harmonics of the rise over those of surveyors at the same rise
    shaking: Law = (1.3, 0.35)  # after heel strikes, over that of surveyors who stamp as hard
    yielding: Law = (1.0, 0.3)  # of the wrist, over that of surveyors
    unevenness: Law = (1.5, 0.5)  # of left and right, over that of surveyors
    unsteadiness: float = 1.0  # variation from step to step over that of surveyors
    rattle_mps2: Law = (3.2, 0.7)  # of a phone in a pocket at an ordinary walk
    knock_mps2: Law = (2.2, 0.6)  # of things in a bag that strike the phone, at an ordinary walk
    is_other_phone: bool = False  # any phone, with an attitude of its own; else one of those that are known best


@dataclass(frozen=True, slots=True)
class Bearer:
    """One person with a phone, as drawn."""

    person: Person
    mounting: str  # where the phone is
    walk: WalkParams
    manner: PhoneManner


@dataclass(frozen=True, slots=True)
class PhoneManner:
    """How the phone of one person moves and measures; None for the default of each."""

    trunk: GaitMotionParams | None = None
    carried: CarryParams | None = None
    attitude: AttitudeErrorParams | None = None
    profile: ImuProfile | None = None


ANY_MANNER: Final = PhoneManner()
_GENTLE: Final = PersonParams(cadence_hz=(1.72, 0.13), step_factor=(0.92, 0.06))  # [R] strollers through a museum
_SLOW: Final = PersonParams(  # [R] gait of people over 75: 0.6 to 1.0 m/s
    height_m=(1.63, 0.08), cadence_hz=(1.58, 0.13), step_factor=(0.80, 0.07), asymmetry=(0.0, 0.05)
)
_SLOW_WALK: Final = replace(NATURAL_WALK, accel_mps2=0.5, turn_speed=0.55, pause_every_s=90.0)  # [R]
_PUSHING: Final = PersonParams(cadence_hz=(1.75, 0.13), step_factor=(0.90, 0.06))  # [R]
_CART_WALK: Final = replace(NATURAL_WALK, accel_mps2=0.6, turn_speed=0.5, u_turn_fraction=0.0)  # [R]

KINDS: Final[Mapping[str, BearerKind]] = MappingProxyType(
    {
        "usual": BearerKind("people of every stiffness with the phone in the hand"),
        "gentle": BearerKind("people who stroll with bent knees", person=_GENTLE, stiffness=(0.48, 0.20)),
        "slow": BearerKind(
            "slow and old people, uneven and unsteady",
            person=_SLOW,
            walk=_SLOW_WALK,
            stiffness=(0.50, 0.25),
            unevenness=(2.5, 0.4),
            unsteadiness=1.2,
        ),
        "pocket": BearerKind("a phone that rattles in a trouser pocket", mounting="pocket", unsteadiness=0.8),
        "swing": BearerKind("a phone in a hand that swings", mounting="swing"),
        "ear": BearerKind("a phone at the ear", mounting="ear"),
        "bag": BearerKind("a phone in a bag over the shoulder", mounting="bag"),
        "cart": BearerKind(
            "a phone on the handle of a cart or a stroller", mounting="cart", person=_PUSHING, walk=_CART_WALK
        ),
        "other phone": BearerKind("any phone in the hand", is_other_phone=True),
    }
)


def draw_bearer(rng: np.random.Generator, kind: BearerKind) -> Bearer:
    """One person of a kind, with a phone. Body, gait and phone have generators of their own."""
    body, manner, device = rng.spawn(3)
    person = draw_person(body, kind.person)

    def draw(law: Law) -> float:
        return law[0] * math.exp(law[1] * float(np.clip(manner.standard_normal(), -CUT, CUT)))

    rise_mps2 = draw(kind.stiffness) * rigid_rise_mps2(person.height_m, PACE_MPS) / PACE_MPS**GAIT.rise_power
    overtones, shaking = draw(kind.overtones), draw(kind.shaking)
    trunk = replace(
        GAIT,
        rise_mps2=rise_mps2,
        harmonics=tuple(overtones * harmonic for harmonic in GAIT.harmonics),
        uneven_fraction=draw(kind.unevenness) * GAIT.uneven_fraction,
        step_log_sigma=kind.unsteadiness * GAIT.step_log_sigma,
        timing_sigma=kind.unsteadiness * GAIT.timing_sigma,
    )
    carried = replace(
        CARRY,
        hand_yield_rad_per_mps2=draw(kind.yielding) * CARRY.hand_yield_rad_per_mps2,
        shake_mps2=_scaled(CARRY.shake_mps2, shaking),
        shake_radps=_scaled(CARRY.shake_radps, shaking),
        shake_hz=SHAKE_HZ,
        shake_s=draw(SHAKE_S),
        shake_steady=SHAKE_STEADY,
        heel_power=HEEL_POWER,
        pocket_shake_mps2=_scaled(CARRY.pocket_shake_mps2, shaking),
        ear_shakes=0.3,
        arm_shakes=0.5,
        heel_s=draw(HEEL_S),
        rattle_mps2=draw(kind.rattle_mps2),
        bag=replace(CARRY.bag, knock_mps2=draw(kind.knock_mps2)),
    )
    if not kind.is_other_phone:
        return Bearer(person, kind.mounting, kind.walk, PhoneManner(trunk, carried))
    phone = PhoneManner(trunk, carried, _draw_attitude(device), draw_phone_profile(device))
    return Bearer(person, kind.mounting, kind.walk, phone)


def rigid_rise_mps2(height_m: float, speed_mps: float) -> float:
    """Amplitude of the vertical acceleration of a hip on legs that do not bend."""
    return math.pi**2 * speed_mps**2 / (4 * LEG * height_m)


def _draw_attitude(rng: np.random.Generator) -> AttitudeErrorParams:
    """What a phone takes its attitude to be: some follow the compass at once, others hardly; [R]."""
    return AttitudeErrorParams(
        compass_s=math.exp(rng.uniform(math.log(1.0), math.log(30.0))),
        drift_radps=math.radians(math.exp(rng.uniform(math.log(0.1), math.log(1.0)))),
        tilt_rad=math.radians(rng.uniform(0.5, 2.0)),
    )


def _scaled(sizes: tuple[float, float, float], factor: float) -> tuple[float, float, float]:
    return (factor * sizes[0], factor * sizes[1], factor * sizes[2])
