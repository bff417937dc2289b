"""The adaptive step detector measured on people and places that its settings were not fitted on.

Of the walks of `phone_steps` those of one person, or of one place on the body, are left out; the settings are those of
a grid that miscount the others least; the walks left out are counted with them. The set has two people and seven
places.
Short walks are simulated: people who stand, take some ten steps and stop.
"""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any, Final

import numpy as np

from pdrbench.datasets import dataset
from pdrbench.datasets.integrity import locate
from pdrbench.evaluation.reproduction import Claim, Experiment, Gate, Reproduction, largest_over_seeds, mean_over_walks
from pdrbench.geometry import FloatArray
from pdrbench.inertial import GENTLE, AdaptiveStepParams, find_adaptive_steps, find_steps
from pdrbench.inertial.adaptive_steps import choose_steps, find_waves
from pdrbench.sensors.checks import rate_of
from pdrbench_baselines.li2012 import steps as walks
from pdrbench_sim.people.person import draw_person
from pdrbench_sim.people.route import Place, navigation_mesh
from pdrbench_sim.people.strides import stances
from pdrbench_sim.people.walker import NATURAL_WALK, walk_through
from pdrbench_sim.phone.gait import CLOSING_S
from pdrbench_sim.phone.phone import phone_motion
from pdrbench_sim.readers import phone_steps

GRID: Final[dict[str, tuple[Any, ...]]] = {
    "fraction": (0.25, 0.3, 0.35, 0.4),
    "apart": (0.55, 0.65),
    "window_s": (5.0, 8.0),
    "above_g": (0.0, 0.02, 0.04),
}
# Of the short walks, one each: later bouts begin from a stop, where strikes of heels are not simulated.
PEOPLE: Final = 40
LEG_M: Final = (3.0, 9.0)
BEFORE_S, AFTER_S = 0.4, 0.5  # that a short recording begins before the first step, and ends after the last
SHORT_WALK: Final = replace(NATURAL_WALK, stop_fraction=1.0, pause_every_s=1e6)


def left_out(seed: int) -> dict[str, Any]:
    """Errors of the count in percent of the steps made, by walk.

    Args:
        seed: Of the people of the short walks.
    """
    settings = [
        AdaptiveStepParams(**dict(zip(GRID, values, strict=True))) for values in itertools.product(*GRID.values())
    ]
    facts = {file.path: file.facts for file in dataset(walks.RECORDED).files}
    errors, usual, gentle, who, where = [], [], [], [], []
    for path, at in locate(walks.RECORDED).items():
        if not path.endswith("accelerometer.csv.gz"):
            continue
        log = phone_steps.read(at)
        accel, made = log.rows["accel"], len(phone_steps.step_times_s(log.reference))
        counts = [len(choose_steps(find_waves(accel, params), params)) for params in settings]
        errors.append(100 * (np.array(counts) / made - 1))
        rate_hz = rate_of(accel[:, 0])
        usual.append(100 * (len(find_adaptive_steps(accel, rate_hz)) / made - 1))
        gentle.append(100 * (len(find_steps(accel, rate_hz, GENTLE)) / made - 1))
        who.append(str(facts[path]["subject"]))
        where.append(str(facts[path]["position"]))
    error_pct = np.array(errors)
    found: dict[str, Any] = {
        "home": np.abs(error_pct).mean(axis=0).min(),
        "chosen": np.abs(usual),
        "bias": np.array(usual),
        "gentle": np.abs(gentle),
    }
    for name, groups in (("person", np.array(who)), ("place", np.array(where))):
        found[name] = choose_by_others(error_pct, groups)
        found |= {f"{name}_{one}": found[name][groups == one] for one in np.unique(groups).tolist()}
    return found | short_walks(seed)


def choose_by_others(error_pct: FloatArray, group: Any) -> FloatArray:
    """(W,) size of the error of each walk with the settings (W, S) that miscount walks of other groups least."""
    size = np.abs(error_pct)
    out = np.zeros(len(size))
    for one in np.unique(group):
        best = int(np.argmin(size[group != one].mean(axis=0)))
        out[group == one] = size[group == one, best]
    return out


