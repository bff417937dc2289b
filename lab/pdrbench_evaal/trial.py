"""One trial of the EvAAL API: its states, its timing rules, its answers; no network in here.

The protocol is the "IPIN competition interface" of https://evaal.aaloa.org/evaalapi/evaalapi.md (F. Potortì). Written
from that description.
"""

from __future__ import annotations

import bisect
import functools
import itertools
import lzma
import math
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Final, NamedTuple

from pdrbench.errors import EstimateError, PdrbenchError
from pdrbench.geometry import FloatArray
from pdrbench_evaal.places import PlaceFormat

NONSTARTED, RUNNING, FINISHED, TIMEOUT = "nonstarted", "running", "finished", "timeout"
DEFAULT_HORIZON_S: Final = 0.5
OFFLINE_HORIZON: Final = -1.0  # what `estimates` shows as the horizon of an estimate of an offline trial
MAX_FAST_SLOWDOWN: Final = 2.0  # beyond it a scoring trial is not served faster than real time
MAX_ESTIMATES: Final = 200_000  # a day at 2 Hz
MAX_LOG_ENTRIES: Final = 2 * MAX_ESTIMATES
ESTIMATES_HEADER: Final = "pts,c,h,s,pos"
CSV, TEXT, XZ = "text/csv", "text/plain; charset=utf-8", "application/x-xz"
POSTED_TYPE: Final = ("text/csv", "us-ascii")
PARAMETERS: Final[Mapping[str, frozenset[str]]] = {
    "state": frozenset(),
    "nextdata": frozenset({"position", "horizon", "offline"}),
    "reload": frozenset({"keeplog"}),
    "estimates": frozenset(),
    "log": frozenset({"xzcompr"}),
}


class Reply(NamedTuple):
    """What a request is answered with."""

    status: int
    body: str | bytes
    content_type: str = CSV


class Estimated(NamedTuple):
    """One estimate, as `estimates` lists it."""

    t_s: float  # on the clock of the data
    clock_s: float  # wall clock at which it came
    horizon_s: float
    slack_s: float
    place: str

    def __str__(self) -> str:
        return f"{self.t_s:.3f},{self.clock_s:.3f},{self.horizon_s:.3f},{self.slack_s:.3f},{self.place}"


@dataclass(frozen=True, slots=True)
class Rules:
    """Timing of a trial.

    Attributes:
        slowdown: V: wall time that a second of the walk may take.
        slack_s: S: wall time that may be taken beyond it; of an offline trial, between the data and the estimates.
        is_reloadable: True for a testing trial, False for a scoring one.
        is_offline: True where data and estimates are exchanged at once.
    """

    slowdown: float = 2.0
    slack_s: float = 60.0
    is_reloadable: bool = True
    is_offline: bool = False

    def __post_init__(self) -> None:
        if not (math.isfinite(self.slowdown) and self.slowdown >= 1 and 0 <= self.slack_s < math.inf):
            raise PdrbenchError(f"a trial has V of 1 or more and S of 0 s or more; got {self.slowdown}, {self.slack_s}")


STANDARD_RULES: Final = Rules()  # as `pdrbench.process.budget.Budget` has them


