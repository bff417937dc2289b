"""What the process of a localizer runs: it makes localizers and answers requests until their pipe is closed."""

from __future__ import annotations

import faulthandler
import io
import json
import os
import sys
import sysconfig
import threading
import time
import traceback
import warnings
from typing import Any, Final

import msgspec
import numpy as np
import psutil  # type: ignore[import-untyped]

from pdrbench.episode import place_of_step, read_estimate, read_track
from pdrbench.errors import EstimateError, RecordingWarning, UnsuitableError
from pdrbench.localizer import Observation
from pdrbench.process import messages
from pdrbench.process.messages import LENGTH_BYTES, MAX_TEXT_CHARACTERS, TRACE_SIGNAL, frame, read_request
from pdrbench.process.serialise import unpack_generator
from pdrbench.process.watched import Watched
from pdrbench.registry import make_localizer

MAX_SEEN: Final = 8  # changes of observations that are reported
ITEM_BYTES: Final = np.dtype(np.float64).itemsize
MAX_MADE: Final = 16  # localizers that are kept; those that have waited longest are made anew
OWNER_LOOK_S: Final = 0.5  # between looks whether the owner lives
INSTALLED: Final = ("stdlib", "platstdlib", "purelib", "platlib")  # names of folders that pip and the system own
READ_BYTES: Final = 1 << 15  # a larger buffer would be mapped anew for every observation, which costs 20 us


def main(owner: int) -> None:
    """What a plain process runs: it ends with its owner."""
    end_with(owner)
    requests, replies = os.dup(0), os.dup(1)
    null = os.open(os.devnull, os.O_RDONLY)
    os.dup2(null, 0)
    os.close(null)
    os.dup2(2, 1)  # what a localizer prints
    serve(requests, replies, messages.Started(0, [], {}))


def end_with(owner: int) -> None:
    """Ends this process once the one that has started it is gone, also while a localizer computes."""

    def look() -> None:
        while os.getppid() == owner and psutil.pid_exists(owner):  # Windows does not change the former
            time.sleep(OWNER_LOOK_S)
        os._exit(1)

    threading.Thread(target=look, daemon=True).start()


def serve(requests: int, replies: int, started: messages.Started) -> None:
    """Answers until the requests end, then ends the process.

    Args:
        requests: Descriptor of frames to read.
        replies: Descriptor of frames to write.
        started: The first message to be sent.
    """
    faulthandler.enable(2)
    if TRACE_SIGNAL is not None:
        faulthandler.register(TRACE_SIGNAL, 2, all_threads=True)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(line_buffering=True)
    warnings.simplefilter("always", RecordingWarning)  # of every walk, not of the first alone
    _send(replies, frame(started))
    host = _Host()
    while True:
        reply = frame(host.answer(_next_request(requests)))
        sent = os.write(replies, reply)
        if sent < len(reply):
            _send(replies, bytes(reply[sent:]))


