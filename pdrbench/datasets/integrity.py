"""Whether the files of a dataset are what was registered."""

from __future__ import annotations

import gzip
import hashlib
import lzma
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from pdrbench.datasets.catalogue import DataFile, Dataset
from pdrbench.datasets.catalogue import dataset as registered
from pdrbench.datasets.folders import find
from pdrbench.errors import DatasetError
from pdrbench.files import sha256_of

PARTIAL_FOLDER = ".partial"  # holds what a fetch has not finished
XZ_MAGIC = b"\xfd7zXZ\0"
_CHUNK_BYTES = 1 << 20

Kind = Literal["missing", "differs", "extra", "recompressed"]


@dataclass(frozen=True, slots=True)
class Problem:
    """One way in which a folder is not the registered set.

    Attributes:
        path: Relative to the folder of the set.
        kind: "missing"; "differs"; "extra" (not registered); "recompressed" (the content is the registered one, its
            gzip or xz wrapping is another).
        why: One sentence.
    """

    path: str
    kind: Kind
    why: str

    @property
    def is_harmless(self) -> bool:
        """True where nothing that is read differs from what was registered."""
        return self.kind in ("extra", "recompressed")


def verify(name: str, path: Path | str | None = None) -> list[Problem]:
    """Compares every file of a dataset with its registered sha256.

    Args:
        name: Registered dataset.
        path: Folder of the set; without it the one that `find` finds.

    Returns:
        Everything that is missing, differs, or is not registered; empty where the folder is the registered set.
    """
    sought = registered(name)
    folder = find(name) if path is None else Path(path)
    if not folder.is_dir():
        raise DatasetError(f"{folder} is not a folder; give the folder of {name!r}")
    if not sought.files:
        return []
    return list(_verify_content(sought, folder) if sought.by_content else _verify_paths(sought, folder))


def difference(file: DataFile, path: Path) -> Problem | None:
    """How the file at `path` differs from the registered one; None where it does not."""
    if not path.is_file():
        return Problem(file.path, "missing", f"{file.bytes} bytes are missing")
    found = sha256_of(path)
    if found == file.sha256:
        return None
    if file.content_sha256 and sha256_of_content(path) == file.content_sha256:
        return Problem(file.path, "recompressed", "same content as registered, compressed by another library")
    return Problem(file.path, "differs", f"sha256 {file.sha256[:12]}... was expected, {found[:12]}... came")


def sha256_of_content(path: Path) -> str:
    """sha256 of what a gzip or xz file holds, hexadecimal; "" where it is no whole file of either."""
    digest = hashlib.sha256()
    with path.open("rb") as stream:
        is_xz = stream.read(len(XZ_MAGIC)) == XZ_MAGIC
    try:
        with lzma.open(path) if is_xz else gzip.open(path) as stream:
            while chunk := stream.read(_CHUNK_BYTES):
                digest.update(chunk)
    except (gzip.BadGzipFile, EOFError, zlib.error, lzma.LZMAError):
        return ""
    return digest.hexdigest()


def files_in(folder: Path) -> Iterator[str]:
    """Every file below `folder`, relative to it, in order; what a fetch has not finished is left out."""
    for path in sorted(folder.rglob("*")):
        relative = path.relative_to(folder)
        if path.is_file() and relative.parts[0] != PARTIAL_FOLDER:
            yield relative.as_posix()


def _verify_paths(sought: Dataset, folder: Path) -> Iterator[Problem]:
    for file in sought.files:
        problem = difference(file, folder / file.path)
        if problem is not None and (file.is_required or problem.kind != "missing"):
            yield problem
    known = {file.path for file in sought.files}
    for path in files_in(folder):
        if path not in known:
            yield Problem(path, "extra", "not registered")


def _verify_content(sought: Dataset, folder: Path) -> Iterator[Problem]:
    """The same for a set whose own names are not registered: by hash, wherever a file lies."""
    seen = set()
    for path in files_in(folder):
        file, is_recompressed = registered_file(sought, folder / path)
        if file is None:
            yield Problem(path, "extra", "no registered file has its hash")
            continue
        seen.add(file.sha256)
        if is_recompressed:
            yield Problem(path, "recompressed", "same content as registered, compressed by another library")
    for file in sought.files:
        if file.is_required and file.sha256 not in seen:
            yield Problem(file.path, "missing", f"no file has sha256 {file.sha256[:12]}...")


def registered_file(sought: Dataset, path: Path) -> tuple[DataFile | None, bool]:
    """The registered file with the hash of the one at `path`, or else with its content, True, where it is packed."""
    found = sha256_of(path)
    file = next((file for file in sought.files if file.sha256 == found), None)
    if file is None and (content := sha256_of_content(path)):
        file = next((file for file in sought.files if file.content_sha256 == content), None)
        return file, True
    return file, False
