"""A walk played once more, to look inside the localizer: for pictures, films and the claims of a paper."""

from __future__ import annotations

import warnings
from collections.abc import Container, Generator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.episode import Episode, play, read_estimate
from pdrbench.errors import EstimateError, PdrbenchError, ResultError
from pdrbench.evaluation import answers
from pdrbench.evaluation.inprocess_run import make_informed
from pdrbench.evaluation.origin import environment_version, localizer_target, target_sha256, versions
from pdrbench.evaluation.randomness import generator
from pdrbench.evaluation.scoring import check_walk
from pdrbench.localizer import Estimate, Localizer
from pdrbench.registry import make_task
from pdrbench.result import OFFLINE, UNSUITABLE, Result
from pdrbench.task import Task
from pdrbench.trajectory import ESTIMATE_COLUMNS, Estimates

NOTHING: Final[Mapping[str, NDArray[Any]]] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class Frame:
    """One observation and what became of it.

    Attributes:
        index: Number of the observation, from 0.
        now_s: Its time, seconds from the start of the walk.
        estimate: The answer; None where it counts as missing. Of a stored result that was revised when the walk was
            over, the revised one.
        debug: What the localizer shows of itself (`particles_xy_m (N, 2)`, ...), as its `debug()` returned it; empty
            where it has none. It may change with the next frame: copy what you keep.
    """

    index: int
    now_s: float
    estimate: Estimate | None
    debug: Mapping[str, NDArray[Any]]


def retrace(result: Result, *, strict: bool = True, only: Container[int] | None = None) -> Generator[Frame, None, None]:
    """Plays the walk of a stored result once more, with the localizer made anew from what the result says.

    Every answer is compared with the stored one to the last bit. There are as many frames as stored answers: where the
    localizer failed, the walk ends there. Where answers were revised when the walk was over, it is played twice, since
    the first frame needs its end. It runs in this process and without deadlines; a relative path in the name of the
    localizer is looked up from the working folder.

    Args:
        result: From `evaluate`, or read from a file.
        strict: False: where the answers differ, a warning says so once, and the walk goes on with those of now.
        only: Numbers of the observations to show, as in `range(0, 10_000, 5)`; None: all. All answers are compared.

    Raises:
        ResultError: There is nothing to retrace, the environment is another one, or the answers differ; the error says
            from when on, and which sources are not those of the result.
    """
    task = make_task(result.task)
    _check(result, task)
    recording = task.load(result.walk)

    parameters: Any = result.provenance.get("parameters", {})

    def make() -> Localizer:
        return make_informed(result.localizer, parameters, result.split, recording)

    def rng() -> np.random.Generator:
        return generator(result.seed, task, recording.id, str(result.provenance.get("nonce", "")))

    revised = None
    if result.division == OFFLINE:
        revised = play(make(), Episode(recording, task), rng(), name=result.localizer, seed=result.seed).revised
    stored, agrees = answers.whole_numbers(result.estimates), True  # in the steps in which they are stored
    for frame, answer in _frames(make(), Episode(recording, task), rng(), only, revised):
        if agrees and not np.array_equal(answers.whole_numbers(answer)[:, 0], stored[:, frame.index]):
            agrees = False
            difference = _difference(result, frame)
            if strict:
                raise ResultError(f"{difference}; run the walk again")
            warnings.warn(f"{difference}; the present answers are shown", stacklevel=2)
        if only is None or frame.index in only:
            yield frame
        if frame.index + 1 == len(result.estimates):
            return


def _frames(
    localizer: Localizer,
    episode: Episode,
    rng: np.random.Generator,
    only: Container[int] | None,
    revised: Estimates | None = None,
) -> Generator[tuple[Frame, Estimates], None, None]:
    """Every observation, and its answer as a record of one row; `debug` is asked for where it is wanted.

    Where there is a revised past, its rows take the place of the answers.
    """
    show: Any = getattr(localizer, "debug", None)
    localizer.reset(episode.briefing, rng)
    while not episode.done:
        observation = episode.observe()
        given: Estimate | None = localizer.step(observation)
        index = episode.num_answered
        episode.submit(given)
        if revised is not None:
            given = _estimate(revised, index)
        answer = _one_row(observation.now_s, given)
        estimate = given if answer.given[0] else None
        is_wanted = show is not None and (only is None or index in only)
        debug = show() if is_wanted else NOTHING
        yield Frame(index, observation.now_s, estimate, debug), answer


def _one_row(now_s: float, given: object) -> Estimates:
    """An answer as it is stored; NaN throughout where it counts as missing."""
    try:
        row = np.array([read_estimate(given)])
    except EstimateError:
        row = np.full((1, len(ESTIMATE_COLUMNS)), np.nan)
    return Estimates.from_columns(np.array([now_s]), row.T)


def _estimate(estimates: Estimates, row: int) -> Estimate | None:
    """A row of a record as it was answered; None where that counts as missing, or where the record ends before."""
    if row >= len(estimates) or not estimates.given[row]:
        return None
    claims = (estimates.heading_rad[row], estimates.sigma_m[row], estimates.converged[row])
    heading_rad, sigma_m, converged = (None if np.isnan(claim) else float(claim) for claim in claims)
    return Estimate(
        xy_m=estimates.xy_m[row],
        level=int(estimates.level[row]),
        heading_rad=heading_rad,
        sigma_m=sigma_m,
        converged=None if converged is None else bool(converged),
    )


def _check(result: Result, task: Task) -> None:
    who = f"walk {result.walk!r} of {result.localizer}"
    if result.status == UNSUITABLE:
        raise ResultError(f"{who}: it declined the walk, there is nothing to play; its reason: {result.failure}")
    if not len(result.estimates):
        raise ResultError(f"{who}: nothing was answered before it failed, there is nothing to play")
    check_walk(result, task)


def _difference(result: Result, frame: Frame) -> str:
    changed = ", ".join(_changed(result))
    reason = "the sources are the same: another machine, or randomness that is not the generator's, made the difference"
    if changed:
        reason = f"since it was stored, this has changed: {changed}"
    return (
        f"walk {result.walk!r} of {result.localizer}, seed {result.seed}: the answers are not the stored ones from "
        f"{frame.now_s:g} s on; {reason}"
    )


def _changed(result: Result) -> list[str]:
    """What produced the result and has changed since."""
    try:
        localizer = target_sha256(localizer_target(result.localizer))
    except PdrbenchError as error:
        localizer = str(error)
    now = {
        "localizer_sha256": ("localizer", localizer),
        "environment": ("environment", environment_version(result.task)),
        "versions": ("versions", versions()),
    }
    return [what for name, (what, value) in now.items() if result.provenance.get(name, value) != value]
