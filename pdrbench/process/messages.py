"""Messages between the evaluating process and that of a localizer: typed, limited in size, never unpickled.

A frame is four bytes of length, little-endian, and that many bytes of MessagePack (`serialise`). Every request has a
number, and every reply the number of its request.
"""

from __future__ import annotations

import signal
import struct
from typing import Any, Final, Literal, TypeVar

import msgspec

from pdrbench.episode import EstimateRow
from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing
from pdrbench.process.serialise import RngState, decoder, encoder
from pdrbench.trajectory import Trajectory

MAX_REPLY_BYTES: Final = 65_536  # but for a revised past
MAX_TEXT_CHARACTERS: Final = 16_384  # characters of a traceback
# Makes the process write a traceback; few programs use it, and Windows has none.
TRACE_SIGNAL: Final[Any] = getattr(signal, "SIGVTALRM", None)
LENGTH_BYTES: Final = 4


class ProtocolError(PdrbenchError):
    """The process of a localizer sent something other than a valid reply."""


class Construct(msgspec.Struct, array_like=True, frozen=True, tag="construct"):
    """Make a localizer, watched where asked to; `parameters` is JSON.

    One that has been made in this process with the same parameters, and has not failed, is taken again.
    """

    number: int
    target: str
    parameters: str
    is_watched: bool = False


class GiveReference(msgspec.Struct, array_like=True, frozen=True, tag="reference"):
    """The reference, for a localizer that asks for it, on splits where it is public."""

    number: int
    reference: Trajectory


class Reset(msgspec.Struct, array_like=True, frozen=True, tag="reset"):
    """Begin the walk."""

    number: int
    briefing: Briefing
    rng: RngState


class Step(msgspec.Struct, array_like=True, frozen=True, tag="step"):
    """An observation: raw rows of every sensor, in the order of the briefing."""

    number: int
    now_s: float
    rows: list[bytearray]  # arrays over these can be written to


class Revise(msgspec.Struct, array_like=True, frozen=True, tag="revise"):
    """The walk is over: answer with the whole track."""

    number: int


class Report(msgspec.Struct, array_like=True, frozen=True, tag="report"):
    """Report what was seen of a watched localizer."""

    number: int


class Started(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="started"):
    """The process is there, with what protects the system from it; sent before any code of a localizer runs."""

    number: int
    held: list[str]
    missing: dict[str, str]


class Stale(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="stale"):
    """No localizer was made: a source that this process has loaded has changed since."""

    number: int


class Ready(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="ready"):
    """A localizer has been made."""

    number: int
    revises: bool
    asks_for_truth: bool


class Seen(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="seen"):
    """What a localizer that is watched has changed and disturbed, as `watched.Watched` says."""

    number: int
    changed: list[str]
    disturbed: list[str]


class Done(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="done"):
    """That call returned."""

    number: int


class Answer(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="answer"):
    """An estimate, as `episode.read_estimate` returns it."""

    number: int
    claims: EstimateRow


class Missing(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="missing"):
    """An answer that cannot be scored, why in a word, and what it was."""

    number: int
    reason: Literal["nothing", "type", "shape", "nan", "level"]
    what: str


class Track(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="track"):
    """A revised past (K, 6), or None."""

    number: int
    rows: FloatArray | None


class Failed(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="failed"):
    """The localizer raised: a traceback, or the reason why the walk does not suit it."""

    number: int
    unsuitable: bool
    text: str


Request = Construct | GiveReference | Reset | Step | Revise | Report
Reply = Started | Stale | Ready | Seen | Done | Answer | Missing | Track | Failed
Kind = TypeVar("Kind")

_LENGTH: Final = struct.Struct("<I")
_ENCODER: Final = encoder()
_REQUESTS: Final = decoder(Request)
_REPLIES: Final = decoder(Reply)


def frame(message: msgspec.Struct) -> bytearray:
    """A message as it travels."""
    content = bytearray(LENGTH_BYTES)
    _ENCODER.encode_into(message, content, LENGTH_BYTES)
    _LENGTH.pack_into(content, 0, len(content) - LENGTH_BYTES)
    return content


def frame_size(head: bytes | bytearray, max_bytes: int) -> int | None:
    """Bytes of the frame that begins with `head`, its length included; None where the length has not come yet.

    Raises:
        ProtocolError: It is longer than `max_bytes`.
    """
    if len(head) < LENGTH_BYTES:
        return None
    size = int.from_bytes(head[:LENGTH_BYTES], "little")
    if size > max_bytes:
        raise ProtocolError(f"a reply announces {size} bytes; at most {max_bytes} are allowed")
    return LENGTH_BYTES + size


def read_request(body: bytes | memoryview) -> Request:
    """The request in a frame from the evaluating side."""
    request: Request = _REQUESTS.decode(body)
    return request


def read_reply(body: bytes | bytearray, number: int, kind: type[Kind]) -> Kind | Failed:
    """The reply in a frame, checked: of the kind that was asked for, to the request with this number.

    Raises:
        ProtocolError: It is anything else.
    """
    try:
        reply = _REPLIES.decode(body)
    except (msgspec.MsgspecError, RecursionError, UnicodeError, OverflowError, MemoryError) as error:
        raise ProtocolError(f"a reply cannot be read: {type(error).__name__}: {str(error)[:200]}") from None
    if reply.number != number:
        raise ProtocolError(f"request {number} was answered by a reply to request {reply.number}")
    if not isinstance(reply, (kind, Failed)):
        raise ProtocolError(f"request {number} was answered by {type(reply).__name__!r}")
    return reply
