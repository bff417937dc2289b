"""One stored walk as a page that plays it: estimates and particles, observation by observation."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.errors import ResultError
from pdrbench.evaluation import Frame, retrace
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.gym.walks import reference_at
from pdrbench.localizer import Estimate
from pdrbench.metrics.hold import HOLD_SLACK_S, hold_at
from pdrbench.recording import Recording
from pdrbench.registry import make_task
from pdrbench.result import Result, shown_name
from pdrbench.trajectory import Estimates, Start, Trajectory
from pdrbench_formats.replays.view import Dots, dots_of

FPS: Final = 10  # frames a second
STORED_M: Final = 2e-4  # positions are stored to 0.1 mm
FRAME_S: Final = 1.0  # of the walk between two frames, by default
MAX_FRAMES: Final = 600  # by default
MAX_DOTS: Final = 3000  # a frame of a page


@dataclass(frozen=True, slots=True)
class ReplayFrame:
    """What one frame shows.

    Attributes:
        now_s: Seconds from the start of the walk.
        estimate: The answer; None where it counts as missing.
        dots: Particles, thinned; None of a localizer that shows none.
        num_particles: How many there were before thinning; None where the localizer does not show it.
        num_clusters: As the localizer shows it; None where it does not.
        reference: (3,) `x_m, y_m, level` at `now_s`; NaN before the first and after the last reference position.
        error_m: Horizontal distance at the last reference position up to now from the estimate in force then; NaN where
            there was none.
        is_level_right: Whether that estimate was on the level of that position.
    """

    now_s: float
    estimate: Estimate | None
    dots: Dots | None
    num_particles: int | None
    num_clusters: int | None
    reference: FloatArray
    error_m: float
    is_level_right: bool


@dataclass(frozen=True, slots=True)
class WalkReplay:
    """A walk that is to be shown.

    Attributes:
        result: What was stored.
        recording: The walk, with its reference.
        index: (K,) int, observations that become frames, `every` apart.
        every: Observations between two frames.
        period_s: Time between observations.
        fps: Frames a second.
    """

    result: Result
    recording: Recording
    index: IntArray
    every: int
    period_s: float
    fps: int

    def __len__(self) -> int:
        """Number of frames."""
        return len(self.index)

    @property
    def span_s(self) -> float:
        """Seconds of the walk that are shown."""
        return len(self) * self.every * self.period_s

    @property
    def title(self) -> str:
        """Localizer, environment, walk and seed."""
        result = self.result
        name = shown_name(result.localizer, result.division)
        return f"{name} on {result.env}, {result.split} walk {result.walk}, seed {result.seed}"

    def shots(self, max_dots: int = MAX_DOTS, *, strict: bool = True) -> Iterator[ReplayFrame]:
        """The frames, one after the other, as the localizer is played once more.

        Args:
            max_dots: Particles kept of each frame.
            strict: As for `retrace`.
        """
        estimates, reference = self.result.estimates, self.recording.reference
        now_s = estimates.t_s[self.index]
        rows = zip(shown_reference(reference, now_s), *errors_at(estimates, reference, now_s), strict=True)
        wanted = dict(zip(self.index.tolist(), rows, strict=True))
        with contextlib.closing(retrace(self.result, strict=strict, only=wanted)) as frames:
            for frame in frames:
                place, error_m, is_level_right = wanted[frame.index]
                dots = dots_of(frame.debug, self.recording.building)
                yield ReplayFrame(
                    now_s=frame.now_s,
                    estimate=frame.estimate,
                    dots=None if dots is None else dots.thinned(max_dots),
                    num_particles=_count(frame, "num_particles", "particles_xy_m"),
                    num_clusters=_count(frame, "num_clusters"),
                    reference=place,
                    error_m=float(error_m) if _is_stored(frame, estimates) else math.nan,
                    is_level_right=bool(is_level_right),
                )
                if frame.index == self.index[-1]:
                    return


def _count(frame: Frame, name: str, of: str = "") -> int | None:
    """A number that the localizer shows, else how many rows another array of it has."""
    if name in frame.debug:
        return int(frame.debug[name])
    return len(frame.debug[of]) if of in frame.debug else None


def _is_stored(frame: Frame, stored: Estimates) -> bool:
    """Whether a position is the stored one, whose error is known; another one can only come up after a warning."""
    played = np.full(2, np.nan) if frame.estimate is None else frame.estimate.xy_m
    return np.allclose(played, stored.xy_m[frame.index], rtol=0.0, atol=STORED_M, equal_nan=True)


def plan_replay(
    result: Result, *, fps: int = FPS, from_s: float = 0.0, to_s: float = math.inf, every: int | None = None
) -> WalkReplay:
    """Chooses the observations that become frames.

    Args:
        result: A stored walk.
        fps: Frames a second.
        from_s: First second of the walk to show.
        to_s: Last one.
        every: Observations between two frames; None: a second of the walk, more where that gives over 600 frames.

    Raises:
        ResultError: Nothing was answered between `from_s` and `to_s`.
    """
    task = make_task(result.task)
    t_s = result.estimates.t_s
    is_in: BoolArray = (t_s >= from_s) & (t_s <= to_s)
    if not is_in.any():
        ends = f"its answers are from {t_s[0]:g} s to {t_s[-1]:g} s" if len(t_s) else "it has no answers"
        raise ResultError(f"walk {result.walk!r} has nothing to show from {from_s:g} s to {to_s:g} s; {ends}")
    if every is None:
        every = max(1, round(FRAME_S / task.period_s), math.ceil(np.count_nonzero(is_in) / MAX_FRAMES))
    index = np.flatnonzero(is_in)[::every]
    return WalkReplay(result, task.load(result.walk), index, every, task.period_s, fps)


def shown_reference(reference: Trajectory, t_s: FloatArray) -> FloatArray:
    """(N, 3) `x_m, y_m, level` at `t_s` (N,) as `reference_at`; NaN before the first and after the last position."""
    rows = reference_at(reference, t_s)
    if rows is None:
        return np.full((len(t_s), 3), np.nan)
    rows[(t_s < reference.t_s[0]) | (t_s > reference.t_s[-1])] = np.nan
    return rows


def errors_at(estimates: Estimates, reference: Trajectory, t_s: FloatArray) -> tuple[FloatArray, BoolArray]:
    """The error at the last reference position, surveyed or not, up to each of increasing times `t_s` (N,).

    Answers are held until the next one, as in scoring.

    Returns:
        error_m: (N,) NaN before the first reference position, and where nothing had been answered.
        is_level_right: (N,).
    """
    error_m, is_level_right = np.full(len(t_s), np.nan), np.zeros(len(t_s), dtype=bool)
    row = np.searchsorted(reference.t_s, t_s + HOLD_SLACK_S, side="right") - 1
    known = row >= 0
    if not known.any():
        return error_m, is_level_right
    held = hold_at(estimates, reference.t_s, Start(np.zeros(2), 0))
    offset_m = held.xy_m - reference.xy_m
    distance_m = np.where(held.is_answer, np.hypot(offset_m[:, 0], offset_m[:, 1]), np.nan)
    error_m[known] = distance_m[row[known]]
    is_level_right[known] = (held.level == reference.level)[row[known]]
    return error_m, is_level_right
