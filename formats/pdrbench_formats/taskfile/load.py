"""From a `task.toml`, and the recordings and the plan that it names, to a `Task`."""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.building import Building
from pdrbench.errors import RecordingError, unknown_name
from pdrbench.io import READERS
from pdrbench.io.detect import detect, read, read_plan
from pdrbench.io.geo import GeoFrame
from pdrbench.io.log import Log
from pdrbench.io.plan import Plan
from pdrbench.recording import RadioMap, Recording, SensorSpec, SensorStream
from pdrbench.registry import environments
from pdrbench.sensors import SENSORS
from pdrbench.task import SPLITS, StartKnowledge, Task
from pdrbench.trajectory import Start, Trajectory
from pdrbench_formats.derive import DERIVED, derive, missing_reason
from pdrbench_formats.taskfile.places import PlanAlignment, moved, read_places
from pdrbench_formats.taskfile.schema import StartTable, TaskFile, WalkTable, read_task_file
from pdrbench_formats.taskfile.survey import begun_at, radio_map_of

TRUTH_END: Final = "_truth.csv"  # of the name of a table of places beside a recording
MAX_LEAD_S: Final = 2.0  # a recording may begin so long before the place that is its start
TABLE: Final = "csv"  # the format that column maps explain
TABLE_ENDS: Final = (".csv", ".tsv", ".txt")
MAX_NOTES: Final = 3  # that stand beside scores
MAX_FILES: Final = 10_000  # of a recording that is a folder
MIN_CAPACITY: Final = 16  # rows of a sensor in an observation
_WORD: Final = re.compile(r"[A-Za-z0-9]+")


def task_of_file(path: Path) -> Task:
    """The task of a `task.toml`; made again where that file, a recording or the plan has changed."""
    return walks_of_file(path).task


def walks_of_file(path: Path) -> Walks:
    """Everything that a `task.toml` names.

    Raises:
        RecordingError, MapError: A file is missing or wrong; or two things do not go together.
    """
    content = read_task_file(path)
    walks = dict(_named_walks(path, content))
    files = [path, *(_beside(path, name) for name in _files(content)), *(_beside(path, w.file) for w in walks.values())]
    return _open(path, tuple((str(file), *_stamp(file)) for file in files))


@dataclass(frozen=True, slots=True)
class Walks:
    """The walks of a task file, read.

    Attributes:
        path: Of the task file.
        content: Of the task file.
        tables: What it says of each walk, by id.
        building: The plan in metres, x east; None where there is none.
        geo: Place of (0, 0) on the Earth; None where neither plan nor recordings say.
        task: The environment.
        begin_s: Time 0 of each walk on the clock of its file.
        notes: What a user should know of how the files were put together.
    """

    path: Path
    content: TaskFile
    tables: Mapping[str, WalkTable]
    building: Building | None
    geo: GeoFrame | None
    task: Task
    begin_s: Mapping[str, float]
    notes: tuple[str, ...]

    def log(self, walk: str) -> Log | Recording:
        """What the reader made of the file of a walk."""
        return read_walk(self.path, self.content, self.tables[walk])

    def missing(self, walk: str) -> dict[str, str]:
        """Why a sensor that could be computed from others is not, by sensor."""
        recording = self.task.load(walk)
        start = None if self.task.start == "unknown" else self.task.tell_start(recording)
        lacking = [name for name in DERIVED if name not in recording.streams]
        reasons = {name: missing_reason(recording.streams, recording.mounting, name, start=start) for name in lacking}
        return {name: reason for name, reason in reasons.items() if reason}


@functools.lru_cache(maxsize=8)
def _open(path: Path, _stamps: tuple[tuple[str, int, int], ...]) -> Walks:
    return _Opening(path).walks()