class _Host:
    """Holds localizers and passes requests on to the one that plays."""

    def __init__(self) -> None:
        self._made: dict[tuple[str, str], Any] = {}  # by target and parameters: they play one walk after the other
        self._sources = _Sources()
        self._localizer: Any = None
        self._key = ("", "")  # of that one
        self._sensors: list[tuple[str, int]] = []  # names and numbers of columns, in the order of the briefing

    def answer(self, request: messages.Request) -> msgspec.Struct:
        """The reply to a request; whatever a localizer raises is one."""
        try:
            if type(request) is not messages.Step:
                return self._other(request)
            rows = {
                name: np.ndarray((len(raw) // (ITEM_BYTES * columns), columns), np.float64, raw)
                for (name, columns), raw in zip(self._sensors, request.rows, strict=True)
            }
            answer = self._localizer.step(Observation(request.now_s, rows))
            try:
                return messages.Answer(request.number, read_estimate(answer))
            except EstimateError as error:
                reason, _, what = str(error).partition(": ")
                what = f"{what}{place_of_step(self._localizer)}"[:MAX_TEXT_CHARACTERS]
                return messages.Missing(request.number, reason, what)  # type: ignore[arg-type]
        except UnsuitableError as error:
            return messages.Failed(request.number, True, str(error)[:MAX_TEXT_CHARACTERS])
        except Exception:  # noqa: BLE001  that is its result
            self._made.pop(self._key, None)
            return messages.Failed(request.number, False, _capped(traceback.format_exc()))
        except BaseException as error:  # noqa: BLE001  the same, but it would have ended the process
            self._made.pop(self._key, None)
            text = f"LocalizerExit: the localizer raised {type(error).__name__}: {error}"
            return messages.Failed(request.number, False, _capped(f"{traceback.format_exc()}\n{text}"))

    def _other(self, request: messages.Request) -> msgspec.Struct:
        number = request.number
        if isinstance(request, messages.Construct):
            if self._sources.have_changed():
                return messages.Stale(number)
            self._localizer = self._make(request)
            revises, asks = (hasattr(self._localizer, name) for name in ("revise", "tell"))
            return messages.Ready(number, revises, asks)
        if isinstance(request, messages.Report):
            return messages.Seen(number, self._localizer.changed[:MAX_SEEN], self._localizer.disturbed())
        if isinstance(request, messages.GiveReference):
            self._localizer.tell(request.reference)
        elif isinstance(request, messages.Reset):
            self._sensors = [(spec.name, len(spec.columns)) for spec in request.briefing.sensors.values()]
            self._localizer.reset(request.briefing, unpack_generator(request.rng))
        elif isinstance(request, messages.Revise):
            track = self._localizer.revise()
            return messages.Track(number, None if track is None else read_track(track))
        return messages.Done(number)

    def _make(self, request: messages.Construct) -> Any:
        """A localizer that has not failed on a walk before."""
        target, parameters = request.target, json.loads(request.parameters)
        if request.is_watched:
            return Watched(lambda: make_localizer(target, **parameters))
        self._key = (target, request.parameters)
        found = self._made.pop(self._key, None) or make_localizer(target, **parameters)
        self._made[self._key] = found
        while len(self._made) > MAX_MADE:
            del self._made[next(iter(self._made))]
        self._sources.look()
        return found


class _Sources:
    """Files of the modules that this process has loaded, but for those of installed packages."""

    def __init__(self) -> None:
        self._changed_ns: dict[str, int] = {}
        self._seen: set[str] = set()
        self._installed = tuple({sysconfig.get_path(name) + os.sep for name in INSTALLED})
        self.look()

    def look(self) -> None:
        """Notes when each file that was loaded since the last look was changed."""
        for name in sys.modules.keys() - self._seen:
            self._seen.add(name)
            place = getattr(sys.modules.get(name), "__file__", None)
            if isinstance(place, str) and place.endswith(".py") and not place.startswith(self._installed):
                self._changed_ns[place] = _changed_ns(place)

    def have_changed(self) -> bool:
        """Whether any of them is another one by now."""
        return any(_changed_ns(place) != before for place, before in self._changed_ns.items())


def _changed_ns(place: str) -> int:
    """When a file was changed; 0 where it is gone."""
    try:
        return os.stat(place).st_mtime_ns  # noqa: PTH116  called for hundreds of files
    except OSError:
        return 0


def _next_request(descriptor: int) -> messages.Request:
    """The next request; ends the process where the pipe is closed."""
    content = os.read(descriptor, READ_BYTES)
    if len(content) != _size(content):
        content = _whole(descriptor, content)
    return read_request(memoryview(content)[LENGTH_BYTES:])  # the next is sent when this one is answered


def _size(head: bytes | bytearray) -> int:
    """Bytes of a frame."""
    return LENGTH_BYTES + int.from_bytes(head[:LENGTH_BYTES], "little")


def _whole(descriptor: int, begun: bytes) -> bytes:
    """The complete frame, of which some bytes have come."""
    content = bytearray(begun)
    while len(content) < _size(content):
        part = os.read(descriptor, READ_BYTES)
        if not part:
            os._exit(0)
        content += part
    return bytes(content)


def _send(descriptor: int, content: bytes | bytearray) -> None:
    left = memoryview(content)
    while left:
        left = left[os.write(descriptor, left) :]


def _capped(text: str) -> str:
    """The end of a text, where the cause stands, few enough bytes for a reply."""
    return text.encode(errors="replace")[-MAX_TEXT_CHARACTERS:].decode(errors="replace")
