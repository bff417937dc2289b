"""Accelerometer and gyroscope of a phone in the hand and of one in a trouser pocket: real and synthetic walks."""

from __future__ import annotations

import functools
import itertools
import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from pdrbench.datasets import dataset, find
from pdrbench.datasets.by_hash import locate
from pdrbench.errors import DatasetError
from pdrbench.geometry import FloatArray
from pdrbench_sim.buildings.mall import make_mall
from pdrbench_sim.readers import ilc20, phone_steps
from pdrbench_sim.realism import phone_gait
from pdrbench_sim.realism.block import Block, Control, Distribution, Figure, Part, RealismStatistic, Values
from pdrbench_sim.realism.malls import mall_walks
from pdrbench_sim.record import IN_POCKET, make_scene, simulate_walk
from pdrbench_sim.units.motion import GRAVITY_MPS2

HAND_DATASET: Final = "ilc20"
POCKET_DATASET: Final = "phone_steps"
POCKET_FIT_SUBJECT: Final = "A"  # of the two people; the other one judges
POCKETS: Final = ("FrontPocket", "BackPocket")
POCKET_PIECE_S: Final = 30.0  # recordings of three minutes are cut into pieces of this length
POCKET_WALK_S: Final = 62.0  # of a synthetic walk: two pieces
MANIFEST: Final = "manifest.json"


def summary(walks: Sequence[tuple[FloatArray, FloatArray | None]]) -> Values:
    """Statistics of walks, each of them the rows (n, 4) of an accelerometer and, where there is one, of a gyroscope.

    Returns:
        (walks,) numbers of every walk of `phone_gait.MIN_WALK_S` or more with three steps in it, and under the keys
        that begin with "step_" those of all steps together.
    """
    by_walk: dict[str, list[float]] = {}
    by_step: dict[str, list[FloatArray]] = {"step_time_s": [], "step_swing_g": [], "step_lag_2": []}
    for accel_rows, gyro_rows in walks:
        if accel_rows[-1, 0] - accel_rows[0, 0] < phone_gait.MIN_WALK_S:
            continue
        length = np.linalg.norm(phone_gait.resampled(accel_rows), axis=1)
        time_s, swing_mps2, lag_1, lag_2 = phone_gait.steps(length)
        if not len(lag_2):
            continue
        found = phone_gait.lines(length) | {
            "std_mps2": float(length.std()),
            "high_mps2": float(np.quantile(length, 0.995)),
            "low_mps2": float(np.quantile(length, 0.005)),
            "swing_g": float(np.median(swing_mps2)) / GRAVITY_MPS2,
            "time_s": float(time_s.mean()),
            "lag_2": float(np.median(lag_2)),
            "lag_1_to_2": float(np.median(lag_1) / max(float(np.median(lag_2)), 1e-9)),
        }
        if gyro_rows is not None:
            rate_dps = np.degrees(np.linalg.norm(phone_gait.resampled(gyro_rows), axis=1))
            found |= {"turn_std_dps": float(rate_dps.std()), "turn_mean_dps": float(rate_dps.mean())}
        for key, value in found.items():
            by_walk.setdefault(key, []).append(value)
        by_step["step_time_s"].append(time_s)
        by_step["step_swing_g"].append(swing_mps2 / GRAVITY_MPS2)
        by_step["step_lag_2"].append(lag_2)
    if not by_walk:
        raise DatasetError("no walk with three steps in it: ask for more or longer walks")
    return {key: np.array(values) for key, values in by_walk.items()} | {
        key: np.concatenate(values) for key, values in by_step.items()
    }


# In the hand.


def real_in_hand(part: Part) -> Values:
    """Walks of surveyors in shopping centres: those of site 1 marked train, or all others."""
    folder = find(HAND_DATASET)
    files = json.loads((folder / MANIFEST).read_text("utf-8"))["files"]
    chosen = [
        file
        for file in files
        if file.get("records") == "all"
        and file["role"] in ("train", "eval")
        and (file["role"] == "train" and file["site"] == "site1") == (part == "fit")
    ]
    logs = [ilc20.read(folder / file["path"], floor=file["floor"]) for file in chosen]
    return summary([(log.rows["accel"], log.rows["gyro"]) for log in logs])


def synthetic_in_hand(seed: int, count: int) -> Values:
    """Synthetic surveyors in synthetic shopping centres."""
    return summary([(w.streams["accel"].rows, w.streams["gyro"].rows) for w in mall_walks(seed, count)])


def without_overtones(seed: int, count: int) -> Values:
    """The same walks, of which nothing is left above the step rate: the accelerations of a sine."""
    return summary([(_sine_like(w.streams["accel"].rows), w.streams["gyro"].rows) for w in mall_walks(seed, count)])