class _Opening:
    """Puts a task together from its file."""

    def __init__(self, path: Path) -> None:
        self._path, self._content = path, read_task_file(path)
        self._tables = dict(_named_walks(path, self._content))
        if not self._tables:
            raise RecordingError(f"{path}: no walk; add [[walk]] with a file, or put recordings beside it")
        self._notes: list[str] = []
        self._begin_s: dict[str, float] = {}
        if not self._content.walk:
            self._notes += [f"{name} is no recording" for name in _other_files(path, self._content, self._tables)]
        align = None if self._content.plan is None else self._content.plan.align
        self._turn = PlanAlignment() if align is None else PlanAlignment(math.radians(align.turn_deg), align.scale)
        self._building, self._geo = self._plan()

    def walks(self) -> Walks:
        recordings = {name: self._recording(name) for name in self._tables}
        task = self._task(recordings)
        return Walks(
            self._path,
            self._content,
            self._tables,
            self._building,
            self._geo,
            task,
            dict(self._begin_s),
            tuple(dict.fromkeys(self._notes)),
        )

    def _plan(self) -> tuple[Building | None, GeoFrame | None]:
        table = self._content.plan
        if table is None:
            return None, None
        place = _beside(self._path, table.file)
        plan = _read_plan_once(place, table.format, _stamp(place))
        self._notes += [f"{place.name}: {warning}" for warning in plan.warnings]
        geo, align = plan.geo, table.align
        if align is not None and align.lat_deg is not None and align.lon_deg is not None:
            geo = GeoFrame(align.lat_deg, align.lon_deg)
        return self._turn.building(plan.building), geo

    def _recording(self, walk: str) -> Recording:
        """A walk with all its sensors, in the frame of the task."""
        table = self._tables[walk]
        found = read_walk(self._path, self._content, table)
        geo = getattr(found, "geo", None)
        reference = found.reference
        if table.truth:
            reference, geo = read_places(_beside(self._path, table.truth), getattr(found, "start_unix_s", None))
        rows = found.rows if isinstance(found, Log) else {name: s.rows for name, s in found.streams.items()}
        building = self._building
        if building is None and isinstance(found, Recording):
            building = found.building
        whole = Recording(
            id=walk,
            building=building,
            streams={name: SensorStream(_spec(name, found), rows[name]) for name in rows},
            reference=self._scored(table, self._placed(walk, reference, geo)),
            subject={**getattr(found, "subject", {}), **table.subject},
            device=found.device,
            mounting=table.mounting or found.mounting,
        )
        begin_s = self._begin(walk, whole.reference)
        return whole if begin_s == 0.0 else begun_at(whole, begin_s)

    def _derived(self, recording: Recording, start: Start | None) -> Recording:
        """A recording with the streams that it lacks and that can be computed, also from the start that is given."""
        settings = self._content.task
        wanted = DERIVED if settings.sensors is None else settings.sensors
        lacking = [name for name in wanted if name not in recording.streams]
        if not settings.derive or not lacking:
            return recording
        try:
            streams = derive(recording.streams, recording.mounting, lacking, start=start, building=recording.building)
        except RecordingError as error:
            raise RecordingError(f"{self._path}: walk {recording.id!r}: {error}") from error
        return dataclasses.replace(recording, streams=streams)

    def _placed(self, walk: str, reference: Trajectory, geo: GeoFrame | None) -> Trajectory:
        """A reference in the frame of the task."""
        if not len(reference):
            return reference
        if geo is None:
            return moved(reference, self._turn(reference.xy_m), self._turn.turn_rad)
        if self._geo is None and self._building is None:
            self._geo = geo
        if self._geo is None:
            if reference.surveyed.any():
                raise RecordingError(
                    f"{self._path}: the places of walk {walk!r} are latitudes and longitudes, and the plan does not "
                    f"say where it lies; add [plan.align] with lat_deg and lon_deg of its origin, or give metres"
                )
            self._notes.append(f"{walk}: latitudes and longitudes are left out: the plan does not say where it lies")
            return reference.rows(np.zeros(len(reference), dtype=np.bool_))
        return moved(reference, self._geo.to_local(*geo.to_geo(reference.xy_m)))

    def _starts_at_place(self, table: WalkTable) -> bool:
        """True where the first place of a walk is given as its start."""
        return (table.start is None or table.start.xy_m is None) and self._content.task.start != "unknown"

    def _begin(self, walk: str, reference: Trajectory) -> float:
        """Time from which a recording is used: that of the place which is its start, where that is seconds later."""
        begin_s = 0.0
        if self._starts_at_place(self._tables[walk]) and len(reference) and reference.t_s[0] > MAX_LEAD_S:
            begin_s = float(reference.t_s[0])
            self._notes.append(f"{walk}: its first {begin_s:.1f} s, before the first place, are left out")
        self._begin_s[walk] = begin_s
        return begin_s

    def _scored(self, table: WalkTable, reference: Trajectory) -> Trajectory:
        """A reference whose first place does not count where it is given as the start."""
        if not self._starts_at_place(table):
            return reference
        surveyed = reference.surveyed & (np.arange(len(reference)) > 0)
        return dataclasses.replace(reference, surveyed=surveyed)

    def _start(self, walk: str, reference: Trajectory) -> Start | None:
        """The start of a walk as its table or its first place gives it."""
        table = self._tables[walk].start or StartTable()
        heading_rad = None if table.heading_rad is None else table.heading_rad + self._turn.turn_rad
        if table.xy_m is not None:
            return Start(self._turn(np.array(table.xy_m)), table.level, heading_rad, table.radius_m)
        if not len(reference):
            return None
        if heading_rad is None and reference.heading_rad is not None:
            heading_rad = float(reference.heading_rad[0])
        return Start(reference.xy_m[0], int(reference.level[0]), heading_rad, table.radius_m)

    def _task(self, recordings: Mapping[str, Recording]) -> Task:
        settings = self._content.task
        starts = {name: self._start(name, recording.reference) for name, recording in recordings.items()}
        knowledge = self._knowledge(starts)
        given = dict.fromkeys(starts) if knowledge == "unknown" else starts
        recordings = {name: self._derived(recording, given[name]) for name, recording in recordings.items()}
        specs = _offered(recordings.values(), settings.sensors, self._path)
        walks = {split: tuple(name for name, t in self._tables.items() if t.split == split) for split in SPLITS[:-1]}
        name = settings.id or _id_of(self._path)
        if name in environments():
            raise RecordingError(
                f"{self._path}: a registered environment is called {name}; choose another id in [task]"
            )
        load = functools.partial(self._load, specs, given)
        try:
            return Task(
                id=name,
                summary=settings.summary or f"Recordings of {self._path.parent.name}",
                description=settings.description,
                sensors=tuple(specs.values()),
                capacity={name: _capacity(name, recordings.values(), settings.period_s) for name in specs},
                period_s=settings.period_s,
                start=knowledge,
                walks={split: ids for split, ids in walks.items() if ids},
                load=load,
                tell_start=lambda recording: _known(starts, recording.id),
                licence=settings.licence or (self._content.card.licence if self._content.card else "not stated"),
                source=settings.source or "local files",
                radio_map=functools.partial(self._radio_map, self._survey_walks(), load),
                note=_joined(self._notes),
                superseded_by=settings.superseded_by,
            )
        except RecordingError as error:
            raise RecordingError(f"{self._path}: {error}") from error

    def _load(self, specs: Mapping[str, SensorSpec], given: Mapping[str, Start | None], walk: str) -> Recording:
        """A walk with the sensors that are offered."""
        if walk not in self._tables:
            raise unknown_name(f"walk of {self._path}", walk, self._tables)
        recording = self._derived(self._recording(walk), given[walk])
        streams = {name: SensorStream(specs[name], s.rows) for name, s in recording.streams.items() if name in specs}
        return dataclasses.replace(recording, streams=streams)

    def _knowledge(self, starts: Mapping[str, Start | None]) -> StartKnowledge:
        stated = self._content.task.start
        lacking = [name for name, start in starts.items() if start is None]
        if stated == "unknown" or (stated is None and lacking and self._building is not None):
            return "unknown"
        if lacking:
            raise RecordingError(
                f"{self._path}: walk {lacking[0]!r} has neither a start nor a place; add to its [[walk]]: "
                f"start = {{ xy_m = [0, 0], level = 0, heading_deg = 0 }}"
            )
        return stated or "pose"

    def _survey_walks(self) -> tuple[str, ...]:
        survey = self._content.survey
        if survey is None:
            return ()
        for walk in survey.walks:
            if walk not in self._tables:
                raise unknown_name(f"walk of {self._path}", walk, self._tables)
        return survey.walks

    def _radio_map(
        self, survey: tuple[str, ...], load: Callable[[str], Recording], recording: Recording
    ) -> RadioMap | None:
        """The scans of survey walks, but for those of the recording itself."""
        return radio_map_of([load(walk) for walk in survey if walk != recording.id])


