"""Accelerometer and gyroscope of a phone in the hand and of one in a trouser pocket: real and synthetic walks."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, Final

import numpy as np

from pdrbench.datasets import dataset
from pdrbench.errors import DatasetError
from pdrbench.geometry import FloatArray
from pdrbench.recording import Recording
from pdrbench_lab.readers import phone_steps
from pdrbench_lab.readers.registered_files import locate
from pdrbench_lab.realism import phone_gait
from pdrbench_lab.realism.block import Block, Control, Distribution, Figure, Part, Values, clustered, statistics
from pdrbench_lab.realism.malls import mall_walks
from pdrbench_lab.realism.phone_walks import DATASET as HAND_DATASET
from pdrbench_lab.realism.phone_walks import recorded_walks
from pdrbench_sim.buildings.mall import make_mall
from pdrbench_sim.record import IN_POCKET, make_scene, simulate_walk
from pdrbench_sim.units.motion import GRAVITY_MPS2

POCKET_DATASET: Final = "phone_steps"
POCKET_FIT_SUBJECT: Final = "A"  # of the two people; the other one judges
POCKETS: Final = ("FrontPocket", "BackPocket")
POCKET_PIECE_S: Final = 30.0  # recordings of three minutes are cut into pieces of this length
POCKET_WALK_S: Final = 62.0  # of a synthetic walk: two pieces


def summary(walks: Iterable[tuple[FloatArray, FloatArray | None]]) -> Values:
    """Statistics of walks, each of them the rows (n, 4) of an accelerometer and, where there is one, of a gyroscope.

    Returns:
        (walks,) numbers of every walk of `phone_gait.MIN_WALK_S` or more with three steps in it, and under the keys
        that begin with "step_" those of all steps together, which repeat within walks.
    """
    found = [row for accel, gyro in walks if (row := _summary(accel, gyro)) is not None]
    if not found:
        raise DatasetError("no walk with three steps in it: ask for more or longer walks")
    columns = {key: [row[key] for row in found] for key in found[0]}
    of_steps = [clustered(key, column) for key, column in columns.items() if key.startswith("step_")]
    of_walks = {key: np.array(column) for key, column in columns.items() if not key.startswith("step_")}
    return functools.reduce(dict.__or__, of_steps, of_walks)


def _summary(accel_rows: FloatArray, gyro_rows: FloatArray | None) -> dict[str, Any] | None:
    """Numbers of one walk, and (S,) of its steps; None where it is too short."""
    if accel_rows[-1, 0] - accel_rows[0, 0] < phone_gait.MIN_WALK_S:
        return None
    length = np.linalg.norm(phone_gait.resampled(accel_rows), axis=1)
    time_s, swing_mps2, lag_1, lag_2 = phone_gait.steps(length)
    if not len(lag_2):
        return None
    found = phone_gait.lines(length) | {
        "std_mps2": float(length.std()),
        "high_mps2": float(np.quantile(length, 0.995)),
        "swing_g": float(np.median(swing_mps2)) / GRAVITY_MPS2,
        "time_s": float(time_s.mean()),
        "lag_2": float(np.median(lag_2)),
        "lag_1_to_2": float(np.median(lag_1) / max(float(np.median(lag_2)), 1e-9)),
    }
    if gyro_rows is not None:
        found["turn_std_dps"] = np.degrees(np.linalg.norm(phone_gait.resampled(gyro_rows), axis=1)).std()
    return {**found, "step_time_s": time_s, "step_swing_g": swing_mps2 / GRAVITY_MPS2, "step_lag_2": lag_2}


# In the hand.


def _in_hand(walks: Iterable[Recording], change: Callable[[int, FloatArray], FloatArray] | None = None) -> Values:
    """Statistics of walks; `change` is applied to the number of each and its accelerometer rows."""
    return summary(
        (rows if change is None else change(number, rows), walk.streams["gyro"].rows)
        for number, walk in enumerate(walks)
        for rows in [walk.streams["accel"].rows]
    )


def real_in_hand(part: Part) -> Values:
    """Walks of surveyors in shopping centres: those of site 1 marked train, or all others."""
    return _in_hand(recorded_walks(part))


def synthetic_in_hand(seed: int, count: int) -> Values:
    """Synthetic surveyors in synthetic shopping centres."""
    return _in_hand(mall_walks(seed, count))


def without_overtones(seed: int, count: int) -> Values:
    """The same walks without anything above the step rate: the accelerations of a sine."""
    return _in_hand(mall_walks(seed, count), lambda number, rows: _sine_like(rows))


def shuffled(seed: int, count: int) -> Values:
    """The same walks in pieces of 0.1 s, put together in another order."""

    def shuffle(number: int, rows: FloatArray) -> FloatArray:
        pieces = np.array_split(np.arange(len(rows)), max(len(rows) // 5, 1))
        order = np.random.default_rng([seed, number]).permutation(len(pieces))
        return np.column_stack([rows[:, 0], rows[np.concatenate([pieces[i] for i in order]), 1:]])

    return _in_hand(mall_walks(seed, count), shuffle)


def _sine_like(rows: FloatArray) -> FloatArray:
    from scipy.signal import butter, sosfiltfilt

    smooth = rows.copy()
    rate_hz = 1 / float(np.median(np.diff(rows[:, 0])))
    smooth[:, 1:] = sosfiltfilt(butter(4, 2.8, fs=rate_hz, output="sos"), rows[:, 1:], axis=0)
    return smooth


# In the pocket.


def real_in_pocket(part: Part) -> Values:
    """Pieces of the walks of one person, with the phone in a front or a back pocket; the other person's judge."""
    return _in_pocket(phone_rows_of(POCKETS, part))


