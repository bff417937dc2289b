"""Recordings of the files of walks: in the frame of the task, begun at their start, with computed sensors."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import msgspec
import numpy as np

from pdrbench.building import Building
from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.io.geo import GeoFrame
from pdrbench.recording import Recording, SensorSpec, SensorStream
from pdrbench.sensors import SENSORS
from pdrbench.sensors.checks import rate_of
from pdrbench.trajectory import Start, Trajectory
from pdrbench_formats.maps.plan import PlanAlignment
from pdrbench_formats.taskfile import survey
from pdrbench_formats.taskfile.files import FileFacts, beside, places_of, read_walk
from pdrbench_formats.taskfile.places import check_not_exchanged, moved
from pdrbench_formats.taskfile.schema import StartTable, TaskFile, WalkTable

_MOST_INSIDE: Final = 0.9  # of places on the floor of a level that is meant
MAX_LEAD_S: Final = 2.0  # a recording may begin so long before the place that is its start


class StreamFacts(msgspec.Struct, frozen=True):
    """What a task has to know of a stream.

    Attributes:
        spec: What it says of itself.
        rate_hz: Median over the walk; None where no time passes.
        most: Rows in the period that has most of them.
    """

    spec: SensorSpec
    rate_hz: float | None
    most: int

    def spec_over(self, walks: Sequence[StreamFacts]) -> SensorSpec:
        """This spec with the median rate over walks."""
        rates_hz = [walk.rate_hz for walk in walks if walk.rate_hz is not None]
        rate_hz = self.spec.rate_hz
        if rate_hz is not None and rates_hz:
            rate_hz = float(f"{np.median(rates_hz):.3g}")
        return dataclasses.replace(self.spec, rate_hz=rate_hz, derived=any(walk.spec.derived for walk in walks))


def stream_facts(stream: SensorStream, period_s: float) -> StreamFacts:
    """What a task has to know of a stream, observed once a period."""
    _, counts = np.unique(np.ceil(stream.t_s / period_s - 1e-6), return_counts=True)
    return StreamFacts(spec=stream.spec, rate_hz=rate_of(stream.t_s) or None, most=int(counts.max(initial=0)))


@dataclass(frozen=True, slots=True)
class WalkReader:
    """Makes recordings of the files that a task names.

    Attributes:
        path: Of the task file.
        content: Of the task file.
        building: The plan in metres, x east; None where there is none.
        turn: From the plane of the plan, and of places in metres, to metres with x east.
        geo: Place of (0, 0) on the Earth; None where that is not known.
    """

    path: Path
    content: TaskFile
    building: Building | None
    turn: PlanAlignment
    geo: GeoFrame | None

    def recording(self, table: WalkTable) -> Recording:
        """A walk with the sensors of its file, in the frame of the task.

        Raises:
            RecordingError: Names the file and what is wrong.
        """
        found = read_walk(self.path, self.content, table)
        reference, geo, _ = places_of(self.path, table, found)
        reference = self._placed(table, reference, geo)
        if self._starts_at_place(table):
            is_later = np.arange(len(reference)) > 0  # the first place is given: it does not count
            reference = dataclasses.replace(reference, surveyed=reference.surveyed & is_later)
        own, streams = None, dict[str, SensorStream]()
        if isinstance(found, Recording):
            own, streams = found.building, dict(found.streams)
        else:
            streams = {name: SensorStream(SENSORS[name], rows) for name, rows in found.rows.items()}
        whole = Recording(
            id=table.id,
            building=own if self.building is None else self.building,
            streams=streams,
            reference=reference,
            subject={**getattr(found, "subject", {}), **table.subject},
            device=found.device,
            mounting=table.mounting or found.mounting,
        )
        begin_s = self.begin_s(table, float(reference.t_s[0]) if len(reference) else None)
        return whole if begin_s == 0.0 else survey.begun_at(whole, begin_s)

    def with_derived(self, recording: Recording, start: Start | None) -> Recording:
        """A recording with the streams that it lacks and that can be computed, also from the start that is given."""
        from pdrbench_formats.derive import DERIVED, derive  # imports scipy.signal and numba

        settings = self.content.task
        wanted = DERIVED if settings.sensors is None else settings.sensors
        lacking = [name for name in wanted if name not in recording.streams]
        if not settings.derive or not lacking:
            return recording
        try:
            streams = derive(recording.streams, recording.mounting, lacking, start=start, building=recording.building)
        except RecordingError as error:
            raise RecordingError(f"{self.path}: walk {recording.id!r}: {error}") from error
        return dataclasses.replace(recording, streams=streams)

    def start(self, table: WalkTable, reference: Trajectory) -> Start | None:
        """The start of a walk as its table or its first place gives it; None where neither does."""
        given = table.start or StartTable()
        heading_rad = None if given.heading_rad is None else given.heading_rad + self.turn.turn_rad
        if given.xy_m is not None:
            return Start(self.turn(np.array(given.xy_m)), given.level, heading_rad, given.radius_m)
        if not len(reference):
            return None
        if heading_rad is None and reference.heading_rad is not None:
            heading_rad = float(reference.heading_rad[0])
        return Start(reference.xy_m[0], int(reference.level[0]), heading_rad, given.radius_m)

    def has_start(self, table: WalkTable, facts: FileFacts) -> bool:
        """True where `start` is not None, before the file is read."""
        return self.first_s(facts) is not None or (table.start is not None and table.start.xy_m is not None)

    def first_s(self, facts: FileFacts) -> float | None:
        """Time of the first place that can be brought into the frame of the task."""
        return facts.first_s if facts.geo is None or self.geo is not None else None

    def begin_s(self, table: WalkTable, first_s: float | None) -> float:
        """Time from which a file is used: that of the place which is its start, where that is seconds later."""
        is_late = first_s is not None and first_s > MAX_LEAD_S and self._starts_at_place(table)
        return first_s if is_late and first_s is not None else 0.0

    def scans(self, table: WalkTable) -> tuple[survey.Scans, bool]:
        """The WiFi scans of a table of a survey, or of a recording, and whether their places were surveyed.

        Raises:
            RecordingError: Names the file and what is wrong.
        """
        place = beside(self.path, table.file)
        if not survey.is_survey_table(place):
            try:
                return survey.scans_of_recording(self.recording(table)), False
            except RecordingError as error:
                if not place.is_file():
                    raise
                why = f"{error}; to be a survey, the file is a recording with scans, or a table {survey.SURVEY_EXAMPLE}"
                raise RecordingError(why) from error
        scans, geo = survey.read_survey_table(place)
        scans = dataclasses.replace(scans, xy_m=self._in_frame(scans.xy_m, geo, place.name))
        self._check_levels(scans.xy_m, scans.level, place.name)
        return scans, True

    def _placed(self, table: WalkTable, reference: Trajectory, geo: GeoFrame | None) -> Trajectory:
        """A reference in the frame of the task; none where that is not known and the places are no truth."""
        if geo is not None and self.geo is None and not reference.surveyed.any():
            return reference.rows(np.zeros(len(reference), dtype=np.bool_))
        xy_m = self._in_frame(reference.xy_m, geo, f"walk {table.id!r}")
        self._check_levels(xy_m, reference.level, f"walk {table.id!r}")
        return moved(reference, xy_m, self.turn.turn_rad if geo is None else 0.0)

    def _in_frame(self, xy: FloatArray, geo: GeoFrame | None, whose: str) -> FloatArray:
        """(N, 2) places of the plan, or of a frame on the Earth, in metres of the task."""
        if geo is None:
            return self.turn(xy)
        if self.geo is None:
            raise RecordingError(
                f"{self.path}: the places of {whose} are latitudes and longitudes, and the plan does not say where "
                f"it lies; add [plan.align] with lat_deg and lon_deg of its origin, or give metres"
            )
        check_not_exchanged(geo, self.geo, f"{self.path}: the places of {whose}")
        return self.geo.to_local(*geo.to_geo(xy))

    def _check_levels(self, xy_m: FloatArray, level: IntArray, whose: str) -> None:
        """Raises `RecordingError` where places count floors from 1, and the plan from 0."""
        own, known = set(level.tolist()), set(() if self.building is None else self.building.levels)
        if self.building is None or 0 in own or not own or not {number - 1 for number in own} <= known:
            return
        on_floor, below = (float(self.building.contains(xy_m, level - down).mean()) for down in (0, 1))
        if not own <= known or (below > _MOST_INSIDE and on_floor < 1.0 - _MOST_INSIDE):
            raise RecordingError(
                f"{self.path}: the places of {whose} are on levels {sorted(own)}, of which the "
                f"plan has {sorted(own & known) or 'none'}; {on_floor:.0%} of them lie on its floor, one level lower "
                f"{below:.0%} do. The plan has levels {sorted(known)}: number them as it does, 0 for the ground"
            )

    def _starts_at_place(self, table: WalkTable) -> bool:
        """True where the first place of a walk is given as its start."""
        return (table.start is None or table.start.xy_m is None) and self.content.task.start != "unknown"
