"""What travels between the evaluating process and the one that holds a localizer: typed, measured, never unpickled.

A frame is four bytes of length, little-endian, and that many bytes of msgpack. Arrays are their shape and their raw
little-endian bytes. Every request has a number, and every reply the number of its request.
"""

from __future__ import annotations

import signal
import struct
from collections.abc import Mapping
from typing import Any, Final, Literal, TypeVar, cast

import msgspec
import numpy as np
from numpy.typing import NDArray

from pdrbench.episode import Claims
from pdrbench.errors import PdrbenchError

LENGTH_BYTES: Final = 4
MOST_REPLY_BYTES: Final = 65_536  # but for a revised past
MOST_TEXT: Final = 16_384  # characters of a traceback
TRACE_SIGNAL: Final = signal.SIGVTALRM  # makes the process write where it is; hardly used by anybody
# Libraries that take long to import: a launcher imports them for the children after one that has used them. No others:
# a child could name anything.
LIBRARIES: Final = (
    *("joblib", "pandas", "scipy.cluster", "scipy.interpolate", "scipy.linalg", "scipy.ndimage", "scipy.optimize"),
    *("scipy.signal", "scipy.sparse", "scipy.spatial", "scipy.special", "scipy.stats", "shapely", "sklearn.cluster"),
    *("sklearn.ensemble", "sklearn.linear_model", "sklearn.neighbors", "sklearn.preprocessing", "sklearn.svm", "torch"),
)

DType = Literal["<f8", "<i8", "|b1"]


class ProtocolError(PdrbenchError):
    """The process of a localizer sent what is no reply."""


class Array(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True):
    """An array as its raw bytes."""

    dtype: DType
    shape: tuple[int, ...]
    data: bytes

    @staticmethod
    def of(values: NDArray[Any]) -> Array:
        """Packs float64, int64 or bool."""
        name: Any = values.dtype.newbyteorder("<").str
        return Array(name, values.shape, np.ascontiguousarray(values).tobytes())

    def array(self) -> NDArray[Any]:
        """Unpacks a writeable copy; raises `ProtocolError` where shape and bytes disagree."""
        dtype = np.dtype(self.dtype)
        count = 1
        for size in self.shape:
            count *= size
        if any(size < 0 for size in self.shape) or count * dtype.itemsize != len(self.data):
            raise ProtocolError(f"an array of shape {self.shape} came with {len(self.data)} bytes")
        return np.frombuffer(self.data, dtype=dtype).reshape(self.shape).copy()


class Polygon(msgspec.Struct, array_like=True, frozen=True):
    """A floor polygon."""

    id: str
    outline_xy_m: Array
    neighbour: Array
    height_m: float
    level: int
    kind: str
    holes: list[Array]


class Zone(msgspec.Struct, array_like=True, frozen=True):
    """A named area."""

    id: str
    name: str
    outline_xy_m: Array
    level: int
    kind: str


class Map(msgspec.Struct, array_like=True, frozen=True):
    """A building."""

    name: str
    polygons: list[Polygon]
    zones: list[Zone]


class Sensor(msgspec.Struct, array_like=True, frozen=True):
    """A sensor spec."""

    name: str
    columns: list[str]
    low: Array
    high: Array
    rate_hz: float | None
    what: str


class Begin(msgspec.Struct, array_like=True, frozen=True):
    """A told start."""

    xy_m: Array
    level: int
    heading_rad: float | None
    radius_m: float


class Survey(msgspec.Struct, array_like=True, frozen=True):
    """A radio map."""

    columns: dict[str, Array]
    surveyed: bool


class Told(msgspec.Struct, array_like=True, frozen=True):
    """A briefing."""

    building: Map | None
    sensors: list[Sensor]
    period_s: float
    start: Begin | None
    radio_map: Survey | None
    subject: dict[str, float | str]
    mounting: str


class Dice(msgspec.Struct, array_like=True, frozen=True):
    """A generator of random numbers: the bit generator's name, its state and its seed sequence as JSON."""

    name: Literal["PCG64"]
    state: str
    entropy: str
    spawn_key: list[int]
    num_spawned: int