def shuffled(seed: int, count: int) -> Values:
    """The same walks in pieces of 0.1 s, put together in another order."""
    walks = []
    for number, walk in enumerate(mall_walks(seed, count)):
        rows = walk.streams["accel"].rows.copy()
        pieces = np.array_split(np.arange(len(rows)), max(len(rows) // 5, 1))
        order = np.random.default_rng([seed, number]).permutation(len(pieces))
        rows[:, 1:] = rows[np.concatenate([pieces[i] for i in order]), 1:]
        walks.append((rows, walk.streams["gyro"].rows))
    return summary(walks)


def _sine_like(rows: FloatArray) -> FloatArray:
    from scipy.signal import butter, sosfiltfilt

    smooth = rows.copy()
    rate_hz = 1 / float(np.median(np.diff(rows[:, 0])))
    smooth[:, 1:] = sosfiltfilt(butter(4, 2.8, fs=rate_hz, output="sos"), rows[:, 1:], axis=0)
    return smooth


# In the pocket.


def real_in_pocket(part: Part) -> Values:
    """Pieces of the walks of one person, with the phone in a front or a back pocket; the other person's judge."""
    pieces = [piece for rows in _pocket_recordings(part) for piece in _pieces(rows)]
    return summary([(piece, None) for piece in pieces])


def _pocket_recordings(part: Part) -> Iterator[FloatArray]:
    """(n, 4) rows of every recording."""
    found = locate(POCKET_DATASET)
    for file in sorted(dataset(POCKET_DATASET).files, key=lambda file: file.path):
        if file.facts.get("position") not in POCKETS or "accelerometer" not in file.path or file.path not in found:
            continue
        if (file.facts["subject"] == POCKET_FIT_SUBJECT) == (part == "fit"):
            yield phone_steps.read(found[file.path]).rows["accel"]


def _pieces(rows: FloatArray) -> list[FloatArray]:
    """Rows cut into pieces of `POCKET_PIECE_S`; what is left over is dropped."""
    whole = math.floor((rows[-1, 0] - rows[0, 0] + 0.1) / POCKET_PIECE_S)
    cuts = np.searchsorted(rows[:, 0], rows[0, 0] + POCKET_PIECE_S * np.arange(whole + 1))
    return [rows[a:b] for a, b in itertools.pairwise(cuts)]


@functools.lru_cache(maxsize=4)
def _pocket_walks(seed: int, count: int) -> tuple[FloatArray, ...]:
    """(n, 4) accelerometer rows of synthetic walks with a phone in the pocket."""
    scene = make_scene(np.random.default_rng([seed, 0]), make_mall(np.random.default_rng([seed, 1])))
    setup = replace(IN_POCKET, sensors=("accel",))
    walks = [simulate_walk(scene, [seed, 2, i], setup, duration_s=POCKET_WALK_S) for i in range(count)]
    return tuple(walk.streams["accel"].rows for walk in walks)


def synthetic_in_pocket(seed: int, count: int) -> Values:
    """Synthetic people who walk through a shopping centre."""
    return summary([(piece, None) for rows in _pocket_walks(seed, count) for piece in _pieces(rows)])


def without_heels(seed: int, count: int) -> Values:
    """The same walks without what is above 2.8 Hz: no heel strikes, no overtones."""
    return summary([(piece, None) for rows in _pocket_walks(seed, count) for piece in _pieces(_sine_like(rows))])


def _rows(per: str, rule: Callable[[], Distribution | Figure]) -> dict[str, RealismStatistic]:
    """What both kinds of carrying are judged by."""
    each = {
        "f1_hz": ("step rate: the highest line of the spectrum of |a|", "Hz"),
        "std_mps2": ("standard deviation of |a|", "m/s²"),
        "high_mps2": ("99.5 % quantile of |a|", "m/s²"),
        "f1_share": ("part of the power of |a| in the line of the step rate", ""),
        "harmonic": ("power of the line at twice the step rate over that at the step rate", ""),
        "subharmonic": ("power of the line of strides over that of steps", ""),
        "high_share": ("part of the power of |a| above 6 Hz", ""),
    }
    return {key: RealismStatistic(key, what, unit, per, rule()) for key, (what, unit) in each.items()}


_STEPS: Final = (
    RealismStatistic("step_swing_g", "from peak to valley of |a| below 3 Hz", "g", "step", Distribution()),
    RealismStatistic("step_time_s", "from valley to valley", "s", "step", Distribution()),
    RealismStatistic("step_lag_2", "warped distance of a step from the one two before", "", "step", Distribution()),
)
PHONE: Final = Block(
    name="Phone in the hand",
    statistics=(
        *_rows("walk", Distribution).values(),
        RealismStatistic("turn_std_dps", "standard deviation of |ω|", "°/s", "walk", Distribution()),
        *_STEPS,
    ),
    datasets=(HAND_DATASET,),
    real=real_in_hand,
    synthetic=synthetic_in_hand,
    count=100,
    controls={
        "sine": Control("nothing above the step rate", without_overtones, "harmonic"),
        "shuffled": Control("pieces of 0.1 s in another order", shuffled, "f1_share"),
    },
    features=(
        "f1_hz",
        "std_mps2",
        "high_mps2",
        "f1_share",
        "harmonic",
        "subharmonic",
        "high_share",
        "swing_g",
        "time_s",
        "lag_2",
        "turn_std_dps",
    ),
)
_ONE_PERSON: Final = "piece of 30 s"
POCKET: Final = Block(
    name="Phone in the pocket",
    # One person's recordings are one draw of how people differ: their median has to lie among synthetic people.
    statistics=(
        *_rows(_ONE_PERSON, Figure).values(),
        RealismStatistic("swing_g", "median from peak to valley of |a| below 3 Hz", "g", _ONE_PERSON, Figure()),
        RealismStatistic("time_s", "mean from valley to valley", "s", _ONE_PERSON, Figure()),
        RealismStatistic(
            "lag_1_to_2", "distance of neighbouring steps over that of every second one", "", _ONE_PERSON, Figure()
        ),
        RealismStatistic(
            "lag_2", "median warped distance of a step from the one two before", "", _ONE_PERSON, Figure()
        ),
    ),
    datasets=(POCKET_DATASET,),
    real=real_in_pocket,
    synthetic=synthetic_in_pocket,
    count=60,
    controls={"no heels": Control("nothing above the step rate", without_heels, "harmonic")},
)
