"""Whether people who were not seen tell recorded phones from those of a population of synthetic people.

A classifier is judged on people it has not seen (`classifier.separability`): on those that no parameter was fitted to.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from pdrbench.datasets import dataset, find
from pdrbench.geometry import FloatArray
from pdrbench_formats.recordings import getsensordata
from pdrbench_lab.realism import phone_gait
from pdrbench_lab.realism.block import Block, Part, Values
from pdrbench_lab.realism.classifier import PERSON
from pdrbench_lab.realism.phone import POCKET_DATASET as STEPS_DATASET
from pdrbench_lab.realism.phone import phone_rows_of, summary
from pdrbench_lab.realism.phone_walks import DATASET as HAND_DATASET
from pdrbench_lab.realism.phone_walks import recorded_walks
from pdrbench_sim.buildings.mall import make_mall
from pdrbench_sim.people.walker import WalkParams
from pdrbench_sim.phone.population import KINDS, draw_bearer
from pdrbench_sim.record import IN_HAND, make_scene, simulate_walk

MUSEUM_DATASET: Final = "ipin2023_track3"
PIECE_S: Final = 30.0  # recordings are cut into pieces of this length, or of their own if they are shorter
MIN_PIECE_S: Final = 12.0
SETTLE_S: Final = 2.0  # of a synthetic walk, before the person goes
STILL_MPS2: Final = 0.35  # ours: standard deviation of the magnitude in a second of standing
WALKED: Final = 0.85  # ours: part of the seconds of a piece in which the person walks
HAND_KINDS: Final = ("usual", "gentle", "slow", "other phone")  # in turn
IN_HAND_POSITIONS: Final = ("InHand",)
FEATURES: Final = (
    *("f1_hz", "std_mps2", "high_mps2", "f1_share", "harmonic", "subharmonic", "high_share"),
    *("swing_g", "time_s", "lag_2", "lag_1_to_2"),
)


def by_people(people: Mapping[int, Iterable[FloatArray]]) -> Values:
    """Statistics of the pieces of every recording in which people walk, and under `PERSON` whose each is.

    Args:
        people: Accelerometer rows (n, 4) of every recording of each person, by the number of the person.
    """
    found = {}
    for number, recordings in people.items():
        pieces = [(piece, None) for rows in recordings for piece in walked_pieces(rows)]
        if pieces:
            found[number] = summary(pieces)
    columns = {name: np.concatenate([values[name] for values in found.values()]) for name in FEATURES}
    return columns | {PERSON: np.concatenate([np.full(len(v[FEATURES[0]]), float(n)) for n, v in found.items()])}


def walked_pieces(rows: FloatArray) -> Iterator[FloatArray]:
    """Pieces of a recording, all of one length, in which the person walks nearly all of the time."""
    length_s = min(PIECE_S, float(rows[-1, 0] - rows[0, 0]))
    if length_s < MIN_PIECE_S:
        return
    count = int((rows[-1, 0] - rows[0, 0]) / length_s + 1e-9)
    for start, end in itertools.pairwise(np.searchsorted(rows[:, 0], rows[0, 0] + length_s * np.arange(count + 1))):
        piece = rows[start:end]
        length = np.linalg.norm(phone_gait.resampled(piece), axis=1)
        second = round(phone_gait.RATE_HZ)
        still = length[: len(length) // second * second].reshape(-1, second).std(axis=1) < STILL_MPS2
        if np.mean(still) < 1 - WALKED:
            yield piece


def _of_museum() -> Iterator[FloatArray]:
    """Rows of the walks between the landmarks of a museum, without the minute of preparation."""
    for file in sorted(dataset(MUSEUM_DATASET).files, key=lambda file: file.path):
        if "TrainingTrial" in file.path and file.path.endswith(".txt"):
            log = getsensordata.read(find(MUSEUM_DATASET) / file.path)
            yield log.rows["accel"][log.rows["accel"][:, 0] > log.reference.t_s[0]]


def real_in_hand(part: Part) -> Values:
    """Surveyors of shopping centres, the people of `phone_steps`, those in the museum.

    Judged are the surveyors' other walks, the second person and the museum; the walks of site 1 and the first person,
    which parameters were fitted to, may be learned from.
    """
    fitted: dict[int, Iterable[FloatArray]] = {-1: _surveyors("fit"), -2: phone_rows_of(IN_HAND_POSITIONS, "fit")}
    if part == "fit":
        return by_people({0: fitted[-1], 1: fitted[-2]})
    return by_people(fitted | {0: _surveyors("judge"), 1: phone_rows_of(IN_HAND_POSITIONS, "judge"), 2: _of_museum()})


def _surveyors(part: Part) -> Iterator[FloatArray]:
    return (walk.streams["accel"].rows for walk in recorded_walks(part))


@functools.lru_cache(maxsize=4)
def _walks(kinds: tuple[str, ...], seed: int, count: int) -> tuple[FloatArray, ...]:
    """Rows of one walk of each of so many synthetic people, kinds in turn."""
    scene = make_scene(np.random.default_rng([seed, 0]), make_mall(np.random.default_rng([seed, 1])))
    found = []
    for number in range(count):
        bearer = draw_bearer(np.random.default_rng([seed, 2, number]), KINDS[kinds[number % len(kinds)]])
        setup = replace(IN_HAND, mounting=bearer.mounting, sensors=("accel",), manner=bearer.manner)
        onward: WalkParams = replace(bearer.walk, pause_every_s=1e4, stop_fraction=0.1)
        walk = simulate_walk(
            scene, [seed, 3, number], setup, duration_s=PIECE_S + SETTLE_S + 1, person=bearer.person, walk=onward
        )
        rows = walk.streams["accel"].rows
        found.append(rows[rows[:, 0] > SETTLE_S])
    return tuple(found)


def synthetic_in_hand(seed: int, count: int) -> Values:
    """One walk of each of so many people, kinds in turn."""
    return by_people({number: [rows] for number, rows in enumerate(_walks(HAND_KINDS, seed, count))})


HAND: Final = Block(
    name="Phones of other people",
    statistics=(),
    datasets=(HAND_DATASET, STEPS_DATASET, MUSEUM_DATASET),
    real=real_in_hand,
    synthetic=synthetic_in_hand,
    count=80,
    features=FEATURES,
)
