"""The adaptive step detector measured on people and places that its settings were not fitted on.

Of the walks of `phone_steps` those of one person, or of one place on the body, are left out; the settings are those of
a grid that miscount the others least; the walks left out are counted with them. The set has two people and seven
places.
Short trials are cut out of the same walks: from standing to mid-walk, from mid-walk to standing, from mid-walk to
mid-walk at any phase, and from standing to standing, the first and the last steps joined. Others are simulated: people
who stand, take some ten steps and stop.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from typing import Any, Final

import numpy as np

from pdrbench.datasets import dataset
from pdrbench.geometry import FloatArray
from pdrbench.inertial import GENTLE, find_steps
from pdrbench.sensors.checks import rate_of
from pdrbench_lab.adaptive_steps import AdaptiveStepParams, choose_steps, find_adaptive_steps, find_waves
from pdrbench_lab.papers.li2012 import steps as walks
from pdrbench_lab.papers.ring_floor import bare_ring
from pdrbench_lab.readers import phone_steps
from pdrbench_lab.readers.registered_files import locate
from pdrbench_lab.reproduce.reproduction import (
    Claim,
    Experiment,
    Gate,
    Reproduction,
    largest_over_seeds,
    mean_over_walks,
)
from pdrbench_sim.people.person import draw_person
from pdrbench_sim.people.route import Place, navigation_mesh
from pdrbench_sim.people.strides import stances
from pdrbench_sim.people.walker import NATURAL_WALK, walk_through
from pdrbench_sim.phone.gait import CLOSING_S
from pdrbench_sim.phone.phone import phone_motion

GRID: Final[dict[str, tuple[Any, ...]]] = {
    "fraction": (0.25, 0.3, 0.35),
    "window_s": (5.0, 8.0),
    "above_g": (0.0, 0.02),
    "first_fraction": (0.25, 0.3, 0.35),
    "closed_fraction": (0.35, 0.45),
}
TRIAL_STEPS: Final = (6, 12)  # of the short trials cut out of recorded walks
STOOD_S: Final = (0.5, 1.0)  # before their first contact and after their last one
TRIAL_S: Final = (4.0, 16.0)  # of those from mid-walk to mid-walk
# Of the short walks, one each: later bouts begin from a stop, where strikes of heels are not simulated.
PEOPLE: Final = 40
LEG_M: Final = (3.0, 9.0)
BEFORE_S, AFTER_S = 0.4, 0.5  # that a short recording begins before the first step, and ends after the last
SHORT_WALK: Final = replace(NATURAL_WALK, stop_fraction=1.0, pause_every_s=1e6)


def left_out(seed: int) -> dict[str, Any]:
    """Errors of the count in percent of the steps made, by walk and by short trial.

    Args:
        seed: Of where short trials are cut, and of the people of simulated ones.
    """
    settings = [
        AdaptiveStepParams(**dict(zip(GRID, values, strict=True))) for values in itertools.product(*GRID.values())
    ]
    by_waves = {(one.window_s, one.above_g): one for one in settings}.values()
    facts = {file.path: file.facts for file in dataset(walks.RECORDED).files}
    errors: dict[str, list[list[float]]] = {"walk": [], "trial": []}
    usual: dict[str, list[float]] = {"walk": [], "trial": []}
    gentle: dict[str, list[float]] = {"walk": [], "trial": []}
    groups: dict[str, list[tuple[str, str]]] = {"walk": [], "trial": []}
    rng = np.random.default_rng([seed, 10])
    for path, at in sorted(locate(walks.RECORDED).items()):
        if not path.endswith("accelerometer.csv.gz"):
            continue
        log = phone_steps.read(at)
        walk = log.rows["accel"], phone_steps.step_times_s(log.reference)
        for kind, (accel, made_s) in [("walk", walk), *(("trial", one) for one in short_trials(*walk, rng))]:
            waves = {(one.window_s, one.above_g): find_waves(accel, one) for one in by_waves}
            counts = [len(choose_steps(waves[one.window_s, one.above_g], one)) for one in settings]
            rate_hz = rate_of(accel[:, 0])
            errors[kind].append([100 * (count / len(made_s) - 1) for count in counts])
            usual[kind].append(100 * (len(find_adaptive_steps(accel, rate_hz)) / len(made_s) - 1))
            gentle[kind].append(100 * (len(find_steps(accel, rate_hz, GENTLE)) / len(made_s) - 1))
            groups[kind].append((str(facts[path]["subject"]), str(facts[path]["position"])))
    error_pct = np.array(errors["walk"])
    found: dict[str, Any] = {
        "home": np.abs(error_pct).mean(axis=0).min(),
        "chosen": np.abs(usual["walk"]),
        "bias": np.array(usual["walk"]),
        "gentle": np.abs(gentle["walk"]),
        "trial_chosen": np.abs(usual["trial"]),
        "trial_chosen_bias": np.array(usual["trial"]),
        "trial_gentle": np.abs(gentle["trial"]),
        "trial_gentle_bias": np.array(gentle["trial"]),
    }
    for column, name in enumerate(("person", "place")):
        of = {kind: np.array(groups[kind])[:, column] for kind in groups}
        found[name] = np.abs(choose_by_others(error_pct, of["walk"]))
        found |= {f"{name}_{one}": found[name][of["walk"] == one] for one in np.unique(of["walk"]).tolist()}
        found[f"trial_{name}_bias"] = choose_by_others(np.array(errors["trial"]), of["trial"])
        found[f"trial_{name}"] = np.abs(found[f"trial_{name}_bias"])
    return found | short_walks(seed)


def short_trials(
    accel: FloatArray, made_s: FloatArray, rng: np.random.Generator
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Rows (n, 4) and steps (k,) of short parts of a walk (n, 4) whose steps are at (k,)."""
    between_s = (made_s[1:] + made_s[:-1]) / 2
    for steps, stood_s in itertools.product(TRIAL_STEPS, STOOD_S):
        first_s, last_s = made_s[0] - stood_s, made_s[-1] + stood_s
        begun = _cut(accel, first_s, between_s[steps - 1]), made_s[:steps]
        ended = _cut(accel, between_s[-steps], last_s), made_s[-steps:]
        yield from (begun, ended)
        shift_s = begun[0][-1, 0] + 1 / rate_of(accel[:, 0]) - ended[0][0, 0]
        later = ended[0] + np.array([shift_s, 0.0, 0.0, 0.0])
        yield np.concatenate([begun[0], later]), np.concatenate([begun[1], ended[1] + shift_s])
        lasts_s = rng.uniform(*TRIAL_S)
        from_s = rng.uniform(made_s[6], made_s[-6] - lasts_s)
        yield (_cut(accel, from_s, from_s + lasts_s), made_s[(made_s >= from_s) & (made_s < from_s + lasts_s)])