def _joined(notes: Iterable[str]) -> str:
    """Notes in one line, of many the first."""
    different = list(dict.fromkeys(notes))
    more = f"; and {len(different) - MAX_NOTES} more" if len(different) > MAX_NOTES else ""
    return "; ".join(different[:MAX_NOTES]) + more


def _known(starts: Mapping[str, Start | None], walk: str) -> Start:
    start = starts[walk]
    assert start is not None  # `_knowledge` has seen to it
    return start


def _named_walks(path: Path, content: TaskFile) -> Iterator[tuple[str, WalkTable]]:
    """Id and table of each walk; without tables, every file of the folder that a reader of walks recognises."""
    seen: set[str] = set()
    for table in content.walk or _found_walks(path, content):
        file = Path(table.file)
        name = table.id or file.name.partition(".")[0] or file.resolve().name
        if name in seen:
            raise RecordingError(f"{path}: two walks are called {name!r}; give one of them an id")
        seen.add(name)
        truth = file.with_name(f"{name}{TRUTH_END}")
        if not table.truth and _beside(path, str(truth)).is_file():
            table = msgspec.structs.replace(table, truth=str(truth))
        yield name, table


def _found_walks(path: Path, content: TaskFile) -> Iterator[WalkTable]:
    named = {_beside(path, name) for name in _files(content)} | {path}
    for place in sorted(path.parent.iterdir()):
        if place in named or place.name.startswith(".") or place.name.endswith(TRUTH_END):
            continue
        try:
            kind = detect(place)
        except RecordingError:
            continue  # a text, a picture, results of a run: `_Opening` says so
        options = _column_options(kind, content)
        if isinstance(_read_once(place, kind, options, _stamp(place)), (Log, Recording)):
            yield WalkTable(file=place.name, format=kind)