def _in_pocket(recordings: Iterable[FloatArray]) -> Values:
    return summary((piece, None) for rows in recordings for piece in _pieces(rows))


def phone_rows_of(positions: Sequence[str], part: Part) -> Iterator[FloatArray]:
    """(n, 4) accelerometer rows of every recording of `phone_steps` with the phone in these positions."""
    found = locate(POCKET_DATASET)
    for file in sorted(dataset(POCKET_DATASET).files, key=lambda file: file.path):
        if file.facts.get("position") not in positions or "accelerometer" not in file.path or file.path not in found:
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
    return _in_pocket(_pocket_walks(seed, count))


def without_heels(seed: int, count: int) -> Values:
    """The same walks without what is above 2.8 Hz: no heel strikes, no overtones."""
    return _in_pocket(map(_sine_like, _pocket_walks(seed, count)))


_OF_WALK: Final = (  # of a phone in the hand and of one in the pocket
    ("f1_hz", "step rate: the highest line of the spectrum of |a|", "Hz"),
    ("std_mps2", "standard deviation of |a|", "m/s²"),
    ("high_mps2", "99.5 % quantile of |a|", "m/s²"),
    ("f1_share", "part of the power of |a| in the line of the step rate", ""),
    ("harmonic", "power of the line at twice the step rate over that at the step rate", ""),
    ("subharmonic", "power of the line of strides over that of steps", ""),
    ("high_share", "part of the power of |a| above 6 Hz", ""),
)
PHONE: Final = Block(
    name="Phone in the hand",
    statistics=(
        *statistics("walk", Distribution(), *_OF_WALK, ("turn_std_dps", "standard deviation of |ω|", "°/s")),
        *statistics(
            "step",
            Distribution(),
            ("step_swing_g", "from peak to valley of |a| below 3 Hz", "g"),
            ("step_time_s", "from valley to valley", "s"),
            ("step_lag_2", "warped distance of a step from the one two before", ""),
        ),
    ),
    datasets=(HAND_DATASET,),
    real=real_in_hand,
    synthetic=synthetic_in_hand,
    count=100,
    controls={
        "sine": Control("nothing above the step rate", without_overtones, "harmonic"),
        "shuffled": Control("pieces of 0.1 s in another order", shuffled, "f1_share"),
    },
    features=(*(name for name, _, _ in _OF_WALK), "swing_g", "time_s", "lag_2", "turn_std_dps"),
)
POCKET: Final = Block(
    name="Phone in the pocket",
    statistics=statistics(
        "piece of 30 s",
        Figure(),  # one person's recordings are one draw of how people differ: their median lies among synthetic people
        *_OF_WALK,
        ("swing_g", "median from peak to valley of |a| below 3 Hz", "g"),
        ("time_s", "mean from valley to valley", "s"),
        ("lag_1_to_2", "distance of neighbouring steps over that of every second one", ""),
        ("lag_2", "median warped distance of a step from the one two before", ""),
    ),
    datasets=(POCKET_DATASET,),
    real=real_in_pocket,
    synthetic=synthetic_in_pocket,
    count=60,
    controls={"no heels": Control("nothing above the step rate", without_heels, "harmonic")},
)
