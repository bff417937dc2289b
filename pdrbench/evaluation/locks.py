"""Which process computes which result: locks that end with their process, and a note of its present job.

One byte of one file stands for each result, so a lock costs no file of its own.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Final

from pdrbench.errors import ResultError
from pdrbench.evaluation.store import TEMPORARY_SUFFIX
from pdrbench.files import lock, try_lock, unlock

LOCKS_FILE: Final = ".locks"
NOTE_PREFIX: Final = ".working-"
MAX_NOTE_BYTES: Final = 16_384


class ResultLocks:
    """The locks of this process on the results of one folder; the names of its notes hold the id of the run."""

    def __init__(self, folder: Path, run: str) -> None:
        self._locks = (folder / LOCKS_FILE).open("a+b", buffering=0)
        self._note = (folder / f"{NOTE_PREFIX}{run}-{os.getpid()}").open("w+b", buffering=0)
        lock(self._note)

    def close(self) -> None:
        """Gives up every lock."""
        self._locks.close()
        self._note.close()

    @contextlib.contextmanager
    def hold(self, name: str) -> Iterator[IO[bytes] | None]:
        """Holds the lock on the result file `name`; None where another living process holds it.

        Yields the note of this process. What is written to it outlives the process, for `crashed_workers` to read.

        Raises:
            ResultError: The disk is full.
        """
        if not try_lock(self._locks, _lock_offset(name)):
            yield None
            return
        try:
            self._note.seek(0)
            try:
                self._note.write(name.encode() + b"\n")
            except OSError as error:
                raise ResultError(
                    f"cannot write {self._note.name}: {error.strerror or error}; "
                    f"mend that and run the same command again: what is stored already is kept"
                ) from error
            yield self._note
        finally:
            self._note.truncate(0)
            unlock(self._locks, _lock_offset(name))

    def is_free(self, name: str) -> bool:
        """True where no other process holds the lock."""
        if not try_lock(self._locks, _lock_offset(name)):
            return False
        unlock(self._locks, _lock_offset(name))
        return True


@functools.lru_cache(maxsize=1)
def result_locks(folder: Path, run: str) -> ResultLocks:
    """The locks of this process in a run; those of the run before are closed."""
    return ResultLocks(folder, run)


def crashed_workers(folder: Path, run: str) -> dict[str, str]:
    """What processes of a run left in their notes when they died over a result, by its name."""
    found = {}
    for path in folder.glob(f"{NOTE_PREFIX}{run}-*"):
        note = None if path.name.endswith(f"-{os.getpid()}") else _take_over(path)
        name, _, report = (note or "").partition("\n")
        if name:
            found[name] = report
    return found


@contextlib.contextmanager
def cleanup(folder: Path, run: str) -> Iterator[None]:
    """Removes what dead processes left in a folder of results, before the run inside and after it.

    Raises:
        ResultError: The folder cannot be written.
    """
    try:
        own = result_locks(folder, run)
    except OSError as error:
        raise ResultError(f"cannot write to the folder {folder}: {error.strerror or error}") from error
    _remove_leftovers(folder, own)
    try:
        yield
    finally:
        _remove_leftovers(folder, own)
        result_locks.cache_clear()
        own.close()
        for path in folder.glob(f"{NOTE_PREFIX}{run}-*"):
            with contextlib.suppress(PermissionError):  # Windows, where a worker has it open: a later run removes it
                path.unlink(missing_ok=True)


def _remove_leftovers(folder: Path, own: ResultLocks) -> None:
    """Removes the leftovers of dead processes; those of living ones stay."""
    for path in folder.glob(f"{NOTE_PREFIX}*"):
        if not path.name.endswith(f"-{os.getpid()}"):
            _take_over(path)
    for path in folder.glob(f".*{TEMPORARY_SUFFIX}"):
        if own.is_free(path.name[1:].removesuffix(TEMPORARY_SUFFIX).rpartition(".")[0]):
            path.unlink(missing_ok=True)


def _take_over(path: Path) -> str | None:
    """The text of a dead process's note, which is removed; None where the process lives."""
    try:
        note = path.open("r+b", buffering=0)
    except FileNotFoundError:
        return None
    with note:
        if not try_lock(note, 0):
            return None
        text = note.read(MAX_NOTE_BYTES).decode(errors="replace")
        note.truncate(0)  # no other process takes it over as well
    with contextlib.suppress(PermissionError):  # Windows, where another process looks at it
        path.unlink(missing_ok=True)
    return text


def _lock_offset(name: str) -> int:
    """The byte that stands for a result: 56 bits of a digest, so that no two results share one."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:7])
