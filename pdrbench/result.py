"""What came of one localizer on one walk: its answers and timings, and no truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

from pdrbench.errors import ResultError
from pdrbench.geometry import FloatArray, read_only
from pdrbench.trajectory import Estimates

COMPLETE, FAILED, UNSUITABLE = "complete", "failed", "unsuitable"
ONLINE, OFFLINE = "online", "offline"


@dataclass(frozen=True, slots=True)
class Result:
    """Answers of one localizer to one walk with one seed.

    Attributes:
        env: Environment id.
        split: "train", "val" or "test".
        walk: Walk id.
        localizer: Localizer id or specification.
        seed: Seed the localizer's generator was made from.
        estimates: One row per answered observation.
        step_s: (N,) wall time each answer took, measured by the evaluating side; NaN where it was not measured.
        reset_s: Wall time of `reset`.
        status: "complete"; "failed" (the localizer raised, hung or died: the walk is scored with what it had
            answered before); "unsuitable" (it declined the briefing: nothing is scored).
        failure: Why it is not complete, with traceback; empty otherwise.
        missing: Count by reason of answers that count as missing, as in {"nan": 3}.
        provenance: Versions, hashes, parameters, machine: whatever produced the answers.
        division: "online" where every estimate was given at its time, "offline" where estimates were revised when the
            walk was over.
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

    @property
    def task(self) -> str:
        """The environment as `pdrbench.make_task` takes it: its id, or the path of a task that is a file."""
        return str(self.provenance.get("task", self.env))

    def __reduce__(self) -> tuple[Any, ...]:
        """Lets a result travel between processes, which a mapping proxy cannot."""
        values = (getattr(self, item.name) for item in fields(self))
        return Result, tuple(dict(value) if isinstance(value, Mapping) else value for value in values)


def shown_name(localizer: str, division: str) -> str:
    """A localizer as tables and pictures name it: one that revised its estimates after the walk is marked.

    >>> shown_name("stay-v0", ONLINE), shown_name("smooth-v0", OFFLINE)
    ('stay-v0', 'smooth-v0 (offline)')
    """
    return localizer if division == ONLINE else f"{localizer} ({division})"
