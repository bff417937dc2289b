"""Play: localizers on drawn walks. Nothing here knows a secret or a reference; any machine can do it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from pdrbench.evaluation import evaluate
from pdrbench.process.launch import Isolation
from pdrbench.result import Result
from pdrbench_leaderboard.draw import TASK_FILE, read_index


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

    A localizer draws its randomness from the name of the walk and the nonce of the round. What is stored already is
    not played again. On a Dask cluster (`evaluation.cluster`) all machines see both folders.

    Args:
        observations: Folder of drawn walks.
        localizers: As for `evaluate`.
        answers: Folder that keeps every walk.
        jobs: Processes.
        isolation: What localizers run in.
        progress: Shows on stderr how far it is.
    """
    index = read_index(observations)
    return evaluate(
        localizers,
        f"{observations / TASK_FILE}:task",
        split="test",
        seeds=1,
        walks=len(index.walks),
        jobs=jobs,
        out=answers,
        isolation=isolation,
        nonce=index.nonce,
        progress=progress,
    ).results
