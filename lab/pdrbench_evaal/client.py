"""A client of the EvAAL API: plays a trial of a server with a localizer."""

from __future__ import annotations

import math
import time
import urllib.error
import urllib.parse
import urllib.request
import urllib.response
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.episode import CLOCK_SLACK_S, Player, read_estimate, read_track
from pdrbench.errors import EstimateError, PdrbenchError
from pdrbench.localizer import Briefing, Observation
from pdrbench_evaal.places import LOCAL_PLACES, PlaceFormat
from pdrbench_evaal.records import NumberOf, RecordReader, plain_number
from pdrbench_evaal.server import SERVER_NAME
from pdrbench_formats.recordings.opaque import opaque_id

TIMEOUT_S: Final = 60.0  # for one answer of the server
MAX_ANSWER_BYTES: Final = 1 << 30  # of an offline trial; a day of a phone is more
FIRST_HORIZON_S: Final = 1e-3  # brings the first line, and with it the clock of the data
MAX_FIRST_S: Final = 60.0  # a log whose first line is later does not count from the start of the walk
MAX_SLOW_DOWNS: Final = 1000
NUM_STATE_FIELDS: Final = 7  # before the position
OFFLINE_REM: Final = -2.0  # of a trial that has not started
SCHEMES: Final = ("http", "https")


class EvaalError(PdrbenchError):
    """A server of the EvAAL API did not answer as its protocol says."""


@dataclass(frozen=True, slots=True)
class TrialState:
    """The state of a trial; times in seconds.

    Attributes:
        trial_s: Trial timestamp; -1 where the trial has ended.
        rem_s: Wall time left; -1 where an online trial has not started, -2 where an offline one has not.
        slowdown: V.
        slack_s: S.
        previous_s: Wall clock of the last `nextdata`.
        horizon_s: Its horizon.
        estimated_s: Trial timestamp of the last estimate.
        place: That estimate.

    >>> TrialState.parse("0.000,-1.000,3.000,15.000,0.000,0.000,0.000,10.4;43.7;1").place
    '10.4;43.7;1'
    """

    trial_s: float
    rem_s: float
    slowdown: float
    slack_s: float
    previous_s: float
    horizon_s: float
    estimated_s: float
    place: str

    @classmethod
    def parse(cls, line: str) -> TrialState:
        """Reads what `state` answered; raises `EvaalError`."""
        fields = line.strip().split(",", NUM_STATE_FIELDS)
        try:
            trial_s, rem_s, slowdown, slack_s, previous_s, horizon_s, estimated_s = map(float, fields[:-1])
            return cls(trial_s, rem_s, slowdown, slack_s, previous_s, horizon_s, estimated_s, fields[-1])
        except ValueError:
            raise EvaalError(f"the state of a trial is seven numbers and a position; got {line[:200]!r}") from None


@dataclass(frozen=True, slots=True)
class PlayedTrial:
    """What came of a trial.

    Attributes:
        state: At the end.
        num_estimates: Positions that were sent.
        skipped: Count of lines by reason or type that the localizer was not given.
        estimates: What the server lists.
    """

    state: TrialState
    num_estimates: int
    skipped: Mapping[str, int]
    estimates: str


