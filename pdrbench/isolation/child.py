"""The process that holds a localizer: gives up what it can, then answers requests until nobody asks any more."""

from __future__ import annotations

import faulthandler
import io
import json
import os
import sys
import traceback
from collections.abc import Mapping
from typing import Any, Final

import msgspec
import numpy as np

from pdrbench.episode import read_estimate, read_track
from pdrbench.errors import EstimateError, UnsuitableError
from pdrbench.isolation import messages, numba_cache
from pdrbench.isolation.messages import LENGTH_BYTES, LIBRARIES, MOST_TEXT, TRACE_SIGNAL, frame, read_request
from pdrbench.isolation.telling import unpack_briefing, unpack_generator, unpack_reference
from pdrbench.localizer import Localizer, Observation
from pdrbench.registry import make_localizer

READ_BYTES: Final = 1 << 15  # a larger buffer would be mapped anew for every observation, which costs 20 us


def serve(requests: int, replies: int, confined: messages.Confined) -> None:
    """Answers until the requests end, then ends the process.

    Args:
        requests: Descriptor of frames to read.
        replies: Descriptor of frames to write.
        confined: What protects the system; the first thing to be sent.
    """
    faulthandler.enable(2)
    faulthandler.register(TRACE_SIGNAL, 2, all_threads=True)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(line_buffering=True)
    _send(replies, confined)
    host = _Host()
    for request in _requests(requests):
        _send(replies, host.answer(request))
    os._exit(0)


class _Host:
    """Around one localizer."""

    def __init__(self) -> None:
        self._localizer: Any = None
        self._sensors: list[tuple[str, int]] = []  # names and numbers of columns, in the order of the briefing

    def answer(self, request: messages.Request) -> msgspec.Struct:
        """The reply to a request; whatever a localizer raises is one."""
        try:
            if type(request) is messages.Step:
                return self._step(request)
            return self._other(request)
        except UnsuitableError as error:
            return messages.Failed(request.number, True, str(error)[:MOST_TEXT])
        except Exception:  # noqa: BLE001  that is its result
            return messages.Failed(request.number, False, _capped(traceback.format_exc()))
        except BaseException as error:  # noqa: BLE001  the same, but it would have ended the process
            told = f"LocalizerExit: the localizer raised {type(error).__name__}: {error}"
            return messages.Failed(request.number, False, _capped(f"{traceback.format_exc()}\n{told}"))

    def _step(self, request: messages.Step) -> msgspec.Struct:
        rows = {
            name: np.frombuffer(raw, dtype=np.float64).reshape(-1, columns).copy()
            for (name, columns), raw in zip(self._sensors, request.rows, strict=True)
        }
        answer = self._localizer.step(Observation(now_s=request.now_s, rows=rows))
        try:
            claims = read_estimate(answer)
        except EstimateError as error:
            return messages.Missing(request.number, str(error).partition(":")[0])  # type: ignore[arg-type]
        return messages.Answer(request.number, messages.pack_claims(claims))

    def _other(self, request: messages.Request) -> msgspec.Struct:
        number = request.number
        if isinstance(request, messages.Construct):
            self._localizer = make_localizer(request.target, **json.loads(request.parameters))
            revises, asks = (hasattr(self._localizer, name) for name in ("revise", "tell"))
            return messages.Ready(number, revises, asks, loaded_libraries())
        if isinstance(request, messages.Leave):
            return messages.Done(number, " ".join(numba_cache.lost()))
        if isinstance(request, messages.Tell):
            self._localizer.tell(unpack_reference(request.columns))
        elif isinstance(request, messages.Reset):
            self._reset(request)
        elif isinstance(request, messages.Revise):
            track = self._localizer.revise()
            rows = None if track is None else messages.Array.of(read_track(track))
            return messages.Track(number, rows)
        return messages.Done(number)

    def _reset(self, request: messages.Reset) -> None:
        briefing = unpack_briefing(request.briefing)
        self._sensors = [(spec.name, len(spec.columns)) for spec in briefing.sensors.values()]
        localizer: Localizer = self._localizer
        localizer.reset(briefing, unpack_generator(request.rng))


def loaded_libraries() -> list[str]:
    """Those of `LIBRARIES` that this process has loaded."""
    return [name for name in LIBRARIES if name in sys.modules]


def _requests(descriptor: int) -> Any:
    """Requests as they come; ends with the pipe."""
    while True:
        part = os.read(descriptor, READ_BYTES)
        if not part:
            return
        if len(part) < LENGTH_BYTES:
            part = _rest(descriptor, part, LENGTH_BYTES)
        size = LENGTH_BYTES + int.from_bytes(part[:LENGTH_BYTES], "little")
        if len(part) < size:
            part = _rest(descriptor, part, size)
        yield read_request(part[LENGTH_BYTES:])  # one at a time: the next is sent when this one is answered


def _rest(descriptor: int, begun: bytes, size: int) -> bytes:
    """A whole frame of which some has come."""
    content = bytearray(begun)
    while len(content) < size:
        part = os.read(descriptor, size - len(content))
        if not part:
            os._exit(0)
        content += part
    return bytes(content)


def _send(descriptor: int, message: msgspec.Struct) -> None:
    left = memoryview(frame(message))
    while left:
        left = left[os.write(descriptor, left) :]


def _capped(text: str) -> str:
    """The end of a text, where the cause is told, few enough bytes for a reply."""
    return text.encode(errors="replace")[-MOST_TEXT:].decode(errors="replace")


def environment(scratch: str, given: Mapping[str, str]) -> dict[str, str]:
    """Variables of a child: nothing of the user's but what is handed over by name."""
    return {**given, "HOME": scratch, "TMPDIR": scratch, "PYTHONDONTWRITEBYTECODE": "1", "LANG": "C.UTF-8"}
