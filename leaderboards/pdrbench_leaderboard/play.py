"""Play: localizers on drawn walks. Nothing here knows a secret or a reference; any machine can do it.

What another machine has played is read as what a stranger sends.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from pdrbench.errors import BundleError, ResultError, plain_line
from pdrbench.evaluation import evaluate, store
from pdrbench.process.launch import Isolation
from pdrbench.result import ONLINE, UNSUITABLE, Result, by_division
from pdrbench_leaderboard.draw import INDEX_FILE, TASK_FILE, Index, read_index
from pdrbench_leaderboard.schema import UNREADABLE, Name, Remark, read_limited

TRIED: Final = 5  # walks: who declines one in ten by chance declines so many in one of 100 000 cases
MAX_RESULT_BYTES: Final = 64_000_000
CLOCK_S: Final = 1e-6  # difference of a time that went through a file


def play(
    observations: Path,
    localizers: Sequence[str],
    answers: Path,
    *,
    jobs: int = 1,
    isolation: Isolation = "process",
    progress: bool = False,
) -> tuple[Result, ...]:
    """Answers of localizers to drawn walks, one run of each; as they were given, then as `revise` left them.

    A localizer draws its randomness from the name of the walk and the nonce of the round. One that declines the first
    `TRIED` walks is not asked again, and those are what is returned of it. What is stored already is not played again.
    On a Dask cluster (`evaluation.cluster`) all machines see both folders.

    Args:
        observations: Folder of drawn walks.
        localizers: As for `evaluate`.
        answers: Folder that keeps every walk.
        jobs: Processes.
        isolation: What localizers run in.
        progress: Shows on stderr how far it is.
    """
    index = read_index(observations)

    def played(names: Sequence[str], walks: int) -> tuple[Result, ...]:
        return evaluate(
            names,
            f"{observations / TASK_FILE}:task",
            split="test",
            seeds=1,
            walks=walks,
            jobs=jobs,
            out=answers,
            isolation=isolation,
            nonce=index.nonce,
            progress=progress,
        ).results

    tried = played(localizers, min(TRIED, len(index.walks)))
    suited = {result.localizer for result in tried if result.status != UNSUITABLE}
    declined = tuple(result for result in tried if result.localizer not in suited)
    return declined + (played(sorted(suited), len(index.walks)) if suited else ())


def find_parts(observations: Path) -> list[Path]:
    """Folders of drawn walks in the folder that `draw` has made for the machine that plays; raises `ResultError`."""
    found = sorted(path.parent for path in observations.glob(f"*/*/{INDEX_FILE}"))
    if not found:
        raise ResultError(f"{observations} holds no drawn walks: `pdrbench leaderboard draw` makes them")
    return found


def answers_folder(answers: Path, part: Path) -> Path:
    """Where answers to the walks of a part lie: as their observations do."""
    return answers / part.parent.name / part.name


def read_played(folder: Path, observations: Path) -> tuple[Result, ...]:
    """What another machine has played on drawn walks, in each division; its files may hold anything.

    Args:
        folder: With a file for each walk.
        observations: Folder of the walks.

    Raises:
        BundleError: A file is no answer to one of these walks, or there are two to one, or none.
    """
    index, found = read_index(observations), dict[tuple[str, str], Result]()
    for path in sorted(folder.glob(f"*{store.SUFFIX}")):
        content = read_limited(path, MAX_RESULT_BYTES)
        try:
            result = store.decode(content, path.name)
            _check(result, index)
        except (ResultError, *UNREADABLE) as error:
            why = plain_line(f"{type(error).__name__}: {error}")[:300]
            raise BundleError(f"{path} holds no answers to these walks: {why}") from None
        if found.setdefault((result.localizer, result.walk), result) is not result:
            raise BundleError(f"{path} answers the walk {result.walk} a second time")
    for name in {name for name, _ in found}:
        of = [result for (one, _), result in found.items() if one == name]
        if len(of) < len(index.walks) and any(result.status != UNSUITABLE for result in of):
            raise BundleError(f"{folder} answers {len(of)} of {len(index.walks)} walks: play it to its end")
    return tuple(by_division(list(found.values())))


def _check(result: Result, index: Index) -> None:
    """Raises `ResultError` where answers are not those of one run on a drawn walk; nobody chooses their times."""
    if (result.env, result.division, result.seed) != (index.env, ONLINE, 0) or result.walk not in index.walks:
        raise ResultError(f"walk {result.walk!r} of {result.env!r} was not drawn")
    observed_s = np.arange(len(result.estimates)) * index.period_s
    if not np.allclose(result.estimates.t_s, observed_s, rtol=0.0, atol=CLOCK_S):
        raise ResultError("answers are not at the times of observations")
    child = dict(result.provenance.get("child") or {})  # type: ignore[call-overload]
    facts = (result.localizer, result.failure, result.reset_s, child.get("cpu_s"), result.provenance.get("cpu_s"))
    msgspec.convert(facts, tuple[str, str, float, float | None, float | None])
    for name in ("versions", "machine"):
        msgspec.convert(result.provenance[name], dict[Name, Remark | int])
    msgspec.convert(result.provenance["isolation"], dict[str, str | list[str] | dict[str, str]])