class TrialClient:
    """Requests on one trial.

    Attributes:
        is_pdrbench: True once an answer of a pdrbench server has come.
    """

    def __init__(self, url: str, trial: str, *, sleep: Callable[[float], None] = time.sleep) -> None:
        """Names a trial.

        Args:
            url: Of the server, up to the name of the trial.
            trial: Its name.
            sleep: Waits for so many seconds.
        """
        if urllib.parse.urlsplit(url).scheme not in SCHEMES:
            raise EvaalError(f"a server has an address such as http://127.0.0.1:5000/evaalapi/; got {url!r}")
        self._base = f"{url.rstrip('/')}/{urllib.parse.quote(trial, safe='')}/"
        self._sleep = sleep
        self.is_pdrbench = False

    @property
    def number_of(self) -> NumberOf:
        """How the server names senders: by opaque identifiers as addresses, or by addresses, which are then hashed."""
        return plain_number if self.is_pdrbench else opaque_id

    def state(self) -> TrialState:
        """What the server says of the trial."""
        return TrialState.parse(self._expect(200, "state"))

    def reload(self) -> TrialState:
        """Puts a testing trial to its start."""
        return TrialState.parse(self._expect(200, "reload"))

    def estimates(self) -> str:
        """The estimates as the server lists them."""
        return self._expect(200, "estimates")

    def next_data(self, horizon_s: float, place: str | None = None) -> list[str] | None:
        """Sends the present position, where there is one, and gets the lines to the horizon; None at the end."""
        query = {"horizon": repr(horizon_s)} | ({} if place is None else {"position": place})
        for _ in range(MAX_SLOW_DOWNS):
            status, body = self._ask("nextdata", query)
            if status == 200:
                return body.splitlines()
            if status == 405:
                return None
            if status != 423:
                break
            state = self.state()  # the server's clock decides; what is left until its horizon is over
            self._sleep(min(max(state.horizon_s, 0.05), 5.0))
        raise EvaalError(f"{self._base}nextdata answered {status}: {body[:300]}")

    def all_data(self) -> list[str]:
        """Every line of an offline trial."""
        return self._expect(200, "nextdata", {"offline": ""}).splitlines()

    def post(self, lines: list[str]) -> None:
        """Sends the estimates of an offline trial, `pts,pos` each."""
        body = "".join(f"{line}\n" for line in lines).encode("ascii")
        status, answer = self._ask("estimates", body=body)
        if status != 200:
            raise EvaalError(f"{self._base}estimates answered {status}: {answer[:300]}")

    def _expect(self, expected: int, command: str, query: Mapping[str, str] = {}) -> str:
        status, body = self._ask(command, query)
        if status != expected:
            raise EvaalError(f"{self._base}{command} answered {status}: {body[:300]}")
        return body

    def _ask(self, command: str, query: Mapping[str, str] = {}, body: bytes | None = None) -> tuple[int, str]:
        asked = f"?{urllib.parse.urlencode(query)}" if query else ""
        request = urllib.request.Request(f"{self._base}{command}{asked}", data=body)
        request.add_header("Accept-Encoding", "identity")
        if body is not None:
            request.add_header("Content-Type", "text/csv; charset=us-ascii")
        try:
            with urllib.request.urlopen(request, timeout=TIMEOUT_S) as answer:
                return self._read(answer, answer.status)
        except urllib.error.HTTPError as answer:
            with answer:
                return self._read(answer, answer.code)
        except (OSError, ValueError) as error:
            reason = getattr(error, "reason", error)
            raise EvaalError(f"{self._base}{command}: {reason}; check the address, and that the server runs") from error

    def _read(self, answer: urllib.response.addinfourl, status: int) -> tuple[int, str]:
        content = answer.read(MAX_ANSWER_BYTES + 1)
        if len(content) > MAX_ANSWER_BYTES:
            raise EvaalError(f"{self._base} sent more than {MAX_ANSWER_BYTES >> 20} MiB at once")
        if str(answer.headers.get("Server", "")).startswith(f"{SERVER_NAME}/"):
            self.is_pdrbench = True
        return status, content.decode("utf-8", "replace")