class Trial:
    """Answers the requests on one trial, one after the other.

    Attributes:
        state: "nonstarted", "running", "finished" or "timeout".
        estimates: What was estimated, the initial position first; empty before the start.
    """

    def __init__(
        self,
        name: str,
        load: Callable[[], tuple[list[str], FloatArray]],
        places: PlaceFormat,
        initial: Callable[[], str],
        rules: Rules,
        *,
        clock: Callable[[], float] = time.time,
        on_end: Callable[[Trial], None] | None = None,
    ) -> None:
        """A trial that has not started.

        Args:
            name: As in its address.
            load: Lines of data (L,) and the times (L,) of each, non-decreasing; called at the start.
            places: How positions are written.
            initial: Makes the text of the position at the start.
            rules: Timing.
            clock: Wall clock in seconds.
            on_end: Called once when the trial is finished or timed out.
        """
        self.name, self.places, self.rules = name, places, rules
        self._load, self._initial, self._clock, self._on_end = load, functools.cache(initial), clock, on_end
        self._lock = threading.Lock()
        self._log: list[str] = []
        self._reset()

    def _reset(self) -> None:
        self.state = NONSTARTED
        self.estimates: list[Estimated] = []
        self._lines: list[str] = []
        self._t_s: list[float] = []
        self._next = 0  # line that has not been served yet
        self._trial_s = 0.0  # trial timestamp
        self._previous_s: float | None = None  # wall clock of the previous `nextdata`; p of the protocol
        self._horizon_s = 0.0  # its horizon; h
        self._slack_s = self.rules.slack_s  # s

    def get(self, command: str, query: Mapping[str, str]) -> Reply:
        """Answers `GET /TRIAL/COMMAND?QUERY`."""
        with self._lock:
            if command not in PARAMETERS:
                return _refuse(f"no command {command!r}; commands are {', '.join(PARAMETERS)}")
            for name in query:
                if name not in PARAMETERS[command]:
                    return _refuse(f"{command} has no parameter {name!r}: request ignored")
            reply = self._commands[command](self, query)
            if command in ("state", "nextdata") and self._log:
                asked = "&".join(f"{name}={value}" for name, value in query.items())
                self._note(f"GET {command}?{asked} --> {reply.status}\n{reply.body!s}")
            return reply

    def _state(self, query: Mapping[str, str]) -> Reply:
        return Reply(200, self._state_line())

    def _state_line(self) -> str:
        rules = self.rules
        slowdown = 0.0 if rules.is_offline else rules.slowdown
        if self.state == NONSTARTED:
            rem = -2.0 if rules.is_offline else -1.0
            return _state_text(0.0, rem, slowdown, rules.slack_s, 0.0, 0.0, 0.0, self._initial())
        last = self.estimates[-1]
        trial_s, rem = -1.0, self._slack_s
        if self.state == RUNNING:
            trial_s, rem = self._trial_s, self._remaining_s()
        horizon_s = -2.0 if rules.is_offline else self._horizon_s
        pts = 0.0 if rules.is_offline and self.state == RUNNING else last.t_s
        previous_s = self._previous_s or 0.0
        return _state_text(trial_s, rem, slowdown, rules.slack_s, previous_s, horizon_s, pts, last.place)

    def _remaining_s(self) -> float:
        """Wall time until the next request would come too late; negative where it would now."""
        if self._previous_s is None:
            return self._slack_s
        slowdown = 0.0 if self.rules.is_offline else self.rules.slowdown
        return self._previous_s + slowdown * self._horizon_s + self._slack_s - self._clock()

    def _nextdata(self, query: Mapping[str, str]) -> Reply:
        if self.state in (FINISHED, TIMEOUT):
            return Reply(405, self._state_line())
        if self.rules.is_offline != ("offline" in query) or (self.rules.is_offline and len(query) > 1):
            kind, form = ("an offline", "offline alone") if self.rules.is_offline else ("an online", "no offline")
            return _refuse(f"this is {kind} trial: nextdata takes {form}")
        if self.rules.is_offline:
            return self._serve_offline()
        try:
            horizon_s = float(query.get("horizon", DEFAULT_HORIZON_S))
            if "position" in query:
                self.places.read(query["position"])
        except (ValueError, EstimateError) as error:
            return _refuse(f"{error}: request ignored")
        if not 0 <= horizon_s < math.inf:
            return _refuse(f"horizon is {horizon_s}, not a finite number of 0 or more: request ignored")
        if len(self.estimates) >= MAX_ESTIMATES:
            return _refuse(f"{MAX_ESTIMATES} positions are the most that a trial takes")
        self._start()
        return self._serve(horizon_s, query.get("position"))

    def _start(self) -> None:
        if self.state != NONSTARTED:
            return
        self._note(f"trial {self.name} starts; state: {self._state_line()}")
        lines, t_s = self._load()
        self._lines, self._t_s = lines, t_s.tolist()
        self._trial_s = self._t_s[0] if self._t_s else 0.0
        self.estimates = [Estimated(self._trial_s, 0.0, 0.0, self.rules.slack_s, self._initial())]
        self.state = RUNNING

    def _serve(self, horizon_s: float, position: str | None) -> Reply:
        """Sets the position, and serves the lines from the trial timestamp to the horizon."""
        now_s, rules = self._clock(), self.rules
        if self._previous_s is not None:
            taken_s = now_s - self._previous_s
            if not rules.is_reloadable and rules.slowdown > MAX_FAST_SLOWDOWN and taken_s < self._horizon_s:
                return Reply(423, "faster than real time: request ignored, slow down", TEXT)
            self._slack_s = min(self._slack_s + rules.slowdown * self._horizon_s - taken_s, rules.slack_s)
            if self._slack_s < 0:
                return self._end(TIMEOUT)
        if position is not None and self._trial_s > self.estimates[0].t_s:
            self.estimates.append(Estimated(self._trial_s, now_s, horizon_s, self._slack_s, position))
        if self._next == len(self._lines):  # the last estimate has answered the last data
            return self._end(FINISHED)
        self._trial_s += horizon_s
        until = bisect.bisect_left(self._t_s, self._trial_s)
        served = self._lines[self._next : until]
        self._next = max(until, self._next)
        self._previous_s, self._horizon_s = now_s, horizon_s
        return Reply(200, _text(served))

    def _serve_offline(self) -> Reply:
        if self.state != NONSTARTED:
            return Reply(405, self._state_line())
        self._start()
        self._previous_s = self._clock()
        return Reply(200, _text(self._lines))

    def _end(self, state: str) -> Reply:
        self.state = state
        self._lines = []
        self._note(f"trial {self.name}: {state}")
        if self._on_end is not None:
            self._on_end(self)
        return Reply(405, self._state_line())

    def _reload(self, query: Mapping[str, str]) -> Reply:
        if not self.rules.is_reloadable and self._log:
            return _refuse(f"{self.name} is a scoring trial, which is played once")
        self._reset()
        if "keeplog" not in query:
            self._log.clear()
        return Reply(200, self._state_line())

    def _list_estimates(self, query: Mapping[str, str]) -> Reply:
        if self.state == NONSTARTED:
            return Reply(405, "the trial has not started: there are no estimates", TEXT)
        return Reply(200, _text([ESTIMATES_HEADER, *map(str, self.estimates)]))

    def _send_log(self, query: Mapping[str, str]) -> Reply:
        if not self._log:
            return Reply(405, "the trial has not started: there is no log", TEXT)
        text = _text(self._log)
        return Reply(200, lzma.compress(text.encode()), XZ) if "xzcompr" in query else Reply(200, text, TEXT)

    _commands: Final = {
        "state": _state,
        "nextdata": _nextdata,
        "reload": _reload,
        "estimates": _list_estimates,
        "log": _send_log,
    }

    def post(self, command: str, body: bytes, content_type: str) -> Reply:
        """Answers `POST /TRIAL/estimates`, the second and last step of an offline trial."""
        with self._lock:
            if command != "estimates" or not self.rules.is_offline:
                return _refuse("only the estimates of an offline trial are posted")
            if self.state == NONSTARTED:
                return _refuse("nextdata?offline comes first")
            if self.state != RUNNING:
                return Reply(405, self._state_line())
            kind, _, charset = content_type.lower().partition(";")
            if (kind.strip(), charset.strip().removeprefix("charset=").strip('"')) != POSTED_TYPE or not body.isascii():
                return Reply(400, "Content-type must be text/csv; charset=us-ascii", TEXT)
            self._slack_s = self._remaining_s()
            if self._slack_s < 0:
                return self._end(TIMEOUT)
            return self._take(body.decode("ascii").splitlines())

    def _take(self, lines: list[str]) -> Reply:
        now_s = self._clock()
        why = ""
        num_accepted = 0
        given = [line for line in lines if line.strip()]
        for number, line in enumerate(given, 1):
            pts, _, place = line.strip().partition(",")
            try:
                t_s = float(pts)
                if not 0 <= t_s < math.inf or t_s < self.estimates[-1].t_s * (num_accepted > 0):
                    raise EstimateError(f"time {pts} is negative, or earlier than the one before")
                if num_accepted >= MAX_ESTIMATES:
                    raise EstimateError(f"{MAX_ESTIMATES} positions are the most that a trial takes")
                self.places.read(place)
            except (ValueError, EstimateError) as error:
                why = why or f"line {number}: {error}"
                continue
            self.estimates.append(Estimated(t_s, now_s, OFFLINE_HORIZON, self._slack_s, place))
            num_accepted += 1
        self._end(FINISHED)
        if why:
            rejected = len(given) - num_accepted
            return Reply(409, f"{num_accepted} estimates accepted, {rejected} rejected; {why}", TEXT)
        return Reply(200, self._state_line())

    def _note(self, text: str) -> None:
        if len(self._log) < MAX_LOG_ENTRIES:
            stamp = datetime.fromtimestamp(self._clock(), UTC).isoformat(timespec="milliseconds")
            self._log.append(f"{stamp.removesuffix('+00:00')} {text}")


def _refuse(why: str) -> Reply:
    return Reply(422, why, TEXT)


def _text(lines: list[str]) -> str:
    return "".join(itertools.chain.from_iterable((line, "\n") for line in lines))


def _state_text(*values: float | str) -> str:
    *numbers, place = values
    return ",".join([*(f"{number:.3f}" for number in numbers), str(place)])