class Construct(msgspec.Struct, array_like=True, frozen=True, tag="construct"):
    """Load the class and make a localizer; `parameters` is JSON."""

    number: int
    target: str
    parameters: str


class Tell(msgspec.Struct, array_like=True, frozen=True, tag="tell"):
    """The truth, where it is public and asked for."""

    number: int
    columns: dict[str, Array]


class Reset(msgspec.Struct, array_like=True, frozen=True, tag="reset"):
    """Begin the walk."""

    number: int
    briefing: Told
    rng: Dice


class Step(msgspec.Struct, array_like=True, frozen=True, tag="step"):
    """An observation: raw rows of every sensor, in the order of the briefing."""

    number: int
    now_s: float
    rows: list[bytearray]  # arrays over these can be written to


class Revise(msgspec.Struct, array_like=True, frozen=True, tag="revise"):
    """The walk is over: tell where the pedestrian was."""

    number: int


class Leave(msgspec.Struct, array_like=True, frozen=True, tag="leave"):
    """The walk is over; tell what was compiled and could not be kept."""

    number: int


class Confined(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="confined"):
    """What protects the system from this process; sent before any code of the localizer runs."""

    number: int
    held: list[str]
    missing: dict[str, str]


class Ready(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="ready"):
    """A localizer has been made; `libraries` are the large ones that it has loaded."""

    number: int
    revises: bool
    asks_for_truth: bool
    libraries: list[str]


class Done(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="done"):
    """That call returned."""

    number: int
    text: str = ""


class Answer(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="answer"):
    """An estimate, as `episode.read_estimate` returns it."""

    number: int
    claims: Claims


class Missing(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="missing"):
    """An answer that cannot be scored, and why."""

    number: int
    reason: Literal["nothing", "type", "shape", "nan", "level"]


class Track(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="track"):
    """A revised past (K, 6), or None."""

    number: int
    rows: Array | None


class Failed(msgspec.Struct, array_like=True, frozen=True, forbid_unknown_fields=True, tag="failed"):
    """The localizer raised: a traceback, or why the walk does not suit it."""

    number: int
    unsuitable: bool
    text: str


Request = Construct | Tell | Reset | Step | Revise | Leave
Reply = Confined | Ready | Done | Answer | Missing | Track | Failed
Kind = TypeVar("Kind")

_LENGTH: Final = struct.Struct("<I")
_ENCODER: Final = msgspec.msgpack.Encoder()
_REQUESTS: Final = msgspec.msgpack.Decoder(Request)
_REPLIES: Final = msgspec.msgpack.Decoder(Reply)


def frame(message: msgspec.Struct) -> bytearray:
    """A message as it travels."""
    content = bytearray(LENGTH_BYTES)
    _ENCODER.encode_into(message, content, LENGTH_BYTES)
    _LENGTH.pack_into(content, 0, len(content) - LENGTH_BYTES)
    return content


def frame_size(head: bytes | bytearray, most: int) -> int | None:
    """Bytes of the frame that begins with `head`, its length included; None where that cannot be told yet.

    Raises:
        ProtocolError: It is longer than `most`.
    """
    if len(head) < LENGTH_BYTES:
        return None
    size = int.from_bytes(head[:LENGTH_BYTES], "little")
    if size > most:
        raise ProtocolError(f"a reply announces {size} bytes; {most} are the most")
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
    if isinstance(reply, Track) and reply.rows is not None:
        reply.rows.array()  # raises where shape and bytes disagree
    return cast("Kind | Failed", reply)


def pack_columns(record: Any, names: tuple[str, ...]) -> dict[str, Array]:
    """Arrays of a record by name; those that are None are left out."""
    return {name: Array.of(getattr(record, name)) for name in names if getattr(record, name) is not None}


def unpack_columns(columns: Mapping[str, Array]) -> dict[str, NDArray[Any]]:
    """The other way round."""
    return {name: column.array() for name, column in columns.items()}