@dataclass(slots=True)
class _Walk:
    """A localizer on its way through a trial."""

    localizer: Player
    briefing: Briefing
    places: PlaceFormat
    reader: RecordReader
    origin_s: float = 0.0
    num_steps: int = 0

    @property
    def now_s(self) -> float:
        """Time of the next observation."""
        return self.num_steps * self.briefing.period_s

    def begin(self, lines: list[str]) -> None:
        """Takes the first lines: those of a log that does not begin near 0 count from the first."""
        probe = RecordReader({}, {}, plain_number)
        probe.add(lines)
        self.origin_s = 0.0 if probe.first_s <= MAX_FIRST_S else probe.first_s
        self.reader.first_s = probe.first_s
        self.add(lines)

    def add(self, lines: list[str]) -> None:
        self.reader.add(lines, self.origin_s)

    def step(self) -> str | None:
        """The position now, as it is sent; None where the answer of the localizer counts as missing."""
        observation = Observation(self.now_s, self.reader.take(self.now_s + CLOCK_SLACK_S))
        self.num_steps += 1
        try:
            row = read_estimate(self.localizer.step(observation))
        except EstimateError:
            return None
        return self.places.write(np.array([row.x_m, row.y_m]), int(row.level))


def play_trial(
    client: TrialClient,
    localizer: Player,
    briefing: Briefing,
    rng: np.random.Generator,
    *,
    places: PlaceFormat = LOCAL_PLACES,
    capacity: Mapping[str, int] | None = None,
) -> PlayedTrial:
    """Plays a trial that has not started, online or offline as the server has it.

    An observation holds what arrived up to its time, as in an episode; its estimate goes to the server with the request
    for what comes next. An offline trial is played in the same way from the lines that came at once, and what the
    localizer revises in the end is what is sent.

    Args:
        client: Of the trial.
        localizer: Anything with `reset` and `step`, and possibly `revise`.
        briefing: What it is given.
        rng: The localizer's randomness.
        places: How the server writes positions.
        capacity: Rows of a sensor in one observation; None for no limit.

    Raises:
        EvaalError: The trial is under way or over, or the server does not keep to the protocol.
        UnsuitableError: The localizer declines.
    """
    state = client.state()
    if state.trial_s != 0 or state.rem_s not in (-1.0, OFFLINE_REM):
        raise EvaalError("the trial has started already; reload it where it is a testing trial")
    localizer.reset(briefing, rng)
    reader = RecordReader(briefing.sensors, capacity or {}, client.number_of)
    walk = _Walk(localizer, briefing, places, reader)
    num_sent = _play_offline(client, walk) if state.rem_s == OFFLINE_REM else _play_online(client, walk)
    return PlayedTrial(client.state(), num_sent, dict(reader.skipped), client.estimates())


def _play_online(client: TrialClient, walk: _Walk) -> int:
    lines = client.next_data(FIRST_HORIZON_S)
    if not lines:
        raise EvaalError("the trial has no data")
    walk.begin(lines)
    trial_s = walk.reader.first_s + FIRST_HORIZON_S  # the server adds in the same way
    num_sent = 0
    place: str | None = None
    while True:
        horizon_s = walk.origin_s + walk.now_s + CLOCK_SLACK_S - trial_s
        if horizon_s > 0:
            more = client.next_data(horizon_s, place)
            num_sent += place is not None
            if more is None:
                return num_sent
            trial_s += horizon_s
            walk.add(more)
        place = walk.step() or place


def _play_offline(client: TrialClient, walk: _Walk) -> int:
    walk.begin(client.all_data())
    sent: list[tuple[float, str]] = []
    last_s = walk.reader.last_s
    while True:
        now_s = walk.now_s
        place = walk.step()
        if place is not None:
            sent.append((now_s, place))
        if now_s + CLOCK_SLACK_S >= last_s:
            break
    revise: Callable[[], object] | None = getattr(walk.localizer, "revise", None)
    track = None if revise is None else revise()
    if track is not None:
        rows = read_track(track)
        first_s = float(rows[0, 0]) if len(rows) else math.inf
        revised = [(row[0], walk.places.write(np.array(row[1:3]), int(row[3]))) for row in rows.tolist()]
        sent = [*((t_s, place) for t_s, place in sent if t_s < first_s), *revised]
    client.post([f"{t_s + walk.origin_s!r},{place}" for t_s, place in sent])
    return len(sent)