def _other_files(path: Path, content: TaskFile, tables: Mapping[str, WalkTable]) -> list[str]:
    """Names in the folder of a task that it does not use."""
    used = {path.name, *(Path(name).name for name in _files(content))}
    for table in tables.values():
        used |= {table.file, table.truth}
    return sorted(place.name for place in path.parent.iterdir() if place.name not in used and place.name[0] != ".")


def _files(content: TaskFile) -> Iterator[str]:
    """Files that a task file names beside its walks."""
    if content.plan is not None:
        yield content.plan.file
    yield from (table.truth for table in content.walk if table.truth)


def _beside(path: Path, name: str) -> Path:
    """A file that a task file names."""
    return path.parent / Path(name).expanduser()


def _stamp(place: Path) -> tuple[int, int]:
    """Size and time of the last change of a file, or of all files of a folder; zeros where it is missing."""
    try:
        files = [*itertools.islice(place.rglob("*"), MAX_FILES)] if place.is_dir() else [place]
        states = [file.stat() for file in files]
    except OSError:
        return 0, 0
    return sum(state.st_size for state in states), max((state.st_mtime_ns for state in states), default=0)


def read_walk(path: Path, content: TaskFile, table: WalkTable) -> Log | Recording:
    """What a reader makes of the file of a walk.

    Args:
        path: Of the task file.
        content: Of the task file.
        table: What it says of the walk.
    """
    place = _beside(path, table.file)
    kind = table.format
    if not kind and content.columns is not None and place.is_file() and place.suffix in TABLE_ENDS:
        kind = TABLE
    kind = kind or detect(place)
    found = _read_once(place, kind, _column_options(kind, content), _stamp(place))
    if not isinstance(found, (Log, Recording)):
        raise RecordingError(f"{place}: holds {type(found).__name__}, no walk; name a recording")
    return found


