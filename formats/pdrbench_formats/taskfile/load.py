"""From a `task.toml`, and the recordings and the plan that it names, to a `Task`."""

from __future__ import annotations

import dataclasses
import functools
import math
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeVar

from pdrbench.errors import RecordingError, unknown_name
from pdrbench.io.geo import GeoFrame
from pdrbench.recording import RadioMap, Recording, SensorSpec, SensorStream
from pdrbench.registry import environments
from pdrbench.sensors import SENSORS
from pdrbench.task import SPLITS, StartKnowledge, Task
from pdrbench.trajectory import Start
from pdrbench_formats.maps.plan import PlanAlignment
from pdrbench_formats.taskfile import files
from pdrbench_formats.taskfile.files import FileFacts
from pdrbench_formats.taskfile.index import Index
from pdrbench_formats.taskfile.schema import WalkTable, read_task_file
from pdrbench_formats.taskfile.surveyed import Survey, survey_of
from pdrbench_formats.taskfile.walk import StreamFacts, WalkReader, stream_facts

MAX_NOTES: Final = 3  # that stand beside scores
MIN_CAPACITY: Final = 16  # rows of a sensor in an observation
Found = TypeVar("Found")
_WORD: Final = re.compile(r"[A-Za-z0-9]+")


def task_of_file(path: Path) -> Task:
    """The task of a `task.toml`; made again where that file, a recording or the plan has changed."""
    return walks_of_file(path).task


def walks_of_file(path: Path) -> Walks:
    """Everything that a `task.toml` names.

    Each recording is read once and what a task has to know of it is kept in the cache folder, until the file changes;
    it is read again when its walk is played.

    Raises:
        RecordingError, MapError: A file is missing or wrong; or two things do not go together.
    """
    named = files.named_files(path, read_task_file(path))
    return _open(path, tuple((str(file), *files.stamp(file)) for file in named))


@dataclass(frozen=True, slots=True)
class Walks:
    """The walks of a task file.

    Attributes:
        reader: Of their files.
        tables: What the task file says of each walk, by id.
        survey: The radio survey.
        task: The environment.
        facts: What is known of the file of each walk.
        begin_s: Time 0 of each walk on the clock of its file.
        refused: Why a walk cannot be played, by its id; `task.load` raises it, and each localizer fails there.
        notes: What a user should know of how the files were put together.
    """

    reader: WalkReader
    tables: Mapping[str, WalkTable]
    survey: Survey
    task: Task
    facts: Mapping[str, FileFacts]
    begin_s: Mapping[str, float]
    refused: Mapping[str, str]
    notes: tuple[str, ...]

    def missing(self, walk: str) -> dict[str, str]:
        """Why a sensor that could be computed from others is not, by sensor."""
        from pdrbench_formats.derive import DERIVED, missing_reason

        recording = self.task.load(walk)
        start = None if self.task.start == "unknown" else self.task.tell_start(recording)
        lacking = [name for name in DERIVED if name not in recording.streams]
        reasons = {name: missing_reason(recording.streams, recording.mounting, name, start=start) for name in lacking}
        return {name: reason for name, reason in reasons.items() if reason}


@functools.lru_cache(maxsize=8)
def _open(path: Path, _stamps: tuple[tuple[str, int, int], ...]) -> Walks:
    index = Index(path)
    try:
        return _Opening(path, index).walks()
    finally:
        index.save()  # also of the files before one that is wrong