def short_walks(seed: int, people: int = PEOPLE) -> dict[str, Any]:
    """Simulated people who stop after 3 to 9 m, phones in the hand and in a pocket: errors of the count in percent."""
    mesh = navigation_mesh(walks.corridor())
    made, counts = [], {"adaptive": [], "gentle": []}  # type: ignore[var-annotated]
    for rng in np.random.default_rng([seed, 9]).spawn(people):
        who, how, gait, legs, *own = rng.spawn(4 + len(walks.CARRIED))
        x_m = 1.0 + np.cumsum([0.0, *legs.uniform(*LEG_M, 2)])
        way = walk_through(
            how, mesh, draw_person(who), [Place(0, np.array((x, 0.0))) for x in x_m.tolist()], SHORT_WALK
        )
        feet = stances(way, gait)
        heel_s = walks.heel_strikes(way, feet)
        for place, stream in zip(walks.CARRIED, own, strict=True):
            carried, unit, noise = stream.spawn(3)
            motion = phone_motion(way, feet, carried, carry=((0.0, place),), rate_hz=walks.MOTION_HZ)
            rows = walks.measured(motion, unit, noise)
            bout = way.bouts[0]
            steps_s = heel_s[(heel_s > bout.t_s[0]) & (heel_s <= bout.t_s[-1] + CLOSING_S)]
            part = rows[(rows[:, 0] >= bout.t_s[0] - BEFORE_S) & (rows[:, 0] <= steps_s[-1] + AFTER_S)]
            made.append(len(steps_s))
            counts["adaptive"].append(len(find_adaptive_steps(part, walks.RATE_HZ)))
            counts["gentle"].append(len(find_steps(part, walks.RATE_HZ, GENTLE)))
    total = float(np.sum(made))
    return {
        f"short_{kind}_{name}": 100 * float(measure(np.array(found) - np.array(made))) / total
        for name, found in counts.items()
        for kind, measure in (("bias", np.sum), ("size", lambda off: np.abs(off).sum()))
    }


def _claims() -> tuple[Claim, ...]:
    rows = [
        ("person", "error of the count, the person left out", 1.3),
        ("place", "error of the count, the place left out", 1.3),
        ("chosen", "error of the count with the settings as they are, fitted on these walks", None),
        ("gentle", "the same of `step_count-v0`, 0.1 g, fitted on these walks", None),
        *((f"person_{one}", f"person {one} left out", None) for one in "AB"),
        *(
            (f"place_{one}", f"place {one} left out", None)
            for one in ("Armband", "BackPocket", "FrontPocket", "InHand", "NeckPouch", "Purse", "SwingingArm")
        ),
    ]
    claims = [
        Claim(
            "L9", what, "not stated", "left_out", mean_over_walks(key), None if gate is None else Gate(high=gate), "%"
        )
        for key, what, gate in rows
    ]
    for key, what, limits in (
        ("bias_adaptive", "simulated short walks: steps too many", Gate(-3.0, 3.0)),
        ("size_adaptive", "simulated short walks: error of the count of each, over the steps made", None),
        ("bias_gentle", "simulated short walks, `step_count-v0`: steps too many", None),
        ("size_gentle", "simulated short walks, `step_count-v0`: error of the count of each", None),
    ):
        claims.append(Claim("L9", what, "not stated", "left_out", largest_over_seeds(f"short_{key}"), limits, "%"))
    return tuple(claims)


REPRODUCTION: Final = Reproduction(
    name="steps_left_out",
    paper="the settings of step_count-v1, fitted without the people or the places that they are measured on",
    experiments=(
        Experiment(
            "left_out",
            "pdrbench_baselines.li2012.left_out:left_out",
            seeds=1,
            quick_seeds=1,
            envs=("PhoneSteps-v0",),
        ),
    ),
    claims=_claims(),
)