def _column_options(kind: str, content: TaskFile) -> tuple[tuple[str, str], ...]:
    """The column map of a task, for a reader that takes one."""
    if content.columns is None or "columns" not in READERS[kind].options:
        return ()
    return (("columns", msgspec.json.encode(content.columns).decode()),)


@functools.lru_cache(maxsize=32)
def _read_once(place: Path, kind: str, options: tuple[tuple[str, str], ...], _stamped: tuple[int, int]) -> Any:
    return read(place, kind or None, **{name: msgspec.json.decode(value) for name, value in options})


@functools.lru_cache(maxsize=8)
def _read_plan_once(place: Path, kind: str, _stamped: tuple[int, int]) -> Plan:
    return read_plan(place, kind or None)


def _id_of(path: Path) -> str:
    """An id from the name of a folder.

    >>> _id_of(Path("my_walks-2/task.toml"))
    'MyWalks2-v0'
    """
    words = _WORD.findall(path.parent.resolve().name)
    name = "".join(word[0].upper() + word[1:] for word in words)
    return f"{name if name[:1].isalpha() else f'Walks{name}'}-v0"


def _spec(name: str, found: Log | Recording) -> SensorSpec:
    return SENSORS[name] if isinstance(found, Log) else found.streams[name].spec


def _offered(recordings: Collection[Recording], wanted: tuple[str, ...] | None, path: Path) -> dict[str, SensorSpec]:
    """Spec of each sensor that a walk has, or of those that are wanted, with the rates at which they came."""
    streams: dict[str, list[SensorStream]] = {}
    for recording in recordings:
        for name, stream in recording.streams.items():
            streams.setdefault(name, []).append(stream)
    for name in wanted or ():
        if name not in streams:
            reasons = (missing_reason(r.streams, r.mounting, name) for r in recordings if name in DERIVED)
            why = next(reasons, "") or unknown_name("sensor in the recordings", name, streams)
            raise RecordingError(f"{path}: {why}")
    order = [name for name in SENSORS if name in streams] + [name for name in streams if name not in SENSORS]
    return {name: _rated(streams[name]) for name in (wanted or order)}


def _rated(streams: list[SensorStream]) -> SensorSpec:
    """The spec of a sensor, with the median rate over walks."""
    spec = dataclasses.replace(streams[0].spec, derived=any(stream.spec.derived for stream in streams))
    gaps_s = [np.diff(stream.t_s) for stream in streams if len(stream.rows) > 1]
    rates_hz = [1.0 / float(np.median(gap[gap > 0])) for gap in gaps_s if (gap > 0).any()]
    if spec.rate_hz is None or not rates_hz:
        return spec
    return dataclasses.replace(spec, rate_hz=float(f"{np.median(rates_hz):.3g}"))


def _capacity(name: str, recordings: Iterable[Recording], period_s: float) -> int:
    """Rows that one observation must hold so that none is late, as a power of two."""
    most = MIN_CAPACITY
    for recording in recordings:
        if name in recording.streams:
            t_s = recording.streams[name].t_s
            _, counts = np.unique(np.ceil(t_s / period_s - 1e-6), return_counts=True)
            most = max(most, int(counts.max(initial=0)))
    return 1 << math.ceil(math.log2(most))
