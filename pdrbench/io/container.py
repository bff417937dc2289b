"""A file, a folder or a zip archive as one mapping of member names to contents, read within bounds."""

from __future__ import annotations

import contextlib
import lzma
import stat
import zipfile
import zlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import IO, Final

from pdrbench.errors import RecordingError
from pdrbench.io.compressed import (
    ENDINGS,
    MAX_CONTENT_BYTES,
    MAX_RATIO,
    MIN_BOMB_BYTES,
    content_of,
    found_file,
    plain_name,
)

MAX_MEMBERS: Final = 10_000
MAX_NAME_BYTES: Final = 255  # of a file, as operating systems have it
MAX_DEPTH: Final = 4  # folders below folders: RoNIN and EuRoC have three
MAX_TOTAL_BYTES: Final = 16 << 30
ZIP_MAGIC: Final = b"PK\x03\x04"
ARCHIVES: Final = (".zip", ".7z", ".rar", ".tar", ".tgz", ".tar.gz", ".tar.xz", ".tar.bz2")
DAMAGED: Final = (  # what reading an archive raises that no program has written, or one that needs a password
    *(OSError, EOFError, KeyError, ValueError, RuntimeError, zipfile.BadZipFile, zlib.error, lzma.LZMAError),
)
_ENCRYPTED = 0x1


@dataclass(frozen=True, slots=True)
class Container:
    """What lies in a folder or archive; of a plain file, itself.

    Attributes:
        path: Of the folder, archive or file.
        sizes: Bytes by member name, with forward slashes; a folder that holds everything is left out, and so is what
            compressing a member added to its name: `read` decompresses it.
        prefix: That folder, or "".
        is_zip: True for a zip archive.
    """

    path: Path
    sizes: Mapping[str, int]
    prefix: str
    is_zip: bool

    def names(self, suffix: str = "") -> list[str]:
        """Names of members that end so, capitals or not."""
        return [name for name in self.sizes if name.lower().endswith(suffix)]

    @property
    def is_file(self) -> bool:
        """True for a plain or compressed file, which has one member, itself."""
        return not self.is_zip and self.path.is_file()

    def label(self, name: str) -> Path:
        """How errors name a member."""
        return self.path if self.is_file else self.path / name

    def read(self, name: str, limit: int | None = None) -> bytes:
        """The content of a member, or its first `limit` bytes.

        Raises:
            RecordingError: It is missing, damaged, or too large to be read at once.
        """
        if limit is None and self.sizes.get(name, 0) > MAX_CONTENT_BYTES:
            raise RecordingError(
                f"{self.label(name)}: {self.sizes[name] / 2**30:.1f} GiB, expected at most {MAX_CONTENT_BYTES >> 30}; "
                f"split it into walks"
            )
        try:
            with self._open(name) as stream:
                return content_of(stream, self.label(name), limit)
        except DAMAGED as error:
            raise RecordingError(f"{self.label(name)}: cannot be read: {error}; copy or export it again") from error

    @contextlib.contextmanager
    def _open(self, name: str) -> Iterator[IO[bytes]]:
        """The stream of a member under its own name, or under that of a compressed file."""
        names = [f"{self.prefix}{name}{ending}" for ending in ("", *ENDINGS)]
        if self.is_zip:
            with zipfile.ZipFile(self.path) as archive:
                stored = {member.filename.replace("\\", "/"): member for member in archive.infolist()}
                known = next((name for name in names if name in stored), names[0])
                with archive.open(stored[known]) as stream:
                    yield stream
            return
        with (self.path if self.is_file else found_file(self.path / names[0])).open("rb") as file:
            yield file


def open_container(path: Path) -> Container:
    """What a file, folder or zip archive holds.

    Hidden files and what macOS adds to archives are left out.

    Raises:
        RecordingError: It cannot be read, or an archive is damaged, protected by a password, too large when unpacked,
            or has members outside itself.
    """
    path = Path(path)
    try:
        if path.is_dir():
            return _container(path, _folder_sizes(path), is_zip=False)
        with path.open("rb") as file:
            is_zip = file.read(4) == ZIP_MAGIC
        size = path.stat().st_size
    except OSError as error:
        reason = error.strerror or type(error).__name__
        raise RecordingError(f"{path}: cannot be read: {reason}; check the path and its permissions") from error
    if not is_zip:
        return Container(path, {plain_name(path.name): size}, "", is_zip=False)
    return _container(path, _zip_sizes(path), is_zip=True)


