"""A server of the EvAAL API for the walks of an environment. It knows the reference and never sends it."""

from __future__ import annotations

import dataclasses
import functools
import hashlib
import sys
import threading
import time
from collections.abc import Callable, Mapping
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final
from urllib.parse import parse_qsl, unquote, urlsplit

import numpy as np

from pdrbench import __version__
from pdrbench.errors import PdrbenchError
from pdrbench.evaluation import store
from pdrbench.evaluation.origin import versions
from pdrbench.evaluation.walk_job import HIDDEN_SPLITS
from pdrbench.geometry import FloatArray
from pdrbench.result import COMPLETE, FAILED, OFFLINE, ONLINE, Result
from pdrbench.task import Task
from pdrbench.trajectory import ESTIMATE_COLUMNS, Estimates
from pdrbench_evaal.places import LOCAL_PLACES, PlaceFormat
from pdrbench_evaal.records import to_lines
from pdrbench_evaal.trial import FINISHED, STANDARD_RULES, TEXT, Reply, Rules, Trial

LOCALHOST: Final = "127.0.0.1"
SERVER_NAME: Final = "pdrbench"  # begins the header `Server`: a client learns from it how senders are named
PREFIX: Final = "evaalapi"  # servers of competitions have it before the trial; here it may stand or be left out
CLIENT_NAME: Final = "evaal"  # localizer of stored results: the server does not know which it is
MAX_QUERY_CHARACTERS: Final = 2000
MAX_BODY_BYTES: Final = 16 << 20
MAX_PARAMETERS: Final = 8
MAX_CONNECTIONS: Final = 32
IDLE_S: Final = 30.0  # after which a silent connection is closed


def make_trials(
    task: Task,
    split: str,
    *,
    walks: int | None = None,
    rules: Rules = STANDARD_RULES,
    places: PlaceFormat = LOCAL_PLACES,
    on_end: Callable[[Trial, Result], None] | None = None,
    clock: Callable[[], float] = time.time,
    place: str = "",
) -> dict[str, Trial]:
    """One trial a walk, named as the walk; those of a split whose reference is withheld are scoring trials.

    Args:
        task: The environment.
        split: Its walks.
        walks: Only the first so many.
        rules: Timing; `is_reloadable` as it stands there outside "test".
        places: How positions are written.
        on_end: Called when a trial has ended, with what was answered.
        clock: Wall clock in seconds.
        place: Path of the task, where it is a file.
    """
    rules = dataclasses.replace(rules, is_reloadable=rules.is_reloadable and split not in HIDDEN_SPLITS)
    trials = {}
    for walk in task.split(split)[:walks]:
        trials[walk] = Trial(
            walk,
            functools.partial(_lines_of, task, walk),
            places,
            functools.partial(_start_of, task, walk, places),
            rules,
            clock=clock,
            on_end=None if on_end is None else functools.partial(_report, task, split, place, on_end),
        )
    return trials


def _lines_of(task: Task, walk: str) -> tuple[list[str], FloatArray]:
    streams = task.load(walk).streams
    return to_lines({spec.name: streams[spec.name] for spec in task.sensors if spec.name in streams})


def _start_of(task: Task, walk: str, places: PlaceFormat) -> str:
    start = task.fallback(task.load(walk))
    return places.write(start.xy_m, start.level)


def _report(task: Task, split: str, place: str, on_end: Callable[[Trial, Result], None], trial: Trial) -> None:
    on_end(trial, result_of(trial, task, split, place))


def result_of(trial: Trial, task: Task, split: str, place: str = "") -> Result:
    """What was answered in a trial, on the clock of the walk; without the initial position, which no client sent.

    `place` is the path of a task that is a file, with which `score` finds it again.
    """
    sent = trial.estimates[1:]
    places = [trial.places.read(estimated.place) for estimated in sent]
    columns = np.full((len(ESTIMATE_COLUMNS), len(sent)), np.nan)
    columns[:3] = np.array([[*xy_m, level] for xy_m, level in places]).reshape(-1, 3).T
    return Result(
        env=task.id,
        split=split,
        walk=trial.name,
        localizer=CLIENT_NAME,
        seed=0,
        estimates=Estimates.from_columns(np.array([estimated.t_s for estimated in sent]), columns),
        step_s=np.full(len(sent), np.nan),
        status=COMPLETE if trial.state == FINISHED else FAILED,
        failure="" if trial.state == FINISHED else "timeout: the client did not keep up with the trial",
        division=OFFLINE if trial.rules.is_offline else ONLINE,
        provenance={
            **task.walk_identity(trial.name),
            **({"task": place} if place else {}),
            "versions": versions(),
            "rules": dataclasses.asdict(trial.rules),
        },
    )


