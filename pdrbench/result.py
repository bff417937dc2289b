"""What came of one localizer on one walk: its answers and timings, and no truth.

The way of an answer from a localizer to a row of a board has six forms:

1. `Estimate`, as the localizer returns it;
2. `EstimateRow`, checked numbers, as a process sends them and `Episode` keeps them;
3. `Result`, all of a walk, with `Estimates` for each division;
4. the bytes of a result, as `evaluation.store` writes them and entries of a leaderboard hold them;
5. `Scored`, the values of metrics on that walk;
6. a row of `Results.rows`, which tables, JSON and boards show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from types import MappingProxyType
from typing import Any

from pdrbench.errors import ResultError
from pdrbench.geometry import FloatArray, read_only
from pdrbench.trajectory import Estimates

COMPLETE, FAILED, UNSUITABLE = "complete", "failed", "unsuitable"
ONLINE, OFFLINE = "online", "offline"
NOT_GIVEN = "not given"  # the reason why an estimate is missing offline


@dataclass(frozen=True, slots=True)
class Result:
    """Answers of one localizer to one walk with one seed.

    Attributes:
        env: Environment id.
        split: "train", "val" or "test".
        walk: Walk id.
        localizer: Localizer id or specification, with its settings.
        seed: Seed the localizer's generator was made from.
        estimates: One row per answered observation, as given at its time.
        revised: The same rows as `revise` left them when the walk was over; None where the localizer offers none.
        step_s: (N,) wall time each answer took, measured by the evaluating side; NaN where it was not measured.
        reset_s: Wall time of `reset`.
        status: "complete"; "failed" (the localizer raised, hung or died: the walk is scored with what it had
            answered before); "unsuitable" (it declined the briefing: nothing is scored).
        failure: Why it is not complete, with traceback; empty otherwise.
        missing: Count by reason of answers that count as missing, as in {"nan": 3}.
        provenance: Versions, hashes, parameters, machine: whatever produced the answers.
        division: "online"; "offline" in what `by_division` makes of revised estimates, which takes their place.
        revise_s: Wall time of `revise`; NaN where it was not asked for or failed.
    """

    env: str
    split: str
    walk: str
    localizer: str
    seed: int
    estimates: Estimates
    step_s: FloatArray
    reset_s: float = float("nan")
    status: str = COMPLETE
    failure: str = ""
    missing: Mapping[str, int] = field(default_factory=dict)
    provenance: Mapping[str, object] = field(default_factory=dict)
    division: str = ONLINE
    revise_s: float = float("nan")
    revised: Estimates | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "step_s", read_only(self.step_s))
        object.__setattr__(self, "missing", MappingProxyType(dict(self.missing)))
        object.__setattr__(self, "provenance", MappingProxyType(dict(self.provenance)))
        if self.status not in (COMPLETE, FAILED, UNSUITABLE):
            raise ResultError(f"status is complete, failed or unsuitable; got {self.status!r}")
        if self.division not in (ONLINE, OFFLINE):
            raise ResultError(f"division is online or offline; got {self.division!r}")
        if self.step_s.shape != (len(self.estimates),):
            raise ResultError(f"step_s has shape {self.step_s.shape}, expected ({len(self.estimates)},)")
        if self.revised is not None and len(self.revised) != len(self.estimates):
            raise ResultError(f"{len(self.revised)} revised estimates for {len(self.estimates)} answers")

    def offline(self) -> Result:
        """The walk as it counts offline: with revised estimates, or as it was answered where nothing was revised."""
        if self.revised is None:
            return replace(self, division=OFFLINE)
        num_missing = int((~self.revised.given).sum())
        missing = {NOT_GIVEN: num_missing} if num_missing else {}
        return replace(self, estimates=self.revised, revised=None, missing=missing, division=OFFLINE)

    @property
    def notes(self) -> tuple[str, ...]:
        """What the localizer warned of (`RecordingWarning`) while it played in a process of its own."""
        notes: Any = self.provenance.get("notes", ())
        return tuple(notes)

    @property
    def task(self) -> str:
        """The environment as `pdrbench.make_task` takes it: its id, or the path of a task that is a file."""
        return str(self.provenance.get("task", self.env))

    def __reduce__(self) -> tuple[Any, ...]:
        """Lets a result travel between processes, which a mapping proxy cannot."""
        values = (getattr(self, item.name) for item in fields(self))
        return Result, tuple(dict(value) if isinstance(value, Mapping) else value for value in values)


def by_division(results: Sequence[Result]) -> list[Result]:
    """Results as they are counted: each online, then offline those of localizers that revise, by environment.

    A localizer that revised any walk of an environment has all its walks there in both divisions.
    """
    online = [result for result in results if result.division == ONLINE]
    known = [result for result in results if result.division == OFFLINE]
    revise = {(result.env, result.localizer) for result in online if result.revised is not None}
    return [*online, *known, *(result.offline() for result in online if (result.env, result.localizer) in revise)]


def shown_name(localizer: str, division: str) -> str:
    """A localizer as tables and pictures name it: what it revised when the walk was over is marked.

    >>> shown_name("stay", ONLINE), shown_name("fusion", OFFLINE)
    ('stay', 'fusion (offline)')
    """
    return localizer if division == ONLINE else f"{localizer} ({division})"
