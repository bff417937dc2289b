"""A walk laid out for stepping, and the order in which walks are played."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from pdrbench.episode import NUM_ANSWER_COLUMNS, delivery_table, estimates_from_rows
from pdrbench.errors import RecordingError, UnknownNameError, unknown_name
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.gym.spaces import ANSWER_COLUMNS
from pdrbench.localizer import Briefing
from pdrbench.recording import Recording
from pdrbench.result import Result
from pdrbench.task import Task
from pdrbench.trajectory import Trajectory

LEVEL_PENALTY_M: Final = 15.0  # per level; IPIN and Kaggle indoor location
LEAST_CONVERGED: Final = 0.5  # an action that claims this much or more claims to have converged
LOCALIZER_NAME: Final = "env.step"
ROWS_AHEAD_BYTES: Final = 4096  # an observation of a sensor up to this size is padded ahead, a larger one as it comes


@dataclass(frozen=True, slots=True)
class Replay:
    """One walk, ready to be stepped through. Row K stands for the end: nothing new, and the last time again.

    Attributes:
        walk: Walk id.
        briefing: What a localizer is told.
        now_s: (K + 1,) time of each observation.
        ends: Per sensor (K + 2,), observation k owns the rows `ends[k]:ends[k + 1]`.
        rows: Per sensor (R, C).
        target: (K, 3) `x_m, y_m, level` of the reference at each observation; None where nothing is rewarded.
        fallback: `x_m, y_m, level` that counts until the first estimate is given.
    """

    walk: str
    briefing: Briefing
    now_s: FloatArray
    ends: Mapping[str, IntArray]
    rows: Mapping[str, FloatArray]
    target: FloatArray | None = field(repr=False)
    fallback: tuple[float, float, float]

    def __len__(self) -> int:
        """Number of observations to answer."""
        return len(self.now_s) - 1


def lay_out(recording: Recording, task: Task, *, rewarded: bool) -> Replay:
    """Everything that stepping through `recording` needs, computed once."""
    now_s, ends = delivery_table(recording, task)
    rows = {}
    for spec in task.sensors:
        stream = recording.streams.get(spec.name)
        rows[spec.name] = np.zeros((0, len(spec.columns))) if stream is None else stream.rows
    briefing = task.brief(recording)
    return Replay(
        walk=recording.id,
        briefing=briefing,
        now_s=np.append(now_s, now_s[-1]),
        ends={name: np.append(end, end[-1]) for name, end in ends.items()},
        rows=rows,
        target=reference_at(recording.reference, now_s) if rewarded and len(recording.reference) else None,
        fallback=_fallback(briefing),
    )


def reference_at(reference: Trajectory, t_s: FloatArray) -> FloatArray:
    """(N, 3) `x_m, y_m, level` at `t_s` (N,): position interpolated linearly, level of the row nearest in time."""
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


def _fallback(briefing: Briefing) -> tuple[float, float, float]:
    """Where a silent localizer counts as being: at the start, else in the middle of the map, else at the origin."""
    start = briefing.start
    if start is None and briefing.building is not None:
        start = briefing.building.centre()
    if start is None:
        return 0.0, 0.0, 0.0
    return float(start.xy_m[0]), float(start.xy_m[1]), float(start.level)


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


def make_result(
    task: Task, replay: Replay, split: str, answers: FloatArray, claims: Sequence[str], step_s: FloatArray
) -> Result:
    """What was answered so far, without the truth.

    Args:
        task: Played.
        replay: Walk of it.
        split: The walk belongs to.
        answers: (N, 3 + claims) actions as they came.
        claims: Of the environment.
        step_s: (N,) wall time each answer took, NaN where nobody measured.
    """
    given = np.isfinite(answers[:, :3]).all(axis=1)
    rows = np.full((len(answers), NUM_ANSWER_COLUMNS), np.nan)
    rows[:, :2] = answers[:, :2]
    rows[:, 2] = np.rint(answers[:, 2])
    rows[:, [ANSWER_COLUMNS[claim] for claim in claims]] = answers[:, 3:]
    converged = rows[:, ANSWER_COLUMNS["converged"]]
    converged[:] = np.where(np.isnan(converged), np.nan, converged >= LEAST_CONVERGED)
    rows[~given] = np.nan
    num_missing = int((~given).sum())
    return Result(
        env=task.id,
        split=split,
        walk=replay.walk,
        localizer=LOCALIZER_NAME,
        seed=0,
        estimates=estimates_from_rows(replay.now_s[: len(answers)], rows),
        step_s=step_s,
        missing={"nan": num_missing} if num_missing else {},
    )


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
    """The walk that reset options ask for by id or index; None where they ask for none.

    Args:
        options: As given to `reset`.
        walks: Walk ids of the split.
        where: Names environment and split in an error.
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