def _cut(accel: FloatArray, from_s: float, to_s: float) -> FloatArray:
    return accel[(accel[:, 0] >= from_s) & (accel[:, 0] < to_s)]


def choose_by_others(error_pct: FloatArray, group: Any) -> FloatArray:
    """(W,) error of each walk with that of the settings (W, S) that miscounts walks of other groups least."""
    size = np.abs(error_pct)
    out = np.zeros(len(size))
    for one in np.unique(group):
        best = int(np.argmin(size[group != one].mean(axis=0)))
        out[group == one] = error_pct[group == one, best]
    return out


def short_walks(seed: int, people: int = PEOPLE) -> dict[str, Any]:
    """Simulated people who stop after 3 to 9 m, phones in the hand and in a pocket: errors of the count in percent."""
    mesh = navigation_mesh(bare_ring(walks.LONG_M, walks.SHORT_M, walks.WIDTH_M))
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
        ("gentle", "the same of `step_count?adapts=false`, 0.1 g, fitted on these walks", None),
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
    for key, what, gate in (
        ("person", "short trials cut out of the walks, the person left out", 3.0),
        ("place", "short trials cut out of the walks, the place left out", 3.0),
        ("chosen", "short trials cut out of the walks, settings as they are, fitted on these walks", None),
        ("gentle", "short trials cut out of the walks, `step_count?adapts=false`", None),
    ):
        limits = None if gate is None else Gate(-gate, gate)
        claims += [
            Claim(
                "L9",
                f"{what}: steps too many",
                "not stated",
                "left_out",
                mean_over_walks(f"trial_{key}_bias"),
                limits,
                "%",
            ),
            Claim(
                "L9",
                f"{what}: error of the count of each",
                "not stated",
                "left_out",
                mean_over_walks(f"trial_{key}"),
                None,
                "%",
            ),
        ]
    for key, what, limits in (
        ("bias_adaptive", "simulated short walks: steps too many", Gate(-3.0, 3.0)),
        ("size_adaptive", "simulated short walks: error of the count of each, over the steps made", None),
        ("bias_gentle", "simulated short walks, `step_count?adapts=false`: steps too many", None),
        ("size_gentle", "simulated short walks, `step_count?adapts=false`: error of the count of each", None),
    ):
        claims.append(Claim("L9", what, "not stated", "left_out", largest_over_seeds(f"short_{key}"), limits, "%"))
    return tuple(claims)


REPRODUCTION: Final = Reproduction(
    name="steps_left_out",
    paper="the settings of step_count, fitted without the people or the places that they are measured on",
    experiments=(
        Experiment(
            "left_out", "pdrbench_lab.papers.li2012.left_out:left_out", seeds=1, quick_seeds=1, envs=("PhoneSteps-v1",)
        ),
    ),
    claims=_claims(),
)
