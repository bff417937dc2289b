"""The replay of one walk: the only place that knows both the truth and the clock."""

from __future__ import annotations

import copy
import functools
import math
import time
import traceback
from collections import Counter
from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

import numpy as np

from pdrbench.errors import EstimateError, RecordingError, UnsuitableError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.recording import Recording
from pdrbench.result import COMPLETE, FAILED, UNSUITABLE, Result
from pdrbench.task import Task
from pdrbench.trajectory import ESTIMATE_COLUMNS, Estimates, Start

CONVERGED_TYPES: Final = (bool, np.bool_, type(None))
TRUTHS: Final = (0.0, 1.0)
FIRST_ANSWERS: Final = 10  # in a row at the beginning: nobody means all of them to be missing
FAR_M: Final = 1000.0  # from the start in so few steps: degrees of Web Mercator, millimetres, another frame
EXPECTED: Final = "step returns pdrbench.Estimate(xy_m=(x, y) in metres of the plan, level=a whole number)"
RESET, STEP, REVISE = "reset", "step", "revise"  # calls into a localizer, as guards are given them
TRACK_COLUMNS: Final = ("t_s", "x_m", "y_m", "level", "sigma_m", "heading_rad")  # of `revise`
NUM_PLACE_COLUMNS: Final = 4  # of them are needed, the others are claims
REVISION_SLACK_S: Final = 0.01  # as `metrics.hold.HOLD_SLACK_S`; a score may change without changing an estimate
CLOCK_SLACK_S: Final = 5e-7  # half a microsecond, the step of generated times: k * period_s is rounded


class EstimateRow(NamedTuple):
    """What an answer says; `sigma_m` as answered, also where it makes no sense: the uncertainty metrics count those."""

    x_m: float
    y_m: float
    level: float
    heading_rad: float  # NaN where not claimed, as the next two
    sigma_m: float
    converged: float


class Player(Protocol):
    """A localizer, or what stands for one in another process: `read_estimate` checks what it answers."""

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        """Begins a walk."""

    def step(self, observation: Observation) -> object:
        """Answers one observation."""


def num_observations(end_s: float, period_s: float) -> int:
    """How many observations, at 0, period, 2 period, ..., deliver everything up to `end_s`.

    >>> num_observations(0.3, 0.2), num_observations(0.4, 0.2)
    (3, 3)
    """
    return math.ceil((end_s - CLOCK_SLACK_S) / period_s) + 1


def num_due(t_s: FloatArray, now_s: FloatArray | float) -> Any:
    """How many rows of increasing times `t_s` (R,) have been delivered at `now_s`, shaped as it."""
    return np.searchsorted(t_s, now_s + CLOCK_SLACK_S, side="right")


def delivery_table(recording: Recording, task: Task) -> tuple[FloatArray, dict[str, IntArray]]:
    """When what is handed out: at 0, period, 2 period, ... until everything recorded has been delivered.

    Rows wait where a sensor delivers more than its capacity, and come with the next observation: late, never lost.

    Returns:
        now_s: (K,) time of each observation.
        ends: Per sensor (K + 1,) int, observation k owns the rows `ends[k]:ends[k + 1]`.
    """
    now_s = np.arange(num_observations(recording.end_s, task.period_s), dtype=np.float64) * task.period_s
    ends = {}
    for spec in task.sensors:
        stream = recording.streams.get(spec.name)
        due = np.zeros(len(now_s), dtype=np.int64)
        if stream is not None:
            due = num_due(stream.t_s, now_s)
        ends[spec.name] = _limit_rise(due, task.capacity[spec.name])
        if ends[spec.name][-1] < due[-1]:
            raise RecordingError(
                f"recording {recording.id!r}: {due[-1] - ends[spec.name][-1]} rows of {spec.name!r} do not fit into "
                f"the observations; raise its capacity in task {task.id} (now {task.capacity[spec.name]})"
            )
    return now_s, ends


def _limit_rise(due: IntArray, most: int) -> IntArray:
    """(K + 1,) starts at 0 and follows `due` (K,), rising by at most `most` a step."""
    step = np.arange(1, len(due) + 1) * most
    limited = np.minimum.accumulate(np.minimum(due - step, 0)) + step
    return np.concatenate([[0], np.minimum(due, limited)])


def read_estimate(answer: object) -> EstimateRow:
    """Checks one answer of a localizer.

    Args:
        answer: An estimate, the claims of one that another process has read, or why that could not read it.

    Raises:
        EstimateError: Its first word is the reason under which the answer counts as missing.
    """
    claims = answer if isinstance(answer, EstimateRow) else _claims_of(answer)
    x_m, y_m, level, _, _, converged = claims
    if not (math.isfinite(x_m) and math.isfinite(y_m) and math.isfinite(level)):
        raise EstimateError(f"nan: position ({x_m}, {y_m}) on level {level} is not finite")
    if not level.is_integer():
        raise EstimateError(f"level: {level} is not a whole number")
    if converged not in TRUTHS and not math.isnan(converged):
        raise EstimateError(f"type: converged is 1, 0 or NaN among claims; got {converged}")
    return claims


