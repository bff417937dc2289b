"""Beginnings of walks as canaries: a localizer that does not know the future answers them as it answers the whole walk.

A copy of the localizer in a process of its own is given the same briefing and the same randomness, and the walk ends
early. A localizer that knows its future, from the length of the walk or from notes of an earlier pass, finds another
one there.
"""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pdrbench.errors import ResultError
from pdrbench.evaluation.origin import localizer_target, target_sha256
from pdrbench.evaluation.process_run import play_in_child
from pdrbench.evaluation.walk_job import WalkJob, plan_walks
from pdrbench.process.budget import Budget
from pdrbench.process.launch import Isolation
from pdrbench.result import COMPLETE, OFFLINE, UNSUITABLE, Result
from pdrbench.trajectory import ESTIMATE_COLUMNS, Estimates

NUM_PREFIXES: Final = 2
SAME: Final = 1e-3  # of a column, m or rad: results are stored in steps of a tenth of that


@dataclass(frozen=True, slots=True)
class PrefixDifference:
    """The first answer to the beginning of a walk that is not the one to the whole walk.

    Attributes:
        length: Observations of the beginning.
        index: Number of the observation, from 0.
        now_s: Its time.
        whole: (6,) answer to the whole walk, columns as in `pdrbench.trajectory.ESTIMATE_COLUMNS`.
        prefix: (6,) answer to its beginning; NaN throughout where there is none.
        failure: Why the localizer went no further; empty where it did not fail.
    """

    length: int
    index: int
    now_s: float
    whole: tuple[float, ...]
    prefix: tuple[float, ...]
    failure: str = ""

    def __str__(self) -> str:
        what = f"of {self.length} observations: the answer at {self.now_s:g} s is"
        return f"{what} {self._text(self.prefix)}, that to the whole walk {self._text(self.whole)}{self._reason()}"

    def _reason(self) -> str:
        return f"; {self.failure.strip().splitlines()[-1]}" if self.failure.strip() else ""

    @staticmethod
    def _text(answer: tuple[float, ...]) -> str:
        return "none" if np.isnan(answer[0]) else f"({answer[0]!r}, {answer[1]!r}) on level {answer[2]:g}"


@dataclass(frozen=True, slots=True)
class PrefixCheck:
    """What came of the beginnings of one walk.

    Attributes:
        env: Environment id.
        walk: Walk id.
        seed: Of the localizer's generator.
        lengths: Observations of each beginning that was played; none where the walk has fewer than two answers.
        difference: The first that was found; None where all answers are the same.
    """

    env: str
    walk: str
    seed: int
    lengths: tuple[int, ...]
    difference: PrefixDifference | None


def check_prefixes(
    result: Result,
    rng: np.random.Generator,
    *,
    num_prefixes: int = NUM_PREFIXES,
    isolation: Isolation = "confined",
) -> PrefixCheck:
    """Plays beginnings of a walk to fresh copies of a localizer and compares their answers with those of the result.

    The localizer runs in processes of its own that this one starts. Where the result was revised after the walk, its
    answers of the time are played once more. The past is not revised.

    Args:
        result: Of the whole walk, by the same sources, in whatever isolation.
        rng: Draws where the beginnings end; unknown to the localizer.
        num_prefixes: How many, of different lengths.
        isolation: "confined" or "process", as for `evaluate`.

    Raises:
        ResultError: The localizer declined the walk, or its sources are others by now.
    """
    job = _job(result, isolation)
    memory: dict[str, Any] = {}
    whole = result.estimates
    if result.division == OFFLINE:
        whole = play_in_child(job, memory, io.BytesIO(), len(whole)).estimates
    ends = np.arange(1, len(whole))
    lengths = tuple(sorted(rng.choice(ends, min(num_prefixes, len(ends)), replace=False).tolist()))
    for length in lengths:
        played = play_in_child(job, memory, io.BytesIO(), length)
        difference = first_difference(whole, played, length)
        if difference is not None:
            return PrefixCheck(result.env, result.walk, result.seed, lengths, difference)
    return PrefixCheck(result.env, result.walk, result.seed, lengths, None)


def first_difference(whole: Estimates, played: Result, length: int) -> PrefixDifference | None:
    """Where the answers to the first `length` observations differ, or end; None where they do not."""
    columns = np.full((len(ESTIMATE_COLUMNS), length), np.nan)
    columns[:, : len(played.estimates)] = played.estimates.columns
    same = np.isclose(columns, whole.columns[:, :length], rtol=0.0, atol=SAME, equal_nan=True).all(axis=0)
    if played.status == COMPLETE and same.all():
        return None
    index = int(np.flatnonzero(~same)[0]) if not same.all() else min(len(played.estimates), length - 1)
    return PrefixDifference(
        length=length,
        index=index,
        now_s=float(whole.t_s[index]),
        whole=tuple(whole.columns[:, index].tolist()),
        prefix=tuple(columns[:, index].tolist()),
        failure=played.failure,
    )


def _job(result: Result, isolation: Isolation) -> WalkJob:
    """The job that plays the walk of a result with its localizer, parameters, budget and nonce."""
    who = f"walk {result.walk!r} of {result.localizer}"
    if result.status == UNSUITABLE:
        raise ResultError(f"{who}: it declined the walk, there is nothing to compare")
    provenance: Mapping[str, Any] = result.provenance
    if target_sha256(localizer_target(result.localizer)) != provenance["localizer_sha256"]:
        raise ResultError(f"{who}: its sources are not those of the result; run the walk again")
    (job,) = plan_walks(
        {result.task: [result.localizer]},
        split=result.split,
        seeds=range(result.seed, result.seed + 1),
        walks=[result.walk],
        parameters=provenance["parameters"],
        budget=Budget(**provenance["budget"]),
        isolation=isolation,
        nonce=str(provenance.get("nonce", "")),
    )
    return job
