"""Results of two localizers on a made-up task: six walks along one corridor, known errors."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from pdrbench.evaluation.scoring import Scored
from pdrbench.metrics import errors_m, hold_at
from pdrbench.recording import Recording, SensorSpec
from pdrbench.result import COMPLETE, FAILED, UNSUITABLE, Result
from pdrbench.task import Task
from pdrbench.trajectory import Estimates, Start, Trajectory

WALKS = tuple(f"walk {i}/odd" for i in range(6))
STEPS = 20


def make_recording(walk: str) -> Recording:
    """A straight walk of 19 m; the second half is on level 1."""
    t_s = np.arange(float(STEPS))
    reference = Trajectory(
        t_s=t_s, xy_m=np.column_stack([t_s, np.zeros(STEPS)]), level=(t_s >= STEPS / 2).astype(int), surveyed=t_s > 0
    )
    return Recording(id=walk, building=None, streams={}, reference=reference)


def make_task(**changes: object) -> Task:
    spec = SensorSpec("stride", ("t_s", "length_m"), [0, 0], [1e3, 5], None, "A stride | of one foot.")
    fields: dict[str, object] = {
        "id": "Corridor-v0",
        "summary": "A corridor.",
        "description": "Nothing but a corridor.",
        "sensors": (spec,),
        "capacity": {"stride": 4},
        "period_s": 1.0,
        "start": "pose",
        "walks": {"train": ("a",), "test": WALKS},
        "load": make_recording,
        "tell_start": lambda recording: Start(recording.reference.xy_m[0], 0),
        "licence": "MIT",
        "source": "generated",
    }
    return Task(**(fields | changes))  # type: ignore[arg-type]


def make_result(localizer: str, walk: str, offset_m: float, seed: int = 0, status: str = COMPLETE) -> Result:
    """Every estimate is `offset_m` beside the reference."""
    reference = make_recording(walk).reference
    none = np.full(STEPS, np.nan)
    count = 0 if status == UNSUITABLE else STEPS
    estimates = Estimates(
        t_s=reference.t_s[:count],
        xy_m=(reference.xy_m + np.array([0.0, offset_m]))[:count],
        level=reference.level.astype(float)[:count],
        heading_rad=none[:count],
        sigma_m=none[:count],
        converged=none[:count],
    )
    return Result(
        "Corridor-v0",
        "test",
        walk,
        localizer,
        seed,
        estimates,
        none[:count],
        status=status,
        failure="" if status == "complete" else "it broke",
    )


def make_scored(result: Result) -> Scored:
    """Scored as `pdrbench.evaluation` does."""
    reference = make_recording(result.walk).reference
    held = hold_at(result.estimates, reference.t_s, Start(reference.xy_m[0], 0))
    error_m = errors_m(held, reference)
    return Scored({}, "corridor", result.walk, error_m, np.full(len(error_m), np.nan))


@dataclass(frozen=True)
class FakeResults:
    """The part of `pdrbench.evaluation.Results` that `write_report` uses."""

    results: tuple[Result, ...]
    kept: Path | None = None
    compared_with: str | None = None

    @property
    def scored(self) -> tuple[Scored, ...]:
        return tuple(make_scored(result) for result in self.results)

    def to_markdown(self, columns: Sequence[str] | None = None) -> str:
        return "| env |\n|---|"

    def to_latex(self, columns: Sequence[str] | None = None) -> str:
        return "\\begin{tabular}"

    def to_csv(self) -> str:
        return "env\n"

    def to_json(self) -> str:
        return json.dumps({"rows": []})


@pytest.fixture
def corridor() -> SimpleNamespace:
    """The makers of this file."""
    return SimpleNamespace(
        WALKS=WALKS, recording=make_recording, result=make_result, scored=make_scored, task=make_task
    )


@pytest.fixture
def results(monkeypatch: pytest.MonkeyPatch) -> FakeResults:
    tasks: Mapping[str, Task] = {"Corridor-v0": make_task()}
    monkeypatch.setattr("pdrbench.report.folder.make_task", tasks.__getitem__)
    near = [make_result("near", walk, 1.0 + i) for i, walk in enumerate(WALKS)]
    far = [make_result("far", walk, 30.0, seed) for walk in WALKS for seed in (0, 1)]
    broken = [make_result("broken", WALKS[0], 2.0, status=FAILED)]
    declined = [make_result("declined", walk, 0.0, status=UNSUITABLE) for walk in WALKS]
    return FakeResults((*near, *far, *broken, *declined))
