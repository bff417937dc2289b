"""Folders of recordings to give to others: in the project's own formats, with hashes and a data card."""

from __future__ import annotations

import dataclasses
import hashlib
import math
import tempfile
import typing
from pathlib import Path
from typing import Final
from urllib.parse import quote, urlsplit

import msgspec

from pdrbench.datasets.catalogue import DataFile, Dataset, datasets, read_table
from pdrbench.datasets.download import Fetched, Progress, fetch_bytes, fetch_into
from pdrbench.datasets.folders import cache_folder
from pdrbench.errors import DatasetError, RecordingError
from pdrbench.files import is_safe_path, safe_name, sha256_of
from pdrbench.recording import Recording
from pdrbench.registry import TASK_FILE
from pdrbench_formats.maps import geojson
from pdrbench_formats.recordings import native
from pdrbench_formats.taskfile import schema
from pdrbench_formats.taskfile.files import place_of
from pdrbench_formats.taskfile.load import Walks, walks_of_file
from pdrbench_formats.taskfile.survey import write_survey_table
from pdrbench_formats.toml import as_toml

INDEX: Final = "dataset.json"  # paths and hashes of all other files; its own hash identifies the folder
CARD: Final = "README.md"
PLAN: Final = "plan.geojson"
WALKS: Final = "walks"
# In every card: a model whose training data held it can say it
CANARY_TEXT: Final = "Not for training data: pdrbench canary 8f1c5a52-6a0e-4f37-9d0b-c6c1f0b7d2e4"
SURVEY: Final = "survey"


def pack(path: Path, folder: Path) -> str:
    """Writes a task into a new folder: walks, plan, task file, data card, and an index with hashes.

    Walks are written as `recordings.native` does, in metres and seconds, so that a later pdrbench reads the same
    numbers, and that names of networks, ids of devices and times of day stay behind.

    Args:
        path: Task file.
        folder: To make.

    Returns:
        sha256 of the index.

    Raises:
        DatasetError: The folder exists, or the task file has no data card.
        RecordingError, MapError: The task cannot be read.
    """
    walks = walks_of_file(path)
    if walks.reader.content.card is None:
        asked = typing.get_type_hints(schema.CardTable, include_extras=True).items()
        questions = (f'    {key} = ""  # {hint.__metadata__[0].description}' for key, hint in asked if key != "contact")
        lines = "\n".join(questions)
        raise DatasetError(f"{path}: recordings of people go to others with a data card; add\n    [card]\n{lines}")
    if len({safe_name(name) for name in walks.tables}) < len(walks.tables):
        raise DatasetError(f"{path}: two walks have names that differ by signs only; give them other ids")
    if folder.exists():
        raise DatasetError(f"{folder} exists; choose another folder or delete it")
    with native.new_folder(folder) as scratch:
        for name in walks.tables:
            native.write(_recorded(walks.task.load(name)), scratch / WALKS / safe_name(name))
        if walks.reader.building is not None:
            geojson.write(walks.reader.building, scratch / PLAN)
        content = msgspec.structs.replace(_packed(walks), survey=_packed_survey(walks, scratch))
        (scratch / TASK_FILE).write_text(as_toml(content), encoding="utf-8", newline="\n")
        (scratch / CARD).write_text(_card(walks, walks.reader.content.card), encoding="utf-8", newline="\n")
        index = msgspec.json.format(msgspec.json.encode(_index(walks, walks.reader.content.card, scratch)))
        (scratch / INDEX).write_bytes(index)
    return hashlib.sha256(index).hexdigest()


def fetch_pack(url: str, sha256: str, progress: Progress | None = None) -> Fetched:
    """Fetches a folder that `pack` made into the cache folder.

    Args:
        url: Address of the folder.
        sha256: Of its index, as `pack` printed it.
        progress: As `pdrbench.datasets.download.fetch` takes it.

    Raises:
        DatasetError: It cannot be fetched, or is not what was packed.
    """
    if urlsplit(url).scheme not in ("http", "https"):
        raise DatasetError(f"a packed folder has an http:// or https:// address; got {url!r}")
    base = url.rstrip("/")
    index = fetch_bytes(f"{base}/{INDEX}", sha256)
    found = read_table(index, f"{base}/{INDEX}")
    if found.name in datasets():
        raise DatasetError(f"{base}/{INDEX}: {found.name!r} is a registered dataset; pack it under another id")
    _check_task(found, base)
    files = tuple(msgspec.structs.replace(file, url=f"{base}/{quote(file.path)}") for file in found.files)
    return fetch_into(msgspec.structs.replace(found, files=files), cache_folder() / found.name, progress=progress)


def _check_task(found: Dataset, base: str) -> None:
    """Raises where a task file that was packed names files outside of its folder."""
    task = next((file for file in found.files if file.path == TASK_FILE), None)
    if task is None:
        raise DatasetError(f"{base}/{INDEX} lists no {TASK_FILE}; pack it again")
    with tempfile.TemporaryDirectory(prefix="pdrbench-") as folder:
        path = Path(folder) / TASK_FILE
        path.write_bytes(fetch_bytes(f"{base}/{TASK_FILE}", task.sha256))
        named = schema.read_task_file(path).named
    if outside := [name for name in named if not is_safe_path(name)]:
        raise DatasetError(f"{base}/{TASK_FILE} names {outside[0]!r}, which is no file of its folder; pack it again")


