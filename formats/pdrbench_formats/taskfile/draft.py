"""A task file for files that a user names on the command line."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import msgspec

from pdrbench.errors import RecordingError
from pdrbench.registry import TASK_FILE
from pdrbench_formats.detect import read_plan
from pdrbench_formats.maps.plan import PlanAlignment
from pdrbench_formats.taskfile import schema
from pdrbench_formats.taskfile.files import file_facts, walks_below, with_companions
from pdrbench_formats.taskfile.index import Index
from pdrbench_formats.taskfile.surveyed import best_surveyed
from pdrbench_formats.taskfile.walk import WalkReader
from pdrbench_formats.toml import as_toml

DRAFT_ID = "Try-v0"


def write_draft(
    files: Sequence[Path], named: schema.TaskFile, each: schema.WalkTable, folder: Path
) -> tuple[Path, list[str]]:
    """Writes a task file into a folder, in which each file is a walk of the test split.

    A walk without `start` begins at its first place; one without places at (0, 0) with heading 0. Of several files one
    that is refused is a walk that is refused.

    Args:
        files: Recordings, or the folder of a building.
        named: Plan, column map and survey, as a user names them.
        each: What a user says of every walk.
        folder: Of the task file.

    Returns:
        The task file, and what a user should know.
    """
    if each.truth and len(files) > 1:
        raise RecordingError(f"--truth {each.truth} goes with one recording; got {len(files)}: try them one by one")
    path, notes = folder / TASK_FILE, list[str]()
    settings = schema.TaskTable(id=DRAFT_ID, summary="Recordings that were tried")
    content, index = msgspec.structs.replace(named, task=settings, plan=None), Index(path)
    if len(files) == 1:
        whole = schema.WalkTable(file=str(files[0].absolute()))
        if len(found := walks_below(path, content, whole, index)) > 1:
            survey = content.survey or schema.SurveyTable(file=whole.file)
            content = msgspec.structs.replace(content, survey=survey)
            files, notes = best_surveyed(files[0], WalkReader(path, content, None, PlanAlignment(), None), found, index)
    plan, walks = named.plan, []
    drawn = None if plan is None else read_plan(plan.file)
    for file, name in zip(files, _names(files), strict=True):
        table = msgspec.structs.replace(each, file=str(file.absolute()), id=name)
        try:
            facts = file_facts(path, content, table, index)
        except RecordingError:
            if len(files) == 1 or not file.exists():
                raise
            walks.append(table)  # refused when the task is opened, which says why
            continue
        has_places = facts.first_s is not None and (drawn is None or drawn.geo is not None or facts.geo is None)
        has_places = has_places or bool(with_companions(path, table).truth)
        begin = each.start or schema.StartTable()
        has_start = has_places or begin.xy_m is not None
        if not has_start and content.survey is not None:
            content = msgspec.structs.replace(content, task=msgspec.structs.replace(content.task, start="unknown"))
        elif not has_start:
            heading_deg = begin.heading_deg or 0.0
            table = msgspec.structs.replace(table, start=schema.StartTable(xy_m=(0.0, 0.0), heading_deg=heading_deg))
            unused = f"; {Path(named.plan.file).name} is not used" if named.plan is not None else ""
            notes.append(
                f"{name}: no start is known: the path is relative to (0, 0) and heading {heading_deg:g}{unused}; "
                f"give --start x,y,level and --heading"
            )
            plan = None
        if not each.mounting and facts.is_shoe:
            table = msgspec.structs.replace(table, mounting="foot")
            notes.append(
                f"{name}: swings and stands in turns, so it is taken for a shoe; --mounting hand or pocket changes that"
            )
        elif not each.mounting and not facts.mounting:
            notes.append(
                f"{name}: where it was carried is not known: foot navigation does not play; --mounting foot lets it"
            )
        walks.append(table)
    content = msgspec.structs.replace(content, plan=plan, walk=tuple(walks))
    folder.mkdir(parents=True, exist_ok=True)
    index.save()
    path.write_text(as_toml(content), encoding="utf-8", newline="\n")
    return path, notes


def _names(files: Sequence[Path]) -> list[str]:
    """An id for each walk: the name of its file, with a number where two have the same."""
    names: list[str] = []
    for file in files:
        stem = file.resolve().name.partition(".")[0] or "walk"
        number = sum(name == stem or name.startswith(f"{stem}-") for name in names)
        names.append(f"{stem}-{number + 1}" if number else stem)
    return names