class _Opening:
    """Puts a task together from its file."""

    def __init__(self, path: Path, index: Index) -> None:
        self._path, self._content, self._index = path, read_task_file(path), index
        self._tables = files.walk_tables(path, self._content, index)
        if not self._tables:
            raise RecordingError(f"{path}: no walk; add [[walk]] with a file, or put recordings beside it")
        self._notes: list[str] = []
        self._refused: dict[str, str] = {}  # walks that are not played, with the reason
        if not self._content.walk:
            unused = files.unused_files(path, self._content, self._tables)
            self._notes += [f"{name} is no recording" for name in unused]
        self._reader = self._begin_reader()

    def walks(self) -> Walks:
        facts = self._facts()
        knowledge = self._knowledge(facts)
        facts = {walk: one for walk, one in facts.items() if walk not in self._refused}
        streams = self._kept(facts, lambda walk: self._streams(walk, facts[walk], is_given=knowledge != "unknown"))
        facts = {walk: facts[walk] for walk in streams}
        begin_s = {walk: self._begin_s(walk, facts[walk]) for walk in facts}
        specs, (survey, problems) = self._specs(streams), self._survey()
        is_given = knowledge != "unknown"
        source = _Source(self._reader, self._tables, self._refused, specs, survey, facts, is_given)
        said = {walk: survey.note(files.place_of(self._path, self._tables[walk]), one) for walk, one in facts.items()}
        self._notes += [*problems, *(f"{walk}: {note}" for walk, note in said.items() if note)]
        self._notes += [f"{walk} is refused: {reason}" for walk, reason in self._refused.items()]
        return Walks(
            reader=self._reader,
            tables=self._tables,
            survey=survey,
            task=self._task(knowledge, source, specs, streams),
            facts=facts,
            begin_s=begin_s,
            refused=self._refused,
            notes=tuple(dict.fromkeys(self._notes)),
        )

    def _begin_reader(self) -> WalkReader:
        table = self._content.plan
        align = None if table is None else table.align
        turn = PlanAlignment() if align is None else PlanAlignment(math.radians(align.turn_deg), align.scale)
        if table is None:
            return WalkReader(self._path, self._content, None, turn, None)
        place = files.beside(self._path, table.file)
        plan = files.read_plan_once(place, table.format, table.doors, files.stamp(place))
        self._notes += [f"{place.name}: {warning}" for warning in plan.warnings]
        geo = plan.geo
        if align is not None and align.lat_deg is not None and align.lon_deg is not None:
            geo = GeoFrame(align.lat_deg, align.lon_deg)
        return WalkReader(self._path, self._content, turn.building(plan.building), turn, geo)

    def _facts(self) -> dict[str, FileFacts]:
        """What is known of the file of each walk. Without a plan, the first places on the Earth make the frame."""

        def find(walk: str) -> FileFacts:
            table = self._tables[walk]
            facts = files.file_facts(self._path, self._content, table, self._index)
            if self._reader.geo is None and self._reader.building is None:
                self._reader = dataclasses.replace(self._reader, geo=facts.geo)
                if facts.geo is not None and table.truth:  # nothing else says where that is
                    where = f"latitude {facts.geo.lat_deg:g}, longitude {facts.geo.lon_deg:g}"
                    self._notes.append(f"{walk}: its places lie at {where}; if not, exchange the names of the two")
            is_given = self._content.task.start != "unknown" and self._reader.has_start(table, facts)
            self._streams(walk, facts, is_given=is_given)  # while its file is in memory
            return facts

        return self._kept(self._tables, find)

    def _kept(self, walks: Iterable[str], find: Callable[[str], Found]) -> dict[str, Found]:
        """What is found of each walk. One that is refused is set aside with the reason, unless it is the last one.

        A file that is missing is no refused walk: the task file names another one.
        """
        kept: dict[str, Found] = {}
        for walk in walks:
            try:
                kept[walk] = find(walk)
            except RecordingError as error:
                if not files.beside(self._path, self._tables[walk].file).exists():
                    raise
                self._refused[walk] = str(error)
                last = error
        if not kept:
            raise last
        return kept

    def _streams(self, walk: str, facts: FileFacts, *, is_given: bool) -> dict[str, StreamFacts]:
        """What is known of each stream of a walk, recorded or computed."""
        table, settings, plan = self._tables[walk], self._content.task, self._content.plan

        def find() -> dict[str, StreamFacts]:
            recording = self._reader.recording(table)
            start = self._reader.start(table, recording.reference) if is_given else None
            streams = self._reader.with_derived(recording, start).streams
            return {name: stream_facts(stream, settings.period_s) for name, stream in streams.items()}

        shared = (plan, files.stamp(files.beside(self._path, plan.file)) if plan is not None else None)
        frame = None if facts.geo is None else self._reader.geo
        settled = settings.start, settings.period_s, settings.sensors, settings.derive
        causes = files.causes_of(self._path, self._content, table), table, shared, frame, settled, is_given
        return self._index.facts(f"streams {walk}", dict[str, StreamFacts], causes, find)

    def _begin_s(self, walk: str, facts: FileFacts) -> float:
        """Time from which the file of a walk is used."""
        if facts.first_s is not None and self._reader.first_s(facts) is None:
            self._notes.append(f"{walk}: latitudes and longitudes are left out: the plan does not say where it lies")
        begin_s = self._reader.begin_s(self._tables[walk], self._reader.first_s(facts))
        if begin_s:
            self._notes.append(f"{walk}: its first {begin_s:.1f} s, before the first place, are left out")
        return begin_s

    def _knowledge(self, facts: Mapping[str, FileFacts]) -> StartKnowledge:
        stated = self._content.task.start
        lacking = [walk for walk, one in facts.items() if not self._reader.has_start(self._tables[walk], one)]
        if stated == "unknown" or (stated is None and lacking and self._reader.building is not None):
            return "unknown"
        for walk in lacking:
            self._refused[walk] = (
                f"{self._path}: walk {walk!r} has neither a start nor a place; add to its [[walk]]: "
                f"start = {{ xy_m = [0, 0], level = 0, heading_deg = 0 }}"
            )
        if len(lacking) == len(facts):
            raise RecordingError(self._refused[lacking[0]])
        return stated or "pose"

    def _specs(self, walks: Mapping[str, Mapping[str, StreamFacts]]) -> dict[str, SensorSpec]:
        """Spec of each sensor that a walk has, or of those that are wanted, with the rates at which they came."""
        streams: dict[str, list[StreamFacts]] = {}
        for facts in walks.values():
            for name, stream in facts.items():
                streams.setdefault(name, []).append(stream)
        order = [name for name in SENSORS if name in streams] + [name for name in streams if name not in SENSORS]
        wanted = self._content.task.sensors or order
        for name in wanted:
            if name not in streams:
                raise RecordingError(f"{self._path}: {self._why_missing(name, list(streams))}")
        specs = {name: streams[name][0].spec_over(streams[name]) for name in wanted}
        stated = self._content.task.rates_hz
        return {name: dataclasses.replace(spec, rate_hz=stated.get(name, spec.rate_hz)) for name, spec in specs.items()}

    def _why_missing(self, name: str, present: Sequence[str]) -> str:
        """Why no walk has a sensor that is wanted."""
        from pdrbench_formats.derive import DERIVED, missing_reason

        recordings = (self._reader.recording(table) for table in self._tables.values() if name in DERIVED)
        reasons = (missing_reason(recording.streams, recording.mounting, name) for recording in recordings)
        return next(filter(None, reasons), "") or str(unknown_name("sensor in the recordings", name, present))

    def _task(
        self,
        knowledge: StartKnowledge,
        source: _Source,
        specs: Mapping[str, SensorSpec],
        streams: Mapping[str, Mapping[str, StreamFacts]],
    ) -> Task:
        settings, card = self._content.task, self._content.card
        name = settings.id or _id_of(self._path)
        if name in environments():
            raise RecordingError(
                f"{self._path}: a registered environment is called {name}; choose another id in [task]"
            )
        walks = {split: tuple(w for w, t in self._tables.items() if t.split == split) for split in SPLITS[:-1]}
        units = {walk: table.unit for walk, table in self._tables.items() if table.unit}
        try:
            return Task(
                id=name,
                summary=settings.summary or f"Recordings of {self._path.parent.name}",
                description=settings.description,
                sensors=tuple(specs.values()),
                capacity={name: _capacity(one[name].most for one in streams.values() if name in one) for name in specs},
                period_s=settings.period_s,
                start=knowledge,
                walks={split: ids for split, ids in walks.items() if ids},
                load=source.load,
                tell_start=source.start,
                licence=settings.licence or (card.licence if card else "not stated"),
                source=settings.source or "local files",
                radio_map=source.radio_map,
                note=_joined(self._notes),
                files_sha256=functools.partial(files.sha256_of_walk, self._path, self._content, self._tables),
                units=units,
                unit_kind=settings.unit_kind if units else "building",
                groups={walk: (table.group,) for walk, table in self._tables.items() if table.group},
            )
        except RecordingError as error:
            raise RecordingError(f"{self._path}: {error}") from error

    def _survey(self) -> tuple[Survey, list[str]]:
        """The survey, and what is left out of it."""
        walks = () if self._content.survey is None else self._content.survey.walks
        for walk in walks:
            if walk not in self._tables:
                raise unknown_name(f"walk of {self._path}", walk, self._tables)
        return survey_of(self._reader, [self._tables[walk] for walk in walks if walk not in self._refused], self._index)


