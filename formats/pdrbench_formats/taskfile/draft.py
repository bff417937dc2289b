"""A task file for files that a user names on the command line."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import msgspec

from pdrbench.errors import RecordingError
from pdrbench.registry import TASK_FILE
from pdrbench_formats.detect import read_plan
from pdrbench_formats.taskfile.files import file_facts, walks_below, with_companions
from pdrbench_formats.taskfile.index import Index
from pdrbench_formats.taskfile.places import PlanAlignment
from pdrbench_formats.taskfile.schema import (
    PlanTable,
    StartTable,
    SurveyTable,
    TaskFile,
    TaskTable,
    WalkTable,
    as_toml,
)
from pdrbench_formats.taskfile.surveyed import best_surveyed
from pdrbench_formats.taskfile.walk import WalkReader

DRAFT_ID = "Try-v0"


@dataclass(frozen=True, slots=True)
class Wishes:
    """What a user says of recordings.

    Attributes:
        plan: File with a plan.
        columns: File with the column map of tables.
        start: Where every walk begins: x, y and level.
        heading_deg: Heading of travel there, counter-clockwise from the x axis.
        truth: CSV of places.
        mounting: Where the device was carried; empty for what the file says, or shows.
        truth_offset_s: What is added to the times of `truth`.
        doors: What is done for rooms of the plan without one.
        surveys: Files and folders of a radio survey.
    """

    plan: Path | None = None
    columns: Path | None = None
    start: tuple[float, float, int] | None = None
    heading_deg: float | None = None
    truth: Path | None = None
    mounting: str = ""
    truth_offset_s: float = 0.0
    doors: str = "none"
    surveys: tuple[Path, ...] = ()


def write_draft(files: Sequence[Path], wishes: Wishes, folder: Path) -> tuple[Path, list[str]]:
    """Writes a task file into a folder, in which each file is a walk of the test split.

    A walk without `start` begins at its first place; one without places at (0, 0) with heading 0.

    Of several files one that is refused is a walk that is refused.

    Returns:
        The task file, and what a user should know.
    """
    if wishes.truth is not None and len(files) > 1:
        raise RecordingError(f"--truth {wishes.truth} goes with one recording; got {len(files)}: try them one by one")
    path = folder / TASK_FILE
    columns = None if wishes.columns is None else str(wishes.columns.absolute())
    content = TaskFile(task=TaskTable(id=DRAFT_ID, summary="Recordings that were tried"), columns=columns)
    index = Index(path)
    if wishes.surveys:
        content = msgspec.structs.replace(content, survey=_survey(wishes))
    walks = []
    notes: list[str] = []
    if (
        len(files) == 1
        and len(found := walks_below(path, content, WalkTable(file=str(files[0].absolute())), index)) > 1
    ):
        wishes = replace(wishes, surveys=wishes.surveys or tuple(files))
        content = msgspec.structs.replace(content, survey=_survey(wishes))
        files, notes = best_surveyed(files[0], WalkReader(path, content, None, PlanAlignment(), None), found, index)
    plan = None if wishes.plan is None else read_plan(wishes.plan)
    for file, name in zip(files, _names(files), strict=True):
        table = WalkTable(
            file=str(file.absolute()),
            id=name,
            start=_start(wishes),
            mounting=wishes.mounting,
            truth="" if wishes.truth is None else str(wishes.truth.absolute()),
            truth_offset_s=wishes.truth_offset_s,
        )
        try:
            facts = file_facts(path, content, table, index)
        except RecordingError:
            if len(files) == 1 or not file.exists():
                raise
            walks.append(table)  # refused when the task is opened, which says why
            continue
        has_places = facts.first_s is not None and (plan is None or plan.geo is not None or facts.geo is None)
        has_places = has_places or bool(with_companions(path, table).truth)
        if wishes.start is None and not has_places and wishes.surveys:
            content = msgspec.structs.replace(content, task=msgspec.structs.replace(content.task, start="unknown"))
        elif wishes.start is None and not has_places:
            heading_deg = wishes.heading_deg or 0.0
            table = msgspec.structs.replace(table, start=StartTable(xy_m=(0.0, 0.0), heading_deg=heading_deg))
            unused = f"; {wishes.plan.name} is not used" if wishes.plan is not None else ""
            notes.append(
                f"{name}: no start is known: the path is relative to (0, 0) and heading {heading_deg:g}{unused}; "
                f"give --start x,y,level and --heading"
            )
            plan = None
        if not wishes.mounting and facts.is_shoe:
            table = msgspec.structs.replace(table, mounting="foot")
            notes.append(
                f"{name}: swings and stands in turns, so it is taken for a shoe; --mounting hand or pocket changes that"
            )
        elif not wishes.mounting and not facts.mounting:
            notes.append(
                f"{name}: where it was carried is not known: foot navigation does not play; --mounting foot lets it"
            )
        walks.append(table)
    if plan is not None and wishes.plan is not None:
        content = msgspec.structs.replace(content, plan=PlanTable(file=str(wishes.plan.absolute()), doors=wishes.doors))
    folder.mkdir(parents=True, exist_ok=True)
    index.save()
    path.write_text(as_toml(msgspec.structs.replace(content, walk=tuple(walks))), encoding="utf-8", newline="\n")
    return path, notes


def _survey(wishes: Wishes) -> SurveyTable:
    return SurveyTable(file=tuple(str(survey.absolute()) for survey in wishes.surveys))


def _start(wishes: Wishes) -> StartTable | None:
    if wishes.start is None:
        return None if wishes.heading_deg is None else StartTable(heading_deg=wishes.heading_deg)
    x_m, y_m, level = wishes.start
    return StartTable(xy_m=(x_m, y_m), level=level, heading_deg=wishes.heading_deg)


def _names(files: Sequence[Path]) -> list[str]:
    """An id for each walk: the name of its file, with a number where two have the same."""
    names: list[str] = []
    for file in files:
        stem = file.resolve().name.partition(".")[0] or "walk"
        number = sum(name == stem or name.startswith(f"{stem}-") for name in names)
        names.append(f"{stem}-{number + 1}" if number else stem)
    return names