def store_result(result: Result, folder: Path) -> Path:
    """Writes a result where `load_results`, `pdrbench plot` and `pdrbench compare` find it."""
    content = store.encode(result)
    key = hashlib.sha256(content).hexdigest()
    path = folder / store.result_name(result.env, result.localizer, result.walk, result.seed, key)
    store.write_whole(path, content)
    return path


class TrialServer(ThreadingHTTPServer):
    """Serves trials at `/TRIAL/COMMAND` and `/evaalapi/TRIAL/COMMAND`; `serve_forever` until `shutdown`."""

    daemon_threads = True

    def __init__(self, trials: Mapping[str, Trial], *, host: str = LOCALHOST, port: int = 0) -> None:
        """Binds a port.

        Args:
            trials: By name.
            host: Address; by default no other machine reaches the server.
            port: 0 for any that is free.

        Raises:
            PdrbenchError: The port is taken, or may not be used.
        """
        self.trials = dict(trials)
        self._free = threading.BoundedSemaphore(MAX_CONNECTIONS)
        try:
            super().__init__((host, port), _Handler)
        except OSError as error:
            raise PdrbenchError(
                f"cannot serve at {host}:{port}: {error.strerror or error}; choose another --port"
            ) from error

    @property
    def url(self) -> str:
        """Where the trials are."""
        return f"http://{self.server_address[0]!s}:{self.server_address[1]}/{PREFIX}/"

    def process_request(self, request: Any, client_address: Any) -> None:
        """Waits while there are as many connections as are served at once."""
        self._free.acquire()
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        """Makes room for the next connection."""
        super().shutdown_request(request)
        self._free.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Says nothing where a client went away; anything else is a bug."""
        if not isinstance(sys.exc_info()[1], (ConnectionError, TimeoutError)):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    server: TrialServer
    protocol_version = "HTTP/1.1"
    server_version = f"{SERVER_NAME}/{__version__}"
    sys_version = ""
    timeout = IDLE_S

    def do_GET(self) -> None:
        address = urlsplit(self.path)
        if len(self.path) > MAX_QUERY_CHARACTERS:
            return self._send(Reply(414, "the request is too long", TEXT))
        trial, command = self._find(address.path)
        if trial is None:
            return self._send(self._missing(address.path))
        try:
            query = parse_qsl(address.query, keep_blank_values=True, max_num_fields=MAX_PARAMETERS, errors="strict")
        except ValueError as error:
            return self._send(Reply(422, f"the parameters cannot be read: {error}", TEXT))
        if len(dict(query)) != len(query):
            return self._send(Reply(422, "a parameter stands once", TEXT))
        return self._send(trial.get(command, dict(query)))

    def do_POST(self) -> None:
        trial, command = self._find(urlsplit(self.path).path)
        length = self.headers.get("Content-Length", "")
        self.close_connection = True  # what is left of a body that is not read must not pass for a request
        if not length.isascii() or not length.isdecimal():
            return self._send(Reply(411, "state the length of the estimates", TEXT))
        if int(length) > MAX_BODY_BYTES:
            return self._send(Reply(413, f"more than {MAX_BODY_BYTES} bytes", TEXT))
        body = self.rfile.read(int(length))
        if trial is None:
            return self._send(Reply(404, "no such trial", TEXT))
        return self._send(trial.post(command, body, self.headers.get("Content-Type", "")))

    def _find(self, path: str) -> tuple[Trial | None, str]:
        parts = unquote(path).strip("/").split("/")
        if parts[0] == PREFIX:
            del parts[0]
        return (self.server.trials.get(parts[0]), parts[1]) if len(parts) == 2 else (None, "")

    def _missing(self, path: str) -> Reply:
        if path.strip("/") in ("", PREFIX):
            lines = ["EvAAL API, https://evaal.aaloa.org/evaalapi/; trials:", *self.server.trials]
            return Reply(200, "\n".join([*lines, ""]), TEXT)
        return Reply(404, "no such trial", TEXT)

    def _send(self, reply: Reply) -> None:
        body = reply.body.encode() if isinstance(reply.body, str) else reply.body
        self.send_response(reply.status)
        self.send_header("Content-Type", reply.content_type)
        self.send_header("Content-Length", str(len(body)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *arguments: object) -> None:
        """Says nothing: trials keep logs of their own."""
