"""The order in which walks are played, and what environments with one walk and with many have in common."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from pdrbench.episode import Episode
from pdrbench.errors import RecordingError, UnknownNameError, unknown_name
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.trajectory import Trajectory

LEVEL_PENALTY_M: Final = 15.0  # per level; IPIN and Kaggle indoor location
LOCALIZER_NAME: Final = "env.step"
ROWS_AHEAD_BYTES: Final = 4096  # an observation of a sensor up to this size is padded ahead, a larger one as it comes


def reference_at(reference: Trajectory, t_s: FloatArray) -> FloatArray | None:
    """(N, 3) `x_m, y_m, level` at `t_s` (N,): position interpolated linearly, level of the row nearest in time."""
    if not len(reference):
        return None
    after = np.searchsorted(reference.t_s, t_s).clip(0, len(reference) - 1)
    before = np.maximum(after - 1, 0)
    is_before = np.abs(t_s - reference.t_s[before]) <= np.abs(reference.t_s[after] - t_s)
    return np.column_stack(
        [
            np.interp(t_s, reference.t_s, reference.xy_m[:, 0]),
            np.interp(t_s, reference.t_s, reference.xy_m[:, 1]),
            reference.level[np.where(is_before, before, after)],
        ]
    )


def target_of(episode: Episode, split: str) -> FloatArray | None:
    """(K, 3) what the estimates of an episode are rewarded against; None where nothing is rewarded."""
    return None if split == "test" else reference_at(episode.recording.reference, episode.now_s[:-1])


def is_small(capacity: int, num_columns: int) -> bool:
    """True where observations of a sensor are padded ahead of their time."""
    return capacity * num_columns * 8 <= ROWS_AHEAD_BYTES


def pad(rows: FloatArray, first: IntArray, count: IntArray, out: FloatArray) -> None:
    """Writes runs of rows into frames.

    Args:
        rows: (R, C).
        first: (N,) row each run begins with.
        count: (N,) rows of each run, at most `capacity`.
        out: (N, capacity, C) zeros.
    """
    longest = int(count.max(initial=0))
    if longest:
        within = np.arange(longest)
        runs = rows.take(first[:, None] + within, axis=0, mode="clip")
        runs[within >= count[:, None]] = 0.0
        out[:, :longest] = runs


class WalkOrder:
    """Plays the walks of a split in a shuffled order, shuffled anew after the last."""

    __slots__ = ("_left", "_rng", "_walks")

    def __init__(self, walks: Sequence[str], rng: np.random.Generator) -> None:
        self._walks, self._rng = tuple(walks), rng
        self._left: list[int] = []

    def next(self) -> str:
        """The walk to play now."""
        if not self._left:
            self._left = self._rng.permutation(len(self._walks)).tolist()
        return self._walks[self._left.pop(0)]


def chosen_walk(options: Mapping[str, object] | None, walks: Sequence[str], where: str) -> str | None:
    """The walk of a split that reset options ask for by id or index; None where they ask for none.

    `where` names environment and split in an error.
    """
    if not options:
        return None
    if not isinstance(options, Mapping):
        raise RecordingError(
            f"reset options are a dict such as {{'walk': 0}}; got {type(options).__name__} {options!r}"
        )
    for name in options:
        if name != "walk":
            raise unknown_name("reset option", str(name), ["walk"])
    walk = options["walk"]
    if isinstance(walk, str):
        if walk not in walks:
            raise unknown_name(f"walk of {where}", walk, walks)
        return walk
    if isinstance(walk, bool) or not isinstance(walk, int | np.integer):
        raise RecordingError(f"options['walk'] is a walk id or its index; got {type(walk).__name__} {walk!r}")
    if not 0 <= walk < len(walks):
        raise UnknownNameError(f"no walk {walk} of {where}; indices go from 0 to {len(walks) - 1}")
    return walks[int(walk)]
