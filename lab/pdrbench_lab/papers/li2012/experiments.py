"""Experiments behind the claims of Li et al. 2012; `claims` holds the table.

Every seed draws people of its own, their phones and the magnetic field of the corridor. Step detection is measured by
`steps`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench_baselines.li2012.localizer import GENERIC
from pdrbench_baselines.li2012.map_filter import StepModel
from pdrbench_lab.papers.li2012.laps import ALGORITHMS, SETUPS, Crowd, Followed, follow

SUBJECTS: Final = 8  # for each seed; L1 has 13, and 20 laps
HEADING_SUBJECTS: Final = 5  # L12
VARIED_SUBJECTS: Final = 4
LOST_SUBJECTS: Final = 10  # L22
LOST_LAPS: Final = 4  # L22: 40 laps by ten people
TURNS: Final = 12  # L23: of the four laps, as far as all people get
STEEP: Final = 5.0  # K of eq. (2), in the variant; the localizer has 1, the paper names none
HANDLED_S: Final = 35.0  # before a lap; `steps.BEFORE_S` are before two
PATIENT_M: Final = 12.0  # a user who taps again later than `laps.LOST_M`, in the variant
HALF_SPREAD: Final = {"filter": {"delta_a": 0.05, "delta_b": 0.075}}  # of L15, in the variant

_LAPS, _LOST = range(2)  # crowds of a seed


def laps(seed: int) -> dict[str, Any]:
    """L1, L12, L24: a lap by each of eight people, two phones, three algorithms.

    Returns:
        For each place and algorithm the errors of all steps, along the path and Euclidean, `errors_` and
        `errors_euclid_`, their means `along_` and `euclid_`, their sum along the path by lap `by_lap_` of so many steps
        `steps_`, and the median over laps of the mean along the path, `typical_`; heading errors of five people. Who is
        lost taps again, as in `failures`; names with `_left` are those of the same laps where no user does.
    """
    crowd = Crowd(seed, _LAPS)
    numbers: dict[str, Any] = {}
    for place in SETUPS:
        walks = [crowd.walk(number, number, place) for number in range(SUBJECTS)]
        found: dict[str, list[Followed]] = {f"{name}{kind}": [] for name in ALGORITHMS for kind in ("", "_left")}
        for number, (recording, briefing) in enumerate(walks):
            for name, params in ALGORITHMS.items():
                tapped = follow(recording, briefing, crowd.filter_rng(number), params, taps_again=True)
                # No user was lost: it is the same run.
                left = tapped if not tapped.failures else follow(recording, briefing, crowd.filter_rng(number), params)
                found[name].append(tapped)
                found[f"{name}_left"].append(left)
        for name, of in found.items():
            numbers |= _errors(f"{place}_{name}", of)
        numbers |= _headings(place, found["alg3_left"][:HEADING_SUBJECTS])
        if place == "hand":
            numbers |= _lengths(found["alg2"])
    return numbers


def variants(seed: int) -> dict[str, Any]:
    """What L1 and L23 owe to what the paper leaves open: K of eq. (2), the spread of the models, open doors.

    And to a rule of the paper: models that pass from particle to particle on the straight as well (L16).
    """
    from pdrbench_lab.papers.li2012.corridor_phone.corridor import CORRIDOR
    from pdrbench_lab.papers.ring_floor import make_ring

    crowd = Crowd(seed, _LAPS)
    doors = make_ring(replace(CORRIDOR, is_open=True), "corridor, doors open")
    numbers: dict[str, Any] = {}
    for place in SETUPS:
        found: dict[str, list[Followed]] = {"literal": [], "steep": [], "narrow": [], "doors": [], "inherits": []}
        for number in range(VARIED_SUBJECTS):
            recording, briefing = crowd.walk(number, number, place)
            open_briefing = replace(briefing, building=doors)
            for name, given, params in (
                ("literal", briefing, {}),
                ("steep", briefing, {"filter": {"adjustment": STEEP}}),
                ("narrow", briefing, HALF_SPREAD),
                ("doors", open_briefing, {}),
                ("inherits", briefing, {"filter": {"inherits_always": True}}),
            ):
                found[name].append(follow(recording, given, crowd.filter_rng(number), params, taps_again=True))
        for name, of in found.items():
            numbers |= _errors(f"{place}_{name}", of)
            by_turn_pct = np.nanmean([length_errors_pct(each)[:3] for each in of], axis=0)
            numbers[f"gone_{place}_{name}"] = float(1.0 - by_turn_pct[2] / by_turn_pct[0])
        numbers |= _headings(f"steep_{place}", found["steep"])
    return numbers


def patience(seed: int) -> dict[str, Any]:
    """L1 with users who tap again when they are 12 m off instead of 6 m, or when all particles are depleted."""
    crowd = Crowd(seed, _LAPS)
    numbers: dict[str, Any] = {}
    for place in SETUPS:
        for name, params in ALGORITHMS.items():
            found = []
            for number in range(VARIED_SUBJECTS):
                recording, briefing = crowd.walk(number, number, place)
                rng = crowd.filter_rng(number)
                found.append(follow(recording, briefing, rng, params, taps_again=True, lost_m=PATIENT_M))
            numbers |= _errors(f"{place}_{name}_patient", found)
    return numbers


def handled(seed: int) -> dict[str, Any]:
    """L1 in the hand, once more, with the handling before each walk that the false steps of L8 contain.

    Who taps and then stands, handling the phone, is moved by every false step. Errors are those of steps of the walk.
    """
    crowd = Crowd(seed, _LAPS)
    found: dict[str, list[Followed]] = {name: [] for name in ALGORITHMS}
    for number in range(SUBJECTS):
        recording, briefing = crowd.handled_walk(number, "hand", HANDLED_S)
        for name, params in ALGORITHMS.items():
            followed = follow(recording, briefing, crowd.filter_rng(number), params, taps_again=True)
            found[name].append(followed.since(HANDLED_S))
    numbers: dict[str, Any] = {}
    for name, of in found.items():
        numbers |= _errors(f"handled_{name}", of)
    return numbers


def failures(seed: int) -> dict[str, Any]:
    """L22, L23: four laps by each of ten people, the phone in the hand; who is lost taps again.

    Returns:
        `generic` and `personal`, how often, and by person (10,); by number of turns (TURNS + 1,) `turn_error_pct`, the
        mean over people of `length_errors_pct`, and what part of the first is gone after two turns and later; mean
        errors of another lap of five of them with the stored model, `stored_mean_m`, and without, `fresh_mean_m`.
    """
    crowd = Crowd(seed, _LOST)
    lost: dict[str, list[int]] = {"generic": [], "personal": []}
    by_turn: list[FloatArray] = []
    stored: list[FloatArray] = []
    fresh: list[FloatArray] = []
    for number in range(LOST_SUBJECTS):
        recording, briefing = crowd.walk(number, number, "hand", LOST_LAPS)
        models: dict[str, StepModel] = {}
        for name, algorithm in (("generic", "alg2"), ("personal", "alg3")):
            rng = crowd.filter_rng(number)
            found = follow(recording, briefing, rng, ALGORITHMS[algorithm], taps_again=True)
            lost[name].append(found.failures)
            models[name] = found.personal
        by_turn.append(length_errors_pct(found))
        if number < HEADING_SUBJECTS:
            again = LOST_SUBJECTS + number
            recording, briefing = crowd.walk(again, number, "hand")
            for errors, model in ((fresh, None), (stored, models["personal"])):
                found = follow(recording, briefing, crowd.filter_rng(again), ALGORITHMS["alg3"], model=model)
                errors.append(found.along_m)
    personal_pct = np.nanmean(by_turn, axis=0)
    return {
        **{name: float(sum(failed)) for name, failed in lost.items()},
        **{f"{name}_by_person": np.array(failed) for name, failed in lost.items()},
        "turn_error_pct": personal_pct,
        "first_error_pct": float(personal_pct[0]),
        "two_turns_error_pct": float(personal_pct[2]),
        "late_error_pct": float(personal_pct[4:].mean()),
        "gone_after_two_turns": float(1.0 - personal_pct[2] / personal_pct[0]),
        "gone_later": float(1.0 - personal_pct[4:].mean() / personal_pct[0]),
        "fresh_mean_m": float(np.concatenate(fresh).mean()),
        "stored_mean_m": float(np.concatenate(stored).mean()),
    }


def length_errors_pct(found: Followed) -> FloatArray:
    """(TURNS + 1,) after so many turns: by how much, in percent, the mean model of the cloud is off for its bearer.

    The model is that which the cloud has at the end of the leg behind the turn, when the turn was detected long ago. It
    is applied to all steps of the walk, whose mean true length is known: so legs are compared, and not their steps.
    """
    errors = np.full(TURNS + 1, np.nan)
    true_m, frequency_hz = found.true_length_m.mean(), found.frequency_hz.mean()
    for turn in range(TURNS + 1):
        last = int(np.searchsorted(found.turns, turn, side="right")) - 1
        if last >= 0 and found.turns[last] == turn:
            a, b = found.model[last]
            errors[turn] = 100.0 * abs((a * frequency_hz + b) / true_m - 1.0)
    return errors


def _errors(name: str, found: Sequence[Followed]) -> dict[str, Any]:
    along_m = np.concatenate([each.along_m for each in found])
    euclidean_m = np.concatenate([each.euclidean_m for each in found])
    return {
        f"along_{name}_m": float(along_m.mean()),
        f"euclid_{name}_m": float(euclidean_m.mean()),
        f"errors_{name}_m": along_m,
        f"by_lap_{name}_m": np.array([each.along_m.sum() for each in found]),
        f"steps_{name}": np.array([len(each.along_m) for each in found]),
        f"errors_euclid_{name}_m": euclidean_m,
        f"typical_{name}_m": float(np.median([each.along_m.mean() for each in found])),
    }


def _headings(place: str, found: Sequence[Followed]) -> dict[str, Any]:
    """L12: mean, 95th percentile and largest error of the headings of steps, and with the adjustment."""
    numbers: dict[str, Any] = {f"heading_steps_{place}": np.array([len(each.heading_rad) for each in found])}
    for name, is_corrected in (("plain", False), ("adjusted", True)):
        error_deg = np.concatenate([each.heading_error_deg(is_corrected=is_corrected) for each in found])
        numbers |= {
            f"heading_{place}_{name}_deg": error_deg,
            f"heading_mean_{place}_{name}_deg": float(error_deg.mean()),
        }
    return numbers


def _lengths(found: Sequence[Followed]) -> dict[str, Any]:
    """L14: how far the steps of people are from the generic model; of each, all steps of a lap together."""
    off_pct = np.array([100.0 * (each.length_m.sum() / each.true_length_m.sum() - 1.0) for each in found])
    return {
        "generic_off_pct": off_pct,
        "generic_mean_off_pct": float(off_pct.mean()),
        "generic_sigma_pct": float(off_pct.std(ddof=1)),
        "generic_a": GENERIC.a_m_per_hz,
        "generic_b": GENERIC.b_m,
    }
