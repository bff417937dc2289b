"""One phone that streams: what it sent, the walk that it is on, the folder that keeps it."""

from __future__ import annotations

import itertools
import math
import re
import shutil
import tempfile
import threading
import traceback
from collections import deque
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

import numpy as np

from pdrbench.errors import PdrbenchError, RecordingError, plain_line
from pdrbench.evaluation.randomness import generator
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Estimate, Localizer, Observation
from pdrbench.recording import Recording, SensorStream
from pdrbench.registry import TASK_FILE, make_localizer
from pdrbench.sensors import sensor_spec
from pdrbench.sensors.checks import rate_of
from pdrbench.session import WAIT_S, Session
from pdrbench.trajectory import Trajectory
from pdrbench_formats.live.feeds import GATHER_S, MAX_NAME, Push, SensorLoggerFeed, Tables
from pdrbench_formats.recordings import native
from pdrbench_formats.replays.page import Box, base64_of, marks_of, number_of, places_of, quantised
from pdrbench_formats.replays.view import Dots, dots_of
from pdrbench_formats.taskfile import schema
from pdrbench_formats.taskfile.load import walks_of_file
from pdrbench_formats.toml import as_toml

TASK_ID: Final = "Live-v0"
WALK: Final = "walk"
KEPT_S: Final = 3.0  # of rows before a start is known
MAX_WAITING: Final = 1000  # packets that come while the localizer compiles
MAX_DOTS: Final = 1000
DISC: Final = math.sqrt(-2.0 * math.log(0.05))  # sigma of the radius that 95 % of a round normal lie within
WAITING, TAP, WALKING, ENDED, FAILED = "waiting for data", "tap where you are", "walking", "ended", "failed"


@dataclass(frozen=True, slots=True)
class Setup:
    """What all phones share.

    Attributes:
        localizer: Id, or as `make_localizer` takes it.
        plan: File of the plan; None where the path is relative.
        survey: Files of the radio survey.
        start: Where each walk begins; None to be tapped.
        mounting: Where phones are carried.
        out: Folder that walks are recorded into; None for none.
        wait_s: As of `Session`.
    """

    localizer: str
    plan: Path | None = None
    survey: tuple[Path, ...] = ()
    start: schema.StartTable | None = None
    mounting: str = "hand"
    out: Path | None = None
    wait_s: float = WAIT_S

    def task_file(self, start: schema.StartTable, sensors: Tables) -> schema.TaskFile:
        """What is recorded beside a walk, so that its replay is given the same."""
        rates = {name: rate_of(rows[:, 0]) for name, rows in sensors.items() if sensor_spec(name).rate_hz}
        return schema.TaskFile(
            task=schema.TaskTable(
                id=TASK_ID,
                sensors=tuple(sensors),
                rates_hz={name: float(f"{rate:.3g}") for name, rate in rates.items() if rate},
                derive=False,
            ),
            plan=None if self.plan is None else schema.PlanTable(file=str(self.plan.resolve()), doors="rooms"),
            walk=(schema.WalkTable(file="recording", id=WALK, start=start, mounting=self.mounting),),
            survey=schema.SurveyTable(file=tuple(str(path.resolve()) for path in self.survey)) if self.survey else None,
        )


class _Kept:
    """A localizer, and everything that it was given and answered."""

    def __init__(self, localizer: Localizer) -> None:
        self.localizer = localizer
        self.rows: dict[str, list[FloatArray]] = {}

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self.rows = {name: [] for name in briefing.sensors}
        self.localizer.reset(briefing, rng)

    def step(self, observation: Observation) -> Estimate:
        for name, rows in observation.rows.items():
            self.rows[name].append(rows.copy())
        return self.localizer.step(observation)

    def debug(self) -> dict[str, Any]:
        return getattr(self.localizer, "debug", dict)()