def _container(path: Path, sizes: dict[str, int], *, is_zip: bool) -> Container:
    parts = [PurePosixPath(name).parts for name in sizes]
    depth = 0
    while parts and all(len(p) > depth + 1 and p[depth] == parts[0][depth] for p in parts):
        depth += 1
    prefix = "".join(f"{part}/" for part in parts[0][:depth]) if parts else ""
    inside = {name.removeprefix(prefix): size for name, size in sizes.items()}
    plain = {name if plain_name(name) in inside else plain_name(name): size for name, size in inside.items()}
    return Container(path, plain, prefix, is_zip)


def _is_hidden(name: str) -> bool:
    return any(part.startswith(".") or part == "__MACOSX" for part in PurePosixPath(name).parts)


def _folder_sizes(path: Path) -> dict[str, int]:
    sizes: dict[str, int] = {}
    waiting = [(path, 0)]
    while waiting:
        folder, depth = waiting.pop()
        try:
            entries = sorted(folder.iterdir())
        except OSError as error:
            raise RecordingError(f"{folder}: cannot be read: {error.strerror}; check its permissions") from error
        for entry in entries:
            name = entry.relative_to(path).as_posix()
            if _is_hidden(name):
                continue
            if entry.is_file():
                sizes[name] = entry.stat().st_size
            elif entry.is_dir() and not entry.is_symlink() and depth < MAX_DEPTH:
                waiting.append((entry, depth + 1))
            if len(sizes) > MAX_MEMBERS:
                raise RecordingError(f"{path}: more than {MAX_MEMBERS} files; name the folder of one recording")
    return sizes


def _zip_sizes(path: Path) -> dict[str, int]:
    try:
        with zipfile.ZipFile(path) as archive:
            members = archive.infolist()
    except DAMAGED as error:
        raise RecordingError(f"{path}: the archive is damaged ({error}); export it again") from error
    if len(members) > MAX_MEMBERS:
        raise RecordingError(f"{path}: more than {MAX_MEMBERS} members; unpack it and name the folder of one recording")
    total, packed = sum(m.file_size for m in members), sum(m.compress_size for m in members)
    if total > MAX_TOTAL_BYTES or (total > MIN_BOMB_BYTES and total > MAX_RATIO * max(packed, 1)):
        raise RecordingError(
            f"{path}: {packed} bytes unpack to {total}; that is no recording but a zip bomb: do not open it"
        )
    sizes: dict[str, int] = {}
    for member in members:
        name = member.filename.replace("\\", "/")  # as PowerShell 5 and .NET before 4.6.1 write it
        if name.endswith("/"):
            continue
        parts = PurePosixPath(name).parts
        if not parts or name.startswith("/") or ".." in parts or ":" in parts[0]:
            raise RecordingError(f"{path}: member {name!r} lies outside the archive; do not unpack it")
        if max(len(part.encode(errors="replace")) for part in parts) > MAX_NAME_BYTES:
            raise RecordingError(f"{path}: a member is named {name[:40]!r} and so on; pack it under a shorter name")
        if stat.S_ISLNK(member.external_attr >> 16):
            raise RecordingError(f"{path}: member {name!r} is a link; pack the file itself")
        if member.flag_bits & _ENCRYPTED:
            raise RecordingError(f"{path}: {name!r} is protected by a password; unpack it and name the folder")
        if _is_hidden(name):
            continue
        if name in sizes:
            raise RecordingError(f"{path}: member {name!r} stands twice; export the recording again")
        sizes[name] = member.file_size
    if sizes and all(name.lower().endswith(ARCHIVES) for name in sizes):
        raise RecordingError(f"{path}: holds other archives ({', '.join(list(sizes)[:3])}); unpack it first")
    return sizes
