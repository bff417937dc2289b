"""What the process of a localizer runs: it makes the localizer and answers requests until their pipe is closed."""

from __future__ import annotations

import faulthandler
import io
import json
import os
import sys
import traceback
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.episode import read_estimate, read_track
from pdrbench.errors import EstimateError, UnsuitableError
from pdrbench.isolation import messages
from pdrbench.isolation.boot import LENGTH_BYTES
from pdrbench.isolation.messages import MAX_TEXT_CHARACTERS, TRACE_SIGNAL, frame, read_request
from pdrbench.isolation.serialise import unpack_generator
from pdrbench.isolation.watched import Watched
from pdrbench.localizer import Observation
from pdrbench.registry import make_localizer

MAX_SEEN: Final = 8  # changes of observations that are reported
ITEM_BYTES: Final = np.dtype(np.float64).itemsize
READ_BYTES: Final = 1 << 15  # a larger buffer would be mapped anew for every observation, which costs 20 us


def serve(requests: int, replies: int, confined: messages.Confined) -> None:
    """Answers until the requests end, then ends the process.

    Args:
        requests: Descriptor of frames to read.
        replies: Descriptor of frames to write.
        confined: The protections in force; the first message to be sent.
    """
    faulthandler.enable(2)
    if TRACE_SIGNAL is not None:
        faulthandler.register(TRACE_SIGNAL, 2, all_threads=True)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(line_buffering=True)
    _send(replies, frame(confined))
    host = _Host()
    while True:
        reply = frame(host.answer(_next_request(requests)))
        sent = os.write(replies, reply)
        if sent < len(reply):
            _send(replies, bytes(reply[sent:]))


class _Host:
    """Holds one localizer and passes requests on to it."""

    def __init__(self) -> None:
        self._localizer: Any = None
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
                return messages.Missing(request.number, str(error).partition(":")[0])  # type: ignore[arg-type]
        except UnsuitableError as error:
            return messages.Failed(request.number, True, str(error)[:MAX_TEXT_CHARACTERS])
        except Exception:  # noqa: BLE001  that is its result
            return messages.Failed(request.number, False, _capped(traceback.format_exc()))
        except BaseException as error:  # noqa: BLE001  the same, but it would have ended the process
            text = f"LocalizerExit: the localizer raised {type(error).__name__}: {error}"
            return messages.Failed(request.number, False, _capped(f"{traceback.format_exc()}\n{text}"))

    def _other(self, request: messages.Request) -> msgspec.Struct:
        number = request.number
        if isinstance(request, messages.Construct):
            target, parameters = request.target, json.loads(request.parameters)
            if request.is_watched:
                self._localizer = Watched(lambda: make_localizer(target, **parameters))
            else:
                self._localizer = make_localizer(target, **parameters)
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
