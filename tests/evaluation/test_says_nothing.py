"""What a localizer is handed before a walk says neither of which split the walk is nor where it stands in it.

A classifier is trained on everything that a briefing and a generator hold but the floor plan, and asked of walks that
share neither building nor person with those that it was trained on. Where names tell, it is right nearly always.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom
from sklearn.feature_extraction import DictVectorizer
from sklearn.tree import DecisionTreeClassifier

from pdrbench.evaluation.randomness import generator, secret_nonce
from pdrbench.recording import Recording
from pdrbench.registry import make_task
from pdrbench.task import HELD_OUT, Task

SECRET = hashlib.sha256(b"a classifier knows nothing").hexdigest()  # fixed: guesses share trees, so they vary more
NUM_WALKS = 6  # of each split
ENV = "CampusStride-v1"
ALPHA = 1e-3  # so rarely a classifier that knows nothing is as often right as that
BOUNDS = (-1.0, -0.5, 0.0, *(m * 10.0**k for k in range(-3, 16) for m in (1, 2, 5)), *range(3, 13))
Handed = dict[str, Any]  # what a localizer is handed before a walk, flat


@dataclasses.dataclass(frozen=True)
class Case:
    """One walk."""

    split: str
    place: float  # in the order of the split, from 0 to 1
    building: str  # its digest
    person: str  # empty where nothing is known of the person
    handed: Handed
    name: str  # of the building, which is not handed over
    number: int  # in the order of its split

    def is_related(self, other: Case) -> bool:
        """True where the same building or person, or the walk itself, would be recognised."""
        return other is self or self.building == other.building or (self.person != "" and self.person == other.person)


def handed(task: Task, recording: Recording) -> Handed:
    """Everything a localizer is given but the floor plan."""
    briefing = task.brief(recording)
    seeds = generator(0, task, recording.id, secret_nonce(SECRET + recording.id))
    return flat(
        {
            "building": "" if briefing.building is None else briefing.building.name,
            "sensors": {name: dataclasses.asdict(spec) for name, spec in briefing.sensors.items()},
            "order": ", ".join([*briefing.sensors, *briefing.subject]),
            "period": briefing.period_s,
            "start": None if briefing.start is None else {"level": briefing.start.level, "r": briefing.start.radius_m},
            "heading": None if briefing.start is None else briefing.start.heading_rad,
            "survey": None if briefing.radio_map is None else survey(briefing.radio_map),
            "subject": briefing.subject,
            "mounting": briefing.mounting,
            "generator": str(seeds.bit_generator.seed_seq),
            "drawn": seeds.random(3),
        }
    )


def survey(radio_map: Any) -> Mapping[str, Any]:
    points = np.unique(radio_map.access_point)
    return {
        "ids": points[:3],
        "walks": [radio_map.walk[:2], np.unique(np.diff(np.unique(radio_map.walk)))],
        "age": np.quantile(radio_map.age_s, [0, 0.5, 1]),
        "surveyed": radio_map.surveyed,
    }


def flat(value: Any, path: str = "") -> Handed:
    if isinstance(value, Mapping):
        return {key: leaf for name, part in value.items() for key, leaf in flat(part, f"{path}.{name}").items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return {key: leaf for k, part in enumerate(value) for key, leaf in flat(part, f"{path}.{k}").items()}
    return {path: value}


def words(of: Handed) -> Iterator[str]:
    """Marks of what was handed over: the words of texts, and of numbers their size and their last digit."""
    for path, value in of.items():
        if value is None or isinstance(value, (bool, np.bool_)):
            yield f"{path} is {value}"
            continue
        text = str(value)
        numbers = re.findall(r"-?\d+", text) if isinstance(value, str) else [text]
        yield from (f"{path}={word}" for word in {text, *re.findall(r"\w+", text)})
        for k, number in enumerate(numbers[:8]):
            yield f"{path} {k} ends in {number[-1]}"
            yield from (f"{path} {k} > {bound}" for bound in BOUNDS if float(number) > bound)


@functools.cache
def cases() -> list[Case]:
    task, found = make_task(ENV, SECRET), []
    for split in ("train", "test", HELD_OUT):
        walks = task.split(split)
        for k in np.unique(np.linspace(0, len(walks) - 1, NUM_WALKS).astype(int)):
            recording = task.load(walks[k])
            building = "" if recording.building is None else recording.building.unnamed().sha256
            person = str(sorted(recording.subject.items())) if recording.subject else ""
            name = "" if recording.building is None else recording.building.name
            found.append(Case(split, k / len(walks), building, person, handed(task, recording), name, k))
    return found


def nothing(_: Case) -> Handed:
    """What stands in none of what is handed over."""
    return {}


def name(case: Case) -> Handed:
    return {"name": case.name}


def rising(case: Case) -> Handed:
    """A number that rises along the split, as those of files do."""
    return {"number": round(100 * case.place)}


def seeds(case: Case) -> Handed:
    """What the seed sequence of a generator gave away when it was handed over as it was made."""
    return {"generator": f"SeedSequence({case.number}, {case.split})"}


def guessed(of: list[Case], leak: Callable[[Case], Handed], label: Callable[[Case], str]) -> tuple[int, int, float]:
    """Number of walks whose label is guessed from other walks; of how many; frequency of the most frequent label."""
    labels = np.array([label(case) for case in of])
    marks = DictVectorizer().fit_transform([dict.fromkeys(words(case.handed | leak(case)), 1) for case in of])
    hits = 0
    for k, case in enumerate(of):
        apart = np.array([not case.is_related(other) for other in of])
        judge = DecisionTreeClassifier(max_depth=3, class_weight="balanced", random_state=0)
        hits += labels[k] == judge.fit(marks[apart], labels[apart]).predict(marks[k])[0]
    return hits, len(of), float(np.unique(labels, return_counts=True)[1].max() / len(of))


def surplus(leak: Callable[[Case], Handed], label: Callable[[Case], str]) -> float:
    """Right guesses beyond those that chance explains."""
    hits, num, chance = guessed(cases(), leak, label)
    return float(hits - binom.ppf(1 - ALPHA, num, chance))


def split(case: Case) -> str:
    return case.split


def half(case: Case) -> str:
    return "second" if case.place >= 0.5 else "first"


@pytest.mark.parametrize("label", [split, half])
def test_a_classifier_knows_no_more_than_chance(label: Callable[[Case], str]) -> None:
    assert surplus(nothing, label) <= 0


@pytest.mark.parametrize(("leak", "label"), [(name, split), (seeds, split), (rising, half)])
def test_the_same_classifier_finds_what_names_and_seeds_tell(
    leak: Callable[[Case], Handed], label: Callable[[Case], str]
) -> None:
    assert surplus(leak, label) > 0
