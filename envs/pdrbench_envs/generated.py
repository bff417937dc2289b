"""What environments share whose walks are generated: ids of walks and held-out walks.

A held-out walk is drawn from numbers that a secret gives besides those of the environment. Inside an environment its
split is "heldout:<key>", with a key made of the secret; outside, the split is "heldout" and the walk has an opaque id.
"""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import hmac
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.errors import unknown_name
from pdrbench.recording import RadioMap, Recording
from pdrbench.task import HELD_OUT, Task, no_radio_map
from pdrbench.trajectory import Start

HELD_OUT_NUMBER: Final = 3  # of the split in seeds; train, val and test have 0 to 2
HELD_OUT_WALKS: Final = 8  # that a secret gives; ours
_BETWEEN: Final = ":"  # a split and its key


@dataclass(frozen=True, slots=True)
class WalkTable:
    """Walks by id.

    Attributes:
        env: Environment whose name goes into the ids of its test split.
        num_walks: By split.
    """

    env: str
    num_walks: Mapping[str, int]

    def ids(self, split: str) -> tuple[str, ...]:
        """In the order of play. Those of the test split are digests, played in their order, and tell nothing."""
        ids = self._by_number(split)
        return tuple(sorted(ids)) if split == "test" else ids

    def place_of(self, walk: str) -> tuple[str, int]:
        """Split of a walk, and its place in the order of play; raises `UnknownNameError` where there is none."""
        if walk.startswith(HELD_OUT + _BETWEEN):
            split, _, index = walk.partition("/")
            return split, int(index)
        places = {walk: (split, index) for split in self.num_walks for index, walk in enumerate(self.ids(split))}
        if walk not in places:
            raise unknown_name(f"walk of {self.env}", walk, places)
        return places[walk]

    def _by_number(self, split: str) -> tuple[str, ...]:
        names = [f"{split}-{index:02d}" for index in range(self.num_walks[split])]
        if split != "test":
            return tuple(names)
        return tuple(f"test-{hashlib.sha256(f'{self.env}/{name}'.encode()).hexdigest()[:12]}" for name in names)


def kind_of(split: str) -> str:
    """A split without its key.

    >>> kind_of("test"), kind_of("heldout:3f00")
    ('test', 'heldout')
    """
    return split.partition(_BETWEEN)[0]


def entropy_of(split: str) -> list[int]:
    """What seeds of held-out walks have besides; nothing for a public split.

    >>> entropy_of("test"), entropy_of("heldout:0100000002000000")
    ([], [1, 2])
    """
    key = bytes.fromhex(split.partition(_BETWEEN)[2])
    return [int(word) for word in np.frombuffer(key, dtype="<u4")]


def with_held_out(task: Task, env: str = "") -> Task:
    """The same task, which a secret can give held-out walks.

    Args:
        task: Whose `load` asks a `WalkTable` for the place of a walk, and takes `entropy_of` its split into its seeds.
        env: That the walks are drawn for, where two environments share them; else the task's own.
    """
    return dataclasses.replace(task, held_out=functools.partial(_hold_out, task, env or task.id))


def _hold_out(task: Task, env: str, secret: str) -> Task:
    key = hmac.new(secret.encode(), env.encode(), hashlib.sha256).hexdigest()
    inner = {
        f"{HELD_OUT}-{hashlib.sha256(f'{key}/{index}'.encode()).hexdigest()[:12]}": f"{HELD_OUT}{_BETWEEN}{key}/{index}"
        for index in range(HELD_OUT_WALKS)
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
        load=load,
        tell_start=tell_start,
        radio_map=no_radio_map if task.radio_map is no_radio_map else radio_map,
    )
