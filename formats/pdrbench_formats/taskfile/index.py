"""What was found out about the files of a task, kept in the cache folder, so that none is read to open it again."""

from __future__ import annotations

import base64
import functools
import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, TypeVar

import msgspec
import numpy as np

from pdrbench.datasets.folders import cache_folder
from pdrbench.evaluation.origin import package_sha256
from pdrbench.evaluation.store import keep_whole
from pdrbench.io import READERS

FOLDER: Final = "tasks"  # in the cache folder
Facts = TypeVar("Facts")


class _Entry(msgspec.Struct, frozen=True):
    key: str  # of everything that the facts follow from
    facts: msgspec.Raw


class Index:
    """Facts by name, found out anew where what they follow from has changed.

    Args:
        path: Of the task file.
    """

    def __init__(self, path: Path) -> None:
        name = hashlib.sha256(str(path.absolute()).encode()).hexdigest()[:32]
        self._file = cache_folder() / FOLDER / f"{name}.json"
        self._known, self._asked = _entries(self._file), dict[str, _Entry]()

    def facts(self, name: str, kind: type[Facts], causes: object, find: Callable[[], Facts]) -> Facts:
        """Facts of one file.

        Args:
            name: Under which they are kept.
            kind: Type of the facts: what msgspec writes as JSON, with arrays in it.
            causes: Everything that they follow from besides the code, such as the stamp of the file, as JSON or `str`
                writes it.
            find: Reads the file.
        """
        key = hashlib.sha256(msgspec.json.encode((_code_sha256(), causes), enc_hook=str)).hexdigest()
        entry = self._asked.get(name) or self._known.get(name)
        if entry is None or entry.key != key:
            entry = _Entry(key, msgspec.Raw(msgspec.json.encode(find(), enc_hook=_stored)))
        self._asked[name] = entry
        return msgspec.json.decode(entry.facts, type=kind, dec_hook=_restored)

    def save(self) -> None:
        """Keeps what was asked for."""
        if self._asked != self._known:
            keep_whole(self._file, msgspec.json.encode(self._asked))


def _stored(array: Any) -> tuple[str, tuple[int, ...], bytes]:
    """An array as JSON holds it: type of its numbers, shape, and the numbers, to the last bit."""
    return array.dtype.str, array.shape, array.tobytes()


def _restored(_: type, stored: tuple[str, tuple[int, ...], str]) -> Any:
    kind, shape, numbers = stored
    return np.frombuffer(base64.b64decode(numbers), kind).reshape(shape)


def _entries(file: Path) -> dict[str, _Entry]:
    try:
        return msgspec.json.decode(file.read_bytes(), type=dict[str, _Entry])
    except (OSError, msgspec.DecodeError):
        return {}


@functools.cache
def _code_sha256() -> str:
    """Digest of pdrbench and of the packages of all readers."""
    packages = {"pdrbench", *(entry.target.partition(":")[0].partition(".")[0] for entry in READERS.entries().values())}
    return hashlib.sha256("\n".join(package_sha256(name) for name in sorted(packages)).encode()).hexdigest()