@dataclass(eq=False)
class _Source:
    """Loads the walks of a task, and what it gives beside them; `is_given` says whether a start is."""

    reader: WalkReader
    tables: Mapping[str, WalkTable]
    refused: Mapping[str, str]
    specs: Mapping[str, SensorSpec]
    survey: Survey
    facts: Mapping[str, FileFacts]
    is_given: bool

    def __post_init__(self) -> None:
        self._load = functools.lru_cache(maxsize=2)(self._load_once)  # one command looks at a walk several times

    def load(self, walk: str) -> Recording:
        """A walk with the sensors that are offered."""
        if walk not in self.tables:
            raise unknown_name(f"walk of {self.reader.path}", walk, self.tables)
        if walk in self.refused:
            raise RecordingError(self.refused[walk])
        return self._load(walk, files.stamp(files.beside(self.reader.path, self.tables[walk].file)))

    def start(self, recording: Recording) -> Start:
        """The start that a localizer is given."""
        start = self.reader.start(self.tables[recording.id], recording.reference)
        assert start is not None  # `_knowledge` has seen to it
        return start

    def radio_map(self, recording: Recording) -> RadioMap | None:
        """The scans of the survey, but for those of the recording itself and of its outing."""
        own = files.place_of(self.reader.path, self.tables[recording.id])
        return self.survey.radio_map(own, self.facts[recording.id])

    def _load_once(self, walk: str, _stamped: files.Stamp) -> Recording:
        recording = self.reader.recording(self.tables[walk])
        recording = self.reader.with_derived(recording, self.start(recording) if self.is_given else None)
        streams = recording.streams
        offered = {name: SensorStream(self.specs[name], streams[name].rows) for name in streams if name in self.specs}
        return dataclasses.replace(recording, streams=offered)


def _joined(notes: Iterable[str]) -> str:
    """Notes in one line, of many the first."""
    different = list(dict.fromkeys(notes))
    more = f"; and {len(different) - MAX_NOTES} more" if len(different) > MAX_NOTES else ""
    return "; ".join(different[:MAX_NOTES]) + more


def _id_of(path: Path) -> str:
    """An id from the name of a folder.

    >>> _id_of(Path("my_walks-2/task.toml"))
    'MyWalks2-v0'
    """
    words = _WORD.findall(path.parent.resolve().name)
    name = "".join(word[0].upper() + word[1:] for word in words)
    return f"{name if name[:1].isalpha() else f'Walks{name}'}-v0"


def _capacity(most: Iterable[int]) -> int:
    """Rows that one observation must hold so that none is late, as a power of two."""
    return 1 << math.ceil(math.log2(max(MIN_CAPACITY, *most)))
