"""What an environment is made of: which walks, which sensors, what is given, under which licence."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal, Self

import numpy as np

from pdrbench.errors import PdrbenchError, RecordingError, unknown_name
from pdrbench.localizer import Briefing
from pdrbench.recording import MagneticMap, RadioMap, Recording, SensorSpec
from pdrbench.trajectory import Start

HELD_OUT = "heldout"
NOISE_M = 0.01  # of a reference: that of a laser or a tape
FILES_SHA256 = "files_sha256"  # of a walk, in what a result says of its origin
SPLITS = ("train", "val", "test", HELD_OUT)
KNOWN_SPLITS = SPLITS[:2]  # whose truth may be known
MIN_SECRET_CHARACTERS = 32  # 128 bits in hex; its digest is public, so a short one could be guessed
StartKnowledge = Literal["pose", "area", "unknown"]


def commitment(secret: str) -> str:
    """What is published of the secret behind held-out walks: its sha256, in hex.

    Raises:
        PdrbenchError: It could be guessed.
    """
    if len(secret) < MIN_SECRET_CHARACTERS:
        raise PdrbenchError(
            f"a secret has {MIN_SECRET_CHARACTERS} characters or more, this one {len(secret)}; make one with: "
            f'python -c "import secrets; print(secrets.token_hex(32))"'
        )
    return hashlib.sha256(secret.encode()).hexdigest()


SURVEYS = ("radio_map", "magnetic_map")  # fields of `Task` and of `Briefing`


def no_survey(recording: Recording) -> None:
    """The radio or magnetic survey of a task without one."""


def registered_files(walk: str) -> str:
    """`Task.files_sha256` where walks are generated, or made of the files of a registered set and of all of them."""
    return ""


@dataclass(frozen=True, slots=True)
class Task:
    """One environment's ingredients; the bulk is loaded walk by walk.

    Attributes:
        id: `Name-vN`.
        summary: One sentence for tables and pages.
        description: A paragraph or two of Markdown: what is recorded, what is given, what is hard.
        sensors: Sensors offered, in the order of the observation.
        capacity: Rows of each sensor that one observation can hold; what exceeds it comes with the next.
        period_s: Time between observations.
        start: What a localizer is given of the start: "pose", "area" or "unknown".
        walks: Walk ids by split, in the order they are played; opaque where the split is "test".
        load: Recording by walk id. Deterministic.
        tell_start: The start that a localizer is given, from a recording; not called where `start` is "unknown".
        radio_map: The radio survey for a recording, without that recording's own scans; None where there is none.
        magnetic_map: The magnetic survey likewise.
        licence: SPDX expression or name of the licence of the data.
        source: Where the data comes from: a URL and commit, or "generated".
        dataset: Name of the registered dataset it needs, or None where it is embedded.
        note: A warning to print wherever scores of this task are shown, such as data that is not the registered one.
        files_sha256: Digest of the files behind a walk, by walk id, where they are not those that `id` stands for: a
            user's own recordings, or a part of a recorded set. Empty text elsewhere.
        units: Name of the unit of replication of each walk, what a new sample would draw anew: a recording session, a
            person. Intervals and tests resample whole units. Empty: the building of each walk is its unit.
        unit_kind: What a unit is, for tables: "building", "session", "person", "route".
        noise_m: Error of the reference: in a ranking no walk counts as better. 0.01: positions surveyed by a laser or
            by cameras on a wall, and generated ones.
        groups: Names of the groups of results that a walk counts in besides all walks, as "unseen floor"; a walk may
            have none. Never given to a localizer.
        folds: Number of the fold of each walk of the train split, from 0, whole units only; the survey of a walk is
            made without its fold. A walk of another split may have one too. Empty: the task has no folds.
        random_as: Name of the walk whose random numbers a localizer is given, where it is not its own: of two walks
            that begin alike answers are then alike as well.
        held_out: Makes of a secret the same task with a split "heldout", whose walks cannot be made without
            the secret; None where walks are recorded, not generated: the leaderboards replay them then. See
            `pdrbench.registry.make_task`.
    """

    id: str
    summary: str
    description: str
    sensors: tuple[SensorSpec, ...]
    capacity: Mapping[str, int]
    period_s: float
    start: StartKnowledge
    walks: Mapping[str, tuple[str, ...]]
    load: Callable[[str], Recording]
    tell_start: Callable[[Recording], Start]
    licence: str
    source: str
    radio_map: Callable[[Recording], RadioMap | None] = no_survey
    magnetic_map: Callable[[Recording], MagneticMap | None] = no_survey
    dataset: str | None = None
    note: str = ""
    files_sha256: Callable[[str], str] = registered_files
    units: Mapping[str, str] = field(default_factory=dict)
    unit_kind: str = "building"
    noise_m: float = NOISE_M
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    folds: Mapping[str, int] = field(default_factory=dict)
    random_as: Mapping[str, str] = field(default_factory=dict)
    held_out: Callable[[str], Task] | None = field(default=None, compare=False)

    def __deepcopy__(self, memo: dict[int, Any]) -> Self:
        """Itself: nothing of it changes. Gymnasium copies what an environment was made with into its `spec`."""
        return self

    def __post_init__(self) -> None:
        object.__setattr__(self, "sensors", tuple(self.sensors))
        object.__setattr__(self, "capacity", MappingProxyType(dict(self.capacity)))
        object.__setattr__(self, "walks", MappingProxyType({k: tuple(v) for k, v in self.walks.items()}))
        if not re.fullmatch(r"[A-Z][A-Za-z0-9]*-v[0-9]+", self.id):
            raise RecordingError(f"task id {self.id!r} is not of the form Name-vN, as in CampusFoot-v1")
        if not self.period_s > 0:
            raise RecordingError(f"task {self.id}: period_s must be positive; got {self.period_s}")
        names = [spec.name for spec in self.sensors]
        if set(names) != set(self.capacity) or len(set(names)) != len(names):
            raise RecordingError(f"task {self.id}: sensors {names} and capacity {dict(self.capacity)} disagree")
        if any(rows < 1 for rows in self.capacity.values()):
            raise RecordingError(f"task {self.id}: every capacity is at least 1; got {dict(self.capacity)}")
        if set(self.walks) - set(SPLITS):
            raise RecordingError(f"task {self.id}: splits are {SPLITS}; got {tuple(self.walks)}")
        everything = [walk for split in self.walks.values() for walk in split]
        if len(set(everything)) != len(everything):
            raise RecordingError(f"task {self.id}: a walk belongs to two splits or stands twice in one")
        self._check_parts(everything)

    def _check_parts(self, everything: list[str]) -> None:
        """What units, groups and folds owe to the walks; they may name more walks than the task has."""
        for name in ("units", "groups", "folds"):
            object.__setattr__(self, name, MappingProxyType(dict(getattr(self, name))))
        for name, owed in (("unit", everything), ("fold", self.walks.get("train", ()))):
            of = getattr(self, f"{name}s")
            if of and (lacking := [walk for walk in owed if walk not in of]):
                raise RecordingError(f"task {self.id}: walk {lacking[0]!r} has no {name}, others have one")
        fold_of: dict[str, int] = {}
        for walk, fold in self.folds.items():
            if fold_of.setdefault(self.units.get(walk, walk), fold) != fold:
                raise RecordingError(f"task {self.id}: unit {self.units[walk]!r} lies in two folds; folds are of units")

    def walk_identity(self, walk: str) -> dict[str, str]:
        """What a result on a walk is stored with besides `id`: results are comparable where both agree."""
        digest = self.files_sha256(walk)
        return {FILES_SHA256: digest} if digest else {}

    def split(self, name: str) -> tuple[str, ...]:
        """Walk ids of a split; raises `UnknownNameError` where the task has no such split."""
        if not self.walks.get(name):
            raise unknown_name(f"split of {self.id}", name, [k for k, v in self.walks.items() if v])
        return self.walks[name]

    @property
    def default_split(self) -> str:
        """The split that is played where none is named: "train", or the first that there is."""
        return next((name for name in SPLITS if self.walks.get(name)), SPLITS[0])

    def split_of(self, walk: str) -> str:
        """The split a walk belongs to."""
        for name, walks in self.walks.items():
            if walk in walks:
                return name
        raise unknown_name(f"walk of {self.id}", walk, [w for walks in self.walks.values() for w in walks])

    def fallback(self, recording: Recording) -> Start:
        """Where the pedestrian counts as being before the first answer.

        The start, else the centre of the building, else the middle of the radio survey, else the origin.
        """
        if self.start != "unknown":
            return self.tell_start(recording)
        if recording.building is not None:
            return recording.building.centre()
        survey = self.radio_map(recording)
        return survey.middle() if survey else Start(np.zeros(2), level=0)

    def brief(self, recording: Recording) -> Briefing:
        """What a localizer is given before it plays `recording`; no name in it identifies the walk or its split."""
        return Briefing(
            building=None if recording.building is None else recording.building.unnamed(),
            sensors={spec.name: spec for spec in self.sensors},
            period_s=self.period_s,
            start=None if self.start == "unknown" else self.tell_start(recording),
            radio_map=self.radio_map(recording),
            subject=recording.subject,
            mounting=recording.mounting,
            magnetic_map=self.magnetic_map(recording),
        )
