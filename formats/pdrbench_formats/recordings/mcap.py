"""Messages in MCAP files (mcap.dev/spec): records one after the other, most of them inside compressed chunks."""

from __future__ import annotations

import mmap
import struct
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Final

from pdrbench.errors import RecordingError
from pdrbench_formats.recordings.assemble import Tally
from pdrbench_formats.recordings.ros_messages import KINDS, MAX_MESSAGE_BYTES, Topic, kind_of

MAGIC: Final = b"\x89MCAP0\r\n"
MAX_CHUNK_BYTES: Final = 1 << 28  # unpacked; writers begin a new chunk after some megabytes
MAX_BYTES: Final = 8 << 30  # of messages that are kept
_SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _DATA_END = 3, 4, 5, 6, 15
_RECORD: Final = struct.Struct("<BQ")
_MESSAGE_HEAD: Final = struct.Struct("<HIQQ")  # channel, counter, time of the bag, time of the sender
_CHUNK_HEAD: Final = struct.Struct("<QQQI")  # first and last time, unpacked size, check sum
_ENCODINGS: Final = ("cdr", "ros1", "json")


def read_mcap(paths: Sequence[Path], tally: Tally) -> dict[str, Topic]:
    """The messages of the kinds that are read, by topic.

    Args:
        paths: One file, or the parts of a bag in order.
        tally: Counts messages of other topics; notes where a file is cut.

    Raises:
        RecordingError: A file is damaged, or a chunk unpacks to more than a recording holds.
    """
    topics: dict[str, Topic] = {}
    for path in paths:
        try:
            with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as content:
                _File(path, topics, tally).read(content, len(MAGIC), is_chunk=False)
        except (OSError, ValueError, struct.error) as error:
            raise RecordingError(f"{path}: the file is damaged ({error}); repair it with `mcap recover`") from error
    return topics


class _File:
    """What one file says on its channels."""

    def __init__(self, path: Path, topics: dict[str, Topic], tally: Tally) -> None:
        self.path, self.topics, self.tally = path, topics, tally
        self.schemas: dict[int, str] = {}
        self.channels: dict[int, tuple[str, Topic | None]] = {}
        self.num_bytes = 0

    def read(self, content: mmap.mmap | bytes, place: int, *, is_chunk: bool) -> None:
        """Adds the messages of the file, or of a chunk."""
        size = len(content)
        while place + _RECORD.size <= size:
            opcode, length = _RECORD.unpack_from(content, place)
            begin, place = place + _RECORD.size, place + _RECORD.size + length
            if place > size:
                break
            if opcode == _MESSAGE:
                channel, _, bag_ns, _ = _MESSAGE_HEAD.unpack_from(content, begin)
                name, topic = self.channels.get(channel, ("a channel that is not declared", None))
                if topic is None:
                    self.tally.skipped[name] += 1
                    continue
                message = content[begin + _MESSAGE_HEAD.size : place]
                topic.bag_ns.append(min(bag_ns, 2**63 - 1))
                topic.messages.append(message)
                self.num_bytes += len(message)
                if self.num_bytes > MAX_BYTES or len(message) > MAX_MESSAGE_BYTES:
                    raise RecordingError(
                        f"{self.path}: {name}: {len(message)} bytes in a message, {self.num_bytes} in all; "
                        f"that is no inertial unit: split the bag, or leave the topic out"
                    )
            elif opcode == _CHUNK and not is_chunk:
                self.read(self._unpacked(content[begin:place]), 0, is_chunk=True)
            elif opcode == _SCHEMA:
                (key,), (schema_name,) = _fields(content[begin:place], "H", 1)
                self.schemas[key] = schema_name
            elif opcode == _CHANNEL:
                (key, schema), (topic_name, encoding) = _fields(content[begin:place], "HH", 2)
                self._declare(key, self.schemas.get(schema, ""), topic_name, encoding)
            elif opcode == _DATA_END:
                return
        if not is_chunk or place > size:
            seen = "the file ends within its data: the recorder was stopped, or it is not copied whole"
            self.tally.found("cut", self.path.name, seen)

    def _declare(self, key: int, message_type: str, name: str, encoding: str) -> None:
        kind = kind_of(message_type)
        if encoding == "json":
            kind = message_type.replace(".", "/").rpartition("/")[2]
        topic = None
        if kind in KINDS and encoding in _ENCODINGS:
            topic = self.topics.setdefault(name, Topic(kind, encoding))
            if (topic.kind, topic.encoding) != (kind, encoding):
                topic = None
        self.channels[key] = name, topic

    def _unpacked(self, chunk: bytes) -> bytes:
        *_, size, _ = _CHUNK_HEAD.unpack_from(chunk)
        (length,) = struct.unpack_from("<I", chunk, _CHUNK_HEAD.size)
        begin = _CHUNK_HEAD.size + 4 + length
        compression, data = chunk[_CHUNK_HEAD.size + 4 : begin], chunk[begin + 8 :]
        if size > MAX_CHUNK_BYTES:
            raise RecordingError(f"{self.path}: a chunk of {size} bytes; that is no recording: do not open it")
        if compression not in _DECOMPRESS:
            raise RecordingError(f"{self.path}: compressed by {compression!r}; convert it with `mcap compress`")
        try:
            return _DECOMPRESS[compression](data, size)
        except ImportError as error:
            raise RecordingError(f"{self.path}: needs {error.name}: pip install pdrbench[formats]") from error


def _fields(record: bytes, keys: str, num_texts: int) -> tuple[tuple[int, ...], list[str]]:
    """Whole numbers and texts at the beginning of a record."""
    place, texts = struct.calcsize(f"<{keys}"), []
    for _ in range(num_texts):
        (length,) = struct.unpack_from("<I", record, place)
        texts.append(record[place + 4 : place + 4 + length].decode())
        place += 4 + length
    return struct.unpack_from(f"<{keys}", record), texts


def _zstd(data: bytes, size: int) -> bytes:
    import zstandard

    try:
        return zstandard.ZstdDecompressor().stream_reader(data).read(size)
    except zstandard.ZstdError as error:
        raise ValueError(str(error)) from error


def _lz4(data: bytes, size: int) -> bytes:
    import lz4.frame

    try:
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size))
    except RuntimeError as error:
        raise ValueError(str(error)) from error


_DECOMPRESS: Final[Mapping[bytes, Callable[[bytes, int], bytes]]] = {
    b"": lambda data, size: data,
    b"zstd": _zstd,
    b"lz4": _lz4,
}
