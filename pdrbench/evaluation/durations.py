"""How long a run will take on this machine, by what the runs before it took."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any, Final

from pdrbench.evaluation.jobs import Job
from pdrbench.evaluation.store import remember, remembered

JOB_S: Final = 0.5  # seconds of one process, as the mean of all walks of all boards takes, where no run has shown them
FIRST_S: Final = 5.0  # more where no run has shown the localizer: what it calls is compiled
STARTING_JOBS: Final = 10  # count as much as what is known
_FILE: Final = "durations.json"


def expected_s(jobs: Iterable[Job], num_workers: int) -> float:
    """Seconds until so many processes have done all jobs."""
    known, labels = remembered(_FILE), [job.label for job in jobs]
    new = {label.partition(" on ")[0] for label in labels} - {label.partition(" on ")[0] for label in known}
    return (sum(_of(known, label) for label in labels) + FIRST_S * len(new)) / num_workers


def learn(jobs: Sequence[Job], num_workers: int, took_s: float) -> None:
    """Notes how long jobs took, in the proportions known before; few jobs say little, since a run has to start."""
    if jobs:
        weight = len(jobs) / (len(jobs) + STARTING_JOBS)
        known, scale = remembered(_FILE), 1.0 - weight + weight * took_s / expected_s(jobs, num_workers)
        remember(_FILE, known | {label: scale * _of(known, label) for label in {job.label for job in jobs}})


def _of(known: dict[str, Any], label: str) -> float:
    found = known.get(label)
    return found if isinstance(found, float) and 0.0 < found < math.inf else JOB_S