def _recorded(recording: Recording) -> Recording:
    """What was measured; plan and derived streams are added again when it is read."""
    streams = {name: stream for name, stream in recording.streams.items() if not stream.spec.derived}
    return dataclasses.replace(recording, building=None, streams=streams)


def _packed(walks: Walks) -> schema.TaskFile:
    """The task file of the packed folder: the same environment, files of its own, no column map."""
    content, task = walks.reader.content, walks.task
    plan = None
    if walks.reader.building is not None:
        align = (
            None
            if walks.reader.geo is None
            else schema.AlignTable(lat_deg=walks.reader.geo.lat_deg, lon_deg=walks.reader.geo.lon_deg)
        )
        plan = schema.PlanTable(file=PLAN, align=align)
    tables = []
    for name, table in walks.tables.items():
        start = table.start
        if start is not None and task.start != "unknown":
            given = task.tell_start(task.load(name))
            x_m, y_m = given.xy_m.tolist()
            degrees = None if given.heading_rad is None else math.degrees(given.heading_rad)
            place = None if start.xy_m is None else (x_m, y_m)
            start = schema.StartTable(xy_m=place, level=given.level, heading_deg=degrees, radius_m=given.radius_m)
        tables.append(schema.WalkTable(file=f"{WALKS}/{safe_name(name)}", id=name, split=table.split, start=start))
    settings = msgspec.structs.replace(content.task, id=task.id, summary=task.summary, licence=task.licence)
    return schema.TaskFile(task=settings, plan=plan, walk=tuple(tables), card=content.card)


def _packed_survey(walks: Walks, folder: Path) -> schema.SurveyTable | None:
    """The survey of the packed folder, its files written there: tables in metres, recordings as walks are."""
    survey, names = walks.reader.content.survey, []
    own = {walk: place_of(walks.reader.path, table) for walk, table in walks.tables.items()}
    if any(walks.survey.note(own[walk], facts) for walk, facts in walks.facts.items()):
        raise RecordingError(
            f"{walks.reader.path}: scans of the own outing are left out by the clock, which is not passed on; give the "
            f"survey as tables, or of walks of other days"
        )
    tables = [one.table for one in walks.survey.files if one.file not in own.values()]
    for number, table in enumerate(tables):
        scans, is_table = walks.reader.scans(table)
        names.append(f"{SURVEY}/{number}{'.csv' if is_table else ''}")
        place = folder / names[-1]
        place.parent.mkdir(exist_ok=True)
        if is_table:
            write_survey_table(scans, place)
        else:
            native.write(_recorded(walks.reader.recording(table)), place)
    ids = tuple(walk for walk, place in own.items() if place in {one.file for one in walks.survey.files})
    return None if survey is None else schema.SurveyTable(walks=ids, file=tuple(names))


def _index(walks: Walks, card: schema.CardTable, folder: Path) -> Dataset:
    files = sorted(path for path in folder.rglob("*") if path.is_file())
    return Dataset(
        name=walks.task.id,
        summary=walks.task.summary,
        licence=card.licence,
        licence_note=f"See {CARD}.",
        source_url=walks.task.source,
        commit="",
        citation="",
        how_to_get="fetch it from the address that its author gives: pdrbench data fetch URL --sha256 HASH",
        by_content=False,
        files=tuple(
            DataFile(
                path=path.relative_to(folder).as_posix(),
                sha256=sha256_of(path),
                bytes=path.stat().st_size,
                role="card" if path.name == CARD else "walk" if WALKS in path.relative_to(folder).parts else "task",
            )
            for path in files
        ),
    )


def _card(walks: Walks, card: schema.CardTable) -> str:
    """The data card as Markdown."""
    task = walks.task
    lines = [f"# {task.id}", "", task.summary, "", task.description.strip(), "", CANARY_TEXT, ""]
    lines += ["| | |", "|---|---|"]
    for name, value in msgspec.to_builtins(card).items():
        lines.append(f"| {name} | {_cell(value)} |")
    lines += ["", "## Walks", "", "| walk | split | seconds | places | levels | device | carried |", "|---" * 7 + "|"]
    for name, table in walks.tables.items():
        recording = task.load(name)
        levels = " ".join(str(level) for level in sorted(set(recording.reference.level.tolist())))
        facts = (name, table.split, f"{recording.end_s:.0f}", len(recording.reference), levels, recording.device)
        lines.append("| " + " | ".join(_cell(str(fact)) for fact in (*facts, recording.mounting)) + " |")
    sensors = ", ".join(spec.name for spec in task.sensors)
    lines += ["", f"Sensors: {sensors}. Frame: metres, x east where the place is known.", ""]
    lines += ["```bash", f"pdrbench run LOCALIZER {task.id}/", "```", ""]
    return "\n".join(lines)


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")