@dataclass(eq=False)
class Phone:
    """One phone, from its first packet on.

    Attributes:
        name: As it says itself.
        setup: What all phones share.
        state: One of `WAITING` to `FAILED`.
        why: Of a failure, or of a packet that was left out.
        trail: `x_m, y_m, level, height_m, t_s` of the last answer to each packet.
        walk: Number of the walk, from 1.
        folders: Those that hold its walks.
    """

    name: str
    setup: Setup
    state: str = WAITING
    why: str = ""
    trail: list[list[float | None]] = field(default_factory=list)
    walk: int = 0
    folders: list[Path] = field(default_factory=list)
    feed: SensorLoggerFeed = field(default_factory=SensorLoggerFeed)

    def __post_init__(self) -> None:
        self._lock = threading.Lock()
        self._queue: deque[Push | Tables] = deque(maxlen=MAX_WAITING)
        self._scratch = tempfile.TemporaryDirectory()
        self._window: dict[str, FloatArray] = {}
        self._session: Session | None = None
        self._estimate: Estimate | None = None
        self._dots: Dots | None = None
        self._newest_s = self._origin_s = 0.0

    def take(self, packet: Push | Tables) -> str:
        """Plays what came, rows on the clock of the phone; while another thread plays, it is left to that.

        Returns:
            Why something was left out; empty where nothing was.
        """
        self._queue.append(packet)
        return self._play_what_waits()

    def start(self, start: schema.StartTable) -> None:
        """Begins a walk where the phone is now; one before it ends."""
        with self._lock:
            self._end()
            self._play_queue()
            self._begin(start, self._newest_s)
        self._play_what_waits()

    def end(self) -> None:
        """Ends the walk, and records it."""
        with self._lock:
            self._play_queue()
            self._end()

    def _play_what_waits(self) -> str:
        """Also what came while the lock was about to be given back."""
        why = ""
        while self._queue and self._lock.acquire(blocking=False):
            try:
                why = self._play_queue() or why
            finally:
                self._lock.release()
        return why

    def _play_queue(self) -> str:
        why = ""
        while self._queue:
            packet = self._queue.popleft()
            try:
                tables = self.feed.tables(packet) if isinstance(packet, Push) else packet
            except RecordingError as error:
                why = str(error)
                continue
            if self.state == WALKING:
                self._play(tables)
            self._remember(tables)
            accel_s = self._window["accel"][:, 0] if "accel" in self._window else np.zeros(0)
            if self.state in (WAITING, TAP) and len(accel_s) and np.ptp(accel_s) >= GATHER_S:
                self.state = TAP
                if self.setup.start is not None and not self.walk:
                    self._begin(self.setup.start, float(accel_s.min()))
        return why

    def _remember(self, tables: Tables) -> None:
        """Keeps the last seconds; rows of another clock are left out."""
        if "accel" in tables and len(tables["accel"]):
            self._newest_s = float(np.median(tables["accel"][:, 0]))
        for name, rows in tables.items():
            spec = sensor_spec(name)
            is_good: Any = (rows[:, 1:] >= spec.low[1:]) & (rows[:, 1:] <= spec.high[1:])
            joined = np.concatenate([self._window.get(name, rows[:0]), rows[is_good.all(axis=1)]])
            joined = joined[np.abs(joined[:, 0] - self._newest_s) <= KEPT_S]
            self._window[name] = joined[np.argsort(joined[:, 0], kind="stable")]

    def _begin(self, start: schema.StartTable, origin_s: float) -> None:
        self.walk, self.trail, self._origin_s = self.walk + 1, [], origin_s
        self._estimate, self._dots = None, None
        sensors = {name: rows for name, rows in self._window.items() if len(rows)}
        if self.setup.survey:
            sensors.setdefault("wifi", np.zeros((0, len(sensor_spec("wifi").columns))))
        self._content = self.setup.task_file(start, sensors)
        begin_s = min((float(rows[0, 0]) for rows in sensors.values() if len(rows)), default=0.0)
        self.state, self.why = FAILED, ""
        try:
            first = {name: rows - np.eye(1, rows.shape[1]) * begin_s for name, rows in sensors.items()}
            task = walks_of_file(self._write(Path(self._scratch.name), first)).task
            briefing = task.brief(task.load(WALK))
            self._kept = _Kept(make_localizer(self.setup.localizer))
            self._session = Session(self._kept, briefing, generator(0, task, WALK), wait_s=self.setup.wait_s)
        except PdrbenchError as error:
            self.why = str(error)
        except Exception:  # noqa: BLE001  a localizer may raise anything, and that is the walk's failure
            self.why = traceback.format_exc()
        else:
            self.state = WALKING
            self._play({name: rows[rows[:, 0] >= origin_s] for name, rows in self._window.items()})

    def _play(self, tables: Tables) -> None:
        assert self._session is not None
        session, before_s = self._session, self._session.now_s
        for name, rows in tables.items():
            if name in session.briefing.sensors:
                session.push(name, rows - np.eye(1, rows.shape[1]) * self._origin_s)
        self._answer(session.estimate, before_s)

    def _answer(self, play: Any, before_s: float) -> None:
        assert self._session is not None
        try:
            estimate = play()
        except Exception:  # noqa: BLE001  as above
            self.state, self.why = FAILED, traceback.format_exc()
            return
        if estimate is not None and self._session.now_s > before_s:
            self._estimate = estimate
            building = self._session.briefing.building
            (place,) = places_of(building, estimate.xy_m[None], np.array([estimate.level]))
            self.trail.append([*place, self._session.now_s])
            self._dots = dots_of(self._kept.debug(), building)

    def _end(self) -> None:
        session, self._session = self._session, None
        if session is None:
            return
        if self.state == WALKING:
            self._session = session
            self._answer(session.finish, session.now_s)
            self._session = None
            self.state = ENDED if self.state == WALKING else self.state
        rows = {name: np.concatenate(parts) for name, parts in self._kept.rows.items() if parts}
        if self.setup.out is not None and any(len(one) for one in rows.values()):
            folder = _free(self.setup.out, re.sub(r"[^A-Za-z0-9]+", "-", self.name).strip("-") or "phone")
            self._write(folder, rows)
            self.folders.append(folder)

    def _write(self, folder: Path, rows: Tables) -> Path:
        """Writes a recording and its task file, and gives the path of that."""
        shutil.rmtree(folder / "recording", ignore_errors=True)
        streams = {name: SensorStream(sensor_spec(name), one) for name, one in rows.items()}
        nowhere = Trajectory(np.zeros(0), np.zeros((0, 2)), np.zeros(0, np.int64), np.zeros(0, np.bool_))
        native.write(Recording(WALK, None, streams, nowhere, mounting=self.setup.mounting), folder / "recording")
        path = folder / TASK_FILE
        path.write_text(as_toml(self._content), encoding="utf-8", newline="\n")
        return path

    def frame(self, box: Box, sent: int) -> dict[str, Any]:
        """What the page shows now; of the trail what follows its first `sent` places."""
        session, estimate = self._session, self._estimate
        trail, dots = self.trail, self._dots
        frame = {
            "name": plain_line(self.name)[:MAX_NAME],
            "walk": self.walk,
            "state": self.state,
            "why": plain_line(self.why.strip().rpartition("\n")[2])[:300],
            "trail": trail[sent:],
            "from": sent,
            "t_s": None if session is None else number_of(session.now_s),
            "disc_m": None,
            "dots": None,
            "num_dots": None,
            "dropped": {} if session is None else dict(+session.dropped),
        }
        if estimate is not None and estimate.sigma_m is not None and estimate.converged is not False:
            frame["disc_m"] = number_of(DISC * estimate.sigma_m)
        if dots is not None:
            shown = dots.only(np.isin(dots.level, box.levels)).thinned(MAX_DOTS)
            places = quantised(np.column_stack([shown.xy_m, shown.height_m]), box.low, box.high)
            frame["dots"] = {
                "first": [0, len(shown)],
                "places": base64_of([places], "<u2"),
                "marks": base64_of([marks_of(shown, box.levels)], "u1"),
            }
            frame["num_dots"] = len(dots)
        return frame


def _free(out: Path, name: str) -> Path:
    """A folder of that name that does not exist yet."""
    folders = (out / f"{name[:MAX_NAME]}-{k}" for k in itertools.count(1))
    return next(folder for folder in folders if not folder.exists())
