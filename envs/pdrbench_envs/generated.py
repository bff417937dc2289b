"""What environments share whose walks are generated: their ids, seeds and held-out walks.

A held-out walk is drawn from numbers that a secret gives besides those of the environment. Inside an environment its
split is "heldout:<key>", with a key made of the secret; outside, the split is "heldout" and the walk has an opaque id.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import hmac
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.errors import unknown_name
from pdrbench.recording import RadioMap, Recording
from pdrbench.task import HELD_OUT, Task, no_survey
from pdrbench.trajectory import Start

_NUMBERS: Final = {"train": 0, "val": 1, "test": 2, HELD_OUT: 3}  # of splits in seeds
_BETWEEN: Final = ":"  # a split and its key


@dataclass(frozen=True, slots=True)
class Split:
    """How many walks a split has, in how many buildings, by how many people; none of them shared with another split.

    Where buildings or people are not counted every walk has its own, or all walks have the same.
    """

    walks: int
    buildings: int = 1
    people: int = 1


@dataclass(frozen=True, slots=True)
class GeneratedWalks:
    """The walks of an environment, and the random numbers that each of them is drawn from."""

    env: str
    seed: int  # first number of every seed
    splits: Mapping[str, Split]  # public splits by name
    held_out: Split = Split(8)  # that a secret gives; ours

    def ids(self) -> dict[str, tuple[str, ...]]:
        """By split, in the order of play. Ids of the test split are digests in rising order, which reveal nothing."""
        return _ids(self.env, tuple((split, plan.walks) for split, plan in self.splits.items()))

    def place_of(self, walk: str) -> tuple[str, int]:
        """Split of a walk, and its place in the order of play; raises `UnknownNameError` where there is none."""
        if walk.startswith(HELD_OUT + _BETWEEN):
            split, _, index = walk.partition("/")
            return split, int(index)
        places = _places(self.env, tuple((split, plan.walks) for split, plan in self.splits.items()))
        if walk not in places:
            raise unknown_name(f"walk of {self.env}", walk, places)
        return places[walk]

    def split(self, split: str) -> Split:
        """A split by its name, which has a key where its walks are held out."""
        return self.splits.get(split, self.held_out)

    def number(self, split: str) -> int:
        """Of the split in seeds and in names of buildings."""
        return _NUMBERS[split.partition(_BETWEEN)[0]]

    def numbers(self, split: str, stream: int, index: int, *more: int) -> list[int]:
        """The seed of one stream of random numbers of one walk, building or person; secret of a held-out walk."""
        return [self.seed, self.number(split), stream, index, *more, *entropy_of(split)]

    def person(self, walk: str, *, each: int = 1) -> str:
        """Name of the person of a walk, who walks `each` walks in turn; of its own where people are not counted."""
        split, index = self.place_of(walk)
        people = self.split(split).people
        return f"{split} {index // each % people if people > 1 else index // each}"

    def rng(self, split: str, stream: int, index: int) -> np.random.Generator:
        """The generator of one stream of random numbers of one walk, building or person."""
        return np.random.default_rng(self.numbers(split, stream, index))


def _ids(env: str, splits: tuple[tuple[str, int], ...]) -> dict[str, tuple[str, ...]]:
    ids = {split: tuple(f"{split}-{index:02d}" for index in range(walks)) for split, walks in splits}
    opaque = (hashlib.sha256(f"{env}/{name}".encode()).hexdigest()[:12] for name in ids["test"])
    return ids | {"test": tuple(sorted(f"test-{digest}" for digest in opaque))}


@functools.lru_cache(maxsize=32)
def _places(env: str, splits: tuple[tuple[str, int], ...]) -> dict[str, tuple[str, int]]:
    """Split and place of each walk."""
    return {walk: (split, index) for split, walks in _ids(env, splits).items() for index, walk in enumerate(walks)}


def entropy_of(split: str) -> list[int]:
    """What seeds of held-out walks have besides; nothing for a public split.

    >>> entropy_of("test"), entropy_of("heldout:0100000002000000")
    ([], [1, 2])
    """
    key = bytes.fromhex(split.partition(_BETWEEN)[2])
    return [int(word) for word in np.frombuffer(key, dtype="<u4")]


def start_pose(recording: Recording) -> Start:
    """The first row of the reference: where the foot or the body stands, and its heading."""
    reference = recording.reference
    assert reference.heading_rad is not None
    return Start(xy_m=reference.xy_m[0], level=int(reference.level[0]), heading_rad=float(reference.heading_rad[0]))


def start_place(recording: Recording) -> Start:
    """The first place of the reference without a heading."""
    return Start(xy_m=recording.reference.xy_m[0], level=int(recording.reference.level[0]))


def with_held_out(
    task: Task,
    walks: GeneratedWalks,
    *,
    person: Callable[[str], str] | None = None,
    groups: Callable[[str], tuple[str, ...]] | None = None,
) -> Task:
    """The same task, which a secret can give held-out walks, and whose start is given to the millimetre.

    Args:
        task: Whose `load` asks `walks` for the place of a walk and for its seeds.
        walks: Also of another environment, which shares them then.
        person: Name of the person of a walk, the unit of replication where all walks are in one building; else None.
        groups: Of a walk, see `Task.groups`.
    """
    task = dataclasses.replace(task, tell_start=functools.partial(_rounded_start, task.tell_start))
    if groups is not None:
        task = dataclasses.replace(task, groups={walk: groups(walk) for split in task.walks.values() for walk in split})
    if person is not None:
        units = {walk: person(walk) for walks in task.walks.values() for walk in walks}
        task = dataclasses.replace(task, units=units, unit_kind="person")
    hold_out = functools.partial(_hold_out, task, walks, person, groups)
    return dataclasses.replace(task, held_out=hold_out)


def _rounded_start(tell_start: Callable[[Recording], Start], recording: Recording) -> Start:
    from pdrbench_sim.resolution import rounded_start

    return rounded_start(tell_start(recording))


def _hold_out(
    task: Task,
    walks: GeneratedWalks,
    person: Callable[[str], str] | None,
    groups: Callable[[str], tuple[str, ...]] | None,
    secret: str,
) -> Task:
    key = hmac.new(secret.encode(), walks.env.encode(), hashlib.sha256).hexdigest()
    inner = {
        f"{HELD_OUT}-{hashlib.sha256(f'{key}/{index}'.encode()).hexdigest()[:12]}": f"{HELD_OUT}{_BETWEEN}{key}/{index}"
        for index in range(walks.held_out.walks)
    }

    def load(walk: str) -> Recording:
        return dataclasses.replace(task.load(inner.get(walk, walk)), id=walk)

    def inside(recording: Recording) -> Recording:
        return dataclasses.replace(recording, id=inner.get(recording.id, recording.id))

    def tell_start(recording: Recording) -> Start:
        return task.tell_start(inside(recording))

    def radio_map(recording: Recording) -> RadioMap | None:
        return task.radio_map(inside(recording))

    return dataclasses.replace(
        task,
        walks={**task.walks, HELD_OUT: tuple(sorted(inner))},
        units=task.units if person is None else {**task.units, **{walk: person(inner[walk]) for walk in inner}},
        groups=task.groups if groups is None else {**task.groups, **{walk: groups(inner[walk]) for walk in inner}},
        load=load,
        tell_start=tell_start,
        radio_map=no_survey if task.radio_map is no_survey else radio_map,
    )