def _claims_of(answer: object) -> EstimateRow:
    if isinstance(answer, EstimateError):
        raise answer
    if answer is None:
        raise EstimateError("nothing: the localizer returned None instead of an Estimate")
    if not isinstance(answer, Estimate):
        raise EstimateError(f"type: expected an Estimate, got {type(answer).__name__}")
    if answer.xy_m.shape != (2,):
        raise EstimateError(f"shape: xy_m has shape {answer.xy_m.shape}, expected (2,)")
    heading_rad, sigma_m, converged = answer.heading_rad, answer.sigma_m, answer.converged
    if not isinstance(converged, CONVERGED_TYPES):
        raise EstimateError(f"type: converged is True, False or None; got {converged!r}")
    try:
        x_m, y_m = answer.xy_m.tolist()
        return EstimateRow(
            x_m,
            y_m,
            float(answer.level),
            math.nan if heading_rad is None else float(heading_rad),
            math.nan if sigma_m is None else float(sigma_m),
            math.nan if converged is None else float(converged),
        )
    except (TypeError, ValueError, OverflowError) as error:
        raise EstimateError(f"type: {error}") from None


def read_track(track: object) -> FloatArray:
    """Checks what `revise` of a localizer returned.

    Returns:
        (K, 6) t_s, x_m, y_m, level, sigma_m, heading_rad; the last two NaN where not claimed.

    Raises:
        EstimateError: It is no track; says what is wrong with it.
    """
    expected = f"revise returns an array (K, 4), (K, 5) or (K, 6) with the columns {', '.join(TRACK_COLUMNS)}, or None"
    try:
        rows = np.array(track, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise EstimateError(f"{expected}; got {type(track).__name__}: {error}") from None
    if rows.ndim != 2 or not NUM_PLACE_COLUMNS <= rows.shape[1] <= len(TRACK_COLUMNS):
        raise EstimateError(f"{expected}; got the shape {rows.shape}")
    for is_wrong, what in (
        (~np.isfinite(rows[:, :NUM_PLACE_COLUMNS]).all(axis=1), "is not finite"),
        (np.concatenate([[False], rows[1:, 0] <= rows[:-1, 0]])[: len(rows)], "is not later than the one before"),
        (rows[:, 3] != np.rint(rows[:, 3]), "has a level that is no whole number"),
    ):
        if is_wrong.any():
            row = int(np.flatnonzero(is_wrong)[0])
            raise EstimateError(f"{expected}; row {row} {what}: {rows[row].tolist()}")
    claimed = np.full((len(rows), len(TRACK_COLUMNS)), np.nan)
    claimed[:, : rows.shape[1]] = rows
    return claimed


class Episode:
    """Replays a recording: `observe`, `submit`, `observe`, ... until `done`.

    >>> import pdrbench
    >>> task = pdrbench.make_task("CampusStride-v1")
    >>> episode = Episode(task.load(task.split("train")[0]), task)
    >>> observation = episode.observe()
    >>> observation.now_s
    0.0
    """

    def __init__(self, recording: Recording, task: Task) -> None:
        """Lays the walk out.

        Args:
            recording: The walk.
            task: What it belongs to.

        Attributes:
            recording: The walk, with the truth.
            task: What it belongs to.
            now_s: (K + 1,) time of each observation, the last of them again for the end.
            ends: Per sensor (K + 2,) int, observation k owns the rows `ends[k]:ends[k + 1]`; at the end there are none.
            rows: Per sensor (R, C).
        """
        self.recording, self.task = recording, task
        now_s, ends = delivery_table(recording, task)
        self.now_s = np.append(now_s, now_s[-1])
        self.ends = {name: np.append(end, end[-1]) for name, end in ends.items()}
        self.rows = {
            spec.name: recording.streams[spec.name].rows
            if spec.name in recording.streams
            else np.zeros((0, len(spec.columns)))
            for spec in task.sensors
        }
        self._times_s = now_s.tolist()
        self.is_prefix = False  # true where the walk went on
        self._begin()

    def _begin(self) -> None:
        self._step = 0
        self._awaited = False
        self._answers = np.full((len(self), len(ESTIMATE_COLUMNS)), np.nan)
        self._missing: dict[int, str] = {}  # reason by step
        self._why = ""  # the last of these answers could not be scored
        self._revised: FloatArray | None = None

    def fresh(self) -> Episode:
        """The same walk from its beginning; what was laid out is shared."""
        other = copy.copy(self)
        other._begin()
        return other

    def prefix(self, num_observations: int) -> Episode:
        """The beginning of the walk, as an episode that ends after so many observations; no past is revised there."""
        if not 1 <= num_observations <= len(self):
            raise RecordingError(f"{self!r} has no beginning of {num_observations} observations")
        other = copy.copy(self)
        other.now_s = np.append(self.now_s[:num_observations], self.now_s[num_observations - 1])
        other.ends = {
            name: np.append(end[: num_observations + 1], end[num_observations]) for name, end in self.ends.items()
        }
        other.rows = {name: rows[: other.ends[name][-1]] for name, rows in self.rows.items()}
        other._times_s = self._times_s[:num_observations]
        other.is_prefix = True
        other._begin()
        return other

    def __repr__(self) -> str:
        return f"Episode({self.task.id}, walk {self.recording.id}, step {self._step} of {len(self)})"

    def __len__(self) -> int:
        """Number of observations."""
        return len(self._times_s)

    @functools.cached_property
    def briefing(self) -> Briefing:
        """What a localizer is given before the walk."""
        return self.task.brief(self.recording)

    @property
    def fallback(self) -> Start:
        """As `Task.fallback`."""
        return self.task.fallback(self.recording)

    @property
    def done(self) -> bool:
        """True when every observation has been answered."""
        return self._step == len(self._times_s)

    @property
    def num_answered(self) -> int:
        """Observations answered so far."""
        return self._step

    @property
    def estimates(self) -> Estimates:
        """What was answered so far."""
        return Estimates.from_columns(self.now_s[: self._step], self._answers[: self._step].T)

    def observe(self) -> Observation:
        """Hands out what was delivered since the last observation, as copies."""
        if self.done:
            raise EstimateError(f"{self!r} is over: there is nothing left to observe")
        step = self._step
        self._awaited = True
        rows = {
            name: rows[self.ends[name][step] : self.ends[name][step + 1]].copy() for name, rows in self.rows.items()
        }
        return Observation(now_s=self._times_s[step], rows=rows)

    def submit(self, answer: object) -> None:
        """Takes the answer to the last observation; one that cannot be scored is counted and counts as missing."""
        if not self._awaited:
            raise EstimateError(f"{self!r}: observe() comes before submit(), once each")
        try:
            self._answers[self._step] = read_estimate(answer)
        except EstimateError as error:
            self._missing[self._step], _, self._why = str(error).partition(": ")
        self._awaited = False
        self._step += 1

    def check_first_answers(self, *, may_wait: bool, place: str) -> None:
        """Raises `EstimateError` where the first ten answers cannot be meant: all wrong, or all far from the start.

        Args:
            may_wait: Whether None and NaN may be meant, as they are where no start is known, or the past is revised.
            place: Of the line to change.
        """
        if self._step != FIRST_ANSWERS:
            return
        start = self.briefing.start
        waits = ("nothing", "nan") if may_wait or start is None else ()
        why = self._why if sum(reason not in waits for reason in self._missing.values()) == FIRST_ANSWERS else ""
        if start is not None and not self._missing:
            off_m = np.hypot(*(self._answers[:FIRST_ANSWERS, :2] - start.xy_m).T)
            why = f"{off_m.min():.3g} m and more from the start" if off_m.min() > FAR_M else ""
        if why:
            raise EstimateError(f"the first {FIRST_ANSWERS} answers cannot be meant: {why}; {EXPECTED}{place}")

    def submit_rows(self, rows: FloatArray) -> None:
        """Takes the answers to the next N observations at once.

        Args:
            rows: (N, 6) columns of `EstimateRow`, whole levels; missing where one of the first three is not finite.
        """
        is_missing = np.logical_not(np.isfinite(rows[:, :3]).all(axis=1))
        answered = slice(self._step, self._step + len(rows))
        self._answers[answered] = np.where(is_missing[:, None], np.nan, rows)
        self._missing |= dict.fromkeys((self._step + np.flatnonzero(is_missing)).tolist(), "nan")
        self._step = answered.stop

    def revise(self, track: object) -> None:
        """Takes a revised past beside the answers, once all of them are given.

        An answer at t becomes the last row with t_s <= t + 0.01 s, with the claims of that row and no others; answers
        before the first row stand.

        Args:
            track: As `revise` of a localizer returns it; None changes nothing.

        Raises:
            EstimateError: The walk is not over, or it is no track.
        """
        if not self.done:
            raise EstimateError(f"{self!r} is not over: a past is revised after the last answer")
        if track is None:
            return
        rows = read_track(track)
        last = np.searchsorted(rows[:, 0], self.now_s[:-1] + REVISION_SLACK_S, side="right") - 1
        revised = np.flatnonzero(last >= 0)
        if not len(revised):
            return
        _, x_m, y_m, level, sigma_m, heading_rad = rows[last[revised]].T
        converged = np.full(len(revised), np.nan)
        self._revised = self._answers.copy()
        self._revised[revised] = np.column_stack([x_m, y_m, level, heading_rad, sigma_m, converged])

    def result(
        self,
        *,
        localizer: str,
        seed: int,
        step_s: FloatArray | None = None,
        reset_s: float = math.nan,
        revise_s: float = math.nan,
        status: str = COMPLETE,
        failure: str = "",
        provenance: Mapping[str, object] | None = None,
    ) -> Result:
        """What was answered so far, without the truth."""
        return Result(
            env=self.task.id,
            split=self.task.split_of(self.recording.id),
            walk=self.recording.id,
            localizer=localizer,
            seed=seed,
            estimates=self.estimates,
            step_s=np.full(self._step, math.nan) if step_s is None else np.asarray(step_s),
            reset_s=reset_s,
            status=status,
            failure=failure,
            missing=Counter(self._missing.values()),
            provenance=provenance or {},
            revise_s=revise_s,
            revised=None if self._revised is None else Estimates.from_columns(self.now_s[:-1], self._revised.T),
        )


def place_of_step(localizer: object) -> str:
    """Where what a localizer returns is to be changed; "" of one in another process, which says so itself."""
    code = getattr(getattr(type(localizer), "step", None), "__code__", None)
    is_ours = type(localizer).__module__.startswith("pdrbench.")
    return (
        "" if code is None or is_ours else f"; see `step` in {Path(code.co_filename).name}, line {code.co_firstlineno}"
    )


def play(
    localizer: Player,
    episode: Episode,
    rng: np.random.Generator,
    *,
    name: str,
    seed: int,
    guard: Callable[[str], AbstractContextManager[object]] = nullcontext,
    provenance: Mapping[str, object] | None = None,
) -> Result:
    """One localizer through one walk. A localizer that raises ends its walk; what it answered before is kept.

    It may decline a walk in `reset` or at its first observation; once it has answered, it may not leave the walk out.
    Where it offers `revise`, it is asked once when the walk is over; where that fails, so has the walk.

    Args:
        localizer: Anything with `reset` and `step`, and possibly `revise`.
        episode: Fresh.
        rng: The localizer's own randomness.
        name: Localizer id for the result.
        seed: What `rng` was made from, for the result.
        guard: Makes a context around every call into the localizer, for deadlines: of "reset", "step" or "revise".
        provenance: Goes into the result.
    """
    briefing = episode.briefing  # an error in the data is ours, and loading a radio map is not the localizer's time
    step_s: list[float] = []
    reset_s = revise_s = math.nan
    status, failure = COMPLETE, ""
    try:
        began = time.perf_counter()
        with guard(RESET):
            localizer.reset(briefing, rng)
        reset_s = time.perf_counter() - began
        while not episode.done:
            observation = episode.observe()
            began = time.perf_counter()
            with guard(STEP):
                answer = localizer.step(observation)
            step_s.append(time.perf_counter() - began)
            episode.submit(answer)
            if episode.num_answered == FIRST_ANSWERS:
                episode.check_first_answers(may_wait=hasattr(localizer, "revise"), place=place_of_step(localizer))
    except UnsuitableError as error:
        status, failure = UNSUITABLE, str(error)
        if episode.num_answered:
            status, failure = FAILED, f"it declined after {episode.num_answered} answers, which is too late: {error}"
    except EstimateError as error:
        status, failure = FAILED, str(error)
    except Exception:  # noqa: BLE001  a localizer may raise anything, and that is its result
        status, failure = FAILED, traceback.format_exc()
    if status == COMPLETE and not episode.is_prefix:
        try:
            revise_s = _revise(localizer, episode, guard)
        except Exception:  # noqa: BLE001  declining comes too late here: a localizer that saw the walk may not leave it out
            status, failure = FAILED, traceback.format_exc()
    return episode.result(
        localizer=name,
        seed=seed,
        step_s=np.asarray(step_s[: episode.num_answered]),
        reset_s=reset_s,
        revise_s=revise_s,
        status=status,
        failure=failure,
        provenance=provenance,
    )


def _revise(localizer: Player, episode: Episode, guard: Callable[[str], AbstractContextManager[object]]) -> float:
    """Hands the localizer's revised past to the episode; the wall time that it took, NaN where it offers none."""
    revise: Callable[[], object] | None = getattr(localizer, "revise", None)
    if revise is None:
        return math.nan
    began = time.perf_counter()
    with guard(REVISE):
        track = revise()
    revise_s = time.perf_counter() - began
    episode.revise(track)
    return revise_s
