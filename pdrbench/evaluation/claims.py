"""Who computes what: record locks that vanish with their process, and a note of what each process has in hand.

Record locks (`fcntl.lockf`) belong to a process, end with it however it ends, and are not inherited by its children.
One byte of one file stands for each result, so a claim costs no file of its own.
"""

from __future__ import annotations

import contextlib
import fcntl
import functools
import hashlib
import os
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Final

from pdrbench.errors import ResultError
from pdrbench.evaluation.store import TEMPORARY_SUFFIX

LOCKS: Final = ".locks"
NOTE_PREFIX: Final = ".working-"
MOST_NOTE_BYTES: Final = 16_384


class Ledger:
    """The claims of this process on the results of one folder.

    Args:
        folder: Of results.
        sweep: Id of the sweep; its notes are told from those of others by it.
    """

    def __init__(self, folder: Path, sweep: str) -> None:
        self._locks = (folder / LOCKS).open("a+b", buffering=0)
        self._note = (folder / f"{NOTE_PREFIX}{sweep}-{os.getpid()}").open("w+b", buffering=0)
        fcntl.lockf(self._note, fcntl.LOCK_EX)

    @contextlib.contextmanager
    def claim(self, name: str) -> Iterator[IO[bytes] | None]:
        """Holds the claim on the result file `name`; None where another living process holds it.

        Yields the note that says so. What is written to it stays behind when the process dies, for `fallen` to read.

        Raises:
            ResultError: The disk is full.
        """
        if not _try_lock(self._locks, name):
            yield None
            return
        try:
            self._take_down(name)
            yield self._note
        finally:
            self._note.truncate(0)
            fcntl.lockf(self._locks, fcntl.LOCK_UN, 1, _place(name))

    def _take_down(self, name: str) -> None:
        self._note.seek(0)
        try:
            self._note.write(name.encode() + b"\n")
        except OSError as error:
            raise ResultError(
                f"cannot write {self._note.name}: {error.strerror or error}; "
                f"mend that and run the same command again: what is stored already is kept"
            ) from error

    def is_free(self, name: str) -> bool:
        """True where no other process holds the claim."""
        if not _try_lock(self._locks, name):
            return False
        fcntl.lockf(self._locks, fcntl.LOCK_UN, 1, _place(name))
        return True


@functools.lru_cache(maxsize=1)
def ledger(folder: Path, sweep: str) -> Ledger:
    """This process's ledger of a sweep; the one of the sweep before is closed."""
    return Ledger(folder, sweep)


def fallen(folder: Path, sweep: str) -> dict[str, str]:
    """What processes of a sweep left in their notes when they died over a result, by its name."""
    found = {}
    for path in folder.glob(f"{NOTE_PREFIX}{sweep}-*"):
        note = None if path.name.endswith(f"-{os.getpid()}") else _take_over(path)
        if note is not None:
            name, _, report = note.partition("\n")
            if name:
                found[name] = report
    return found


@contextlib.contextmanager
def order(folder: Path, sweep: str) -> Iterator[None]:
    """Leftovers of dead processes are removed from a folder of results before, and whatever came to be meanwhile after.

    Raises:
        ResultError: The folder cannot be written.
    """
    try:
        own = ledger(folder, sweep)
    except OSError as error:
        raise ResultError(f"cannot write to the folder {folder}: {error.strerror or error}") from error
    clean(folder, own)
    try:
        yield
    finally:
        clean(folder, own)
        close(folder, sweep)


def clean(folder: Path, own: Ledger) -> None:
    """Removes the leftovers of dead processes from a folder of results; those of living ones stay."""
    for path in folder.glob(f"{NOTE_PREFIX}*"):
        if not path.name.endswith(f"-{os.getpid()}"):
            _take_over(path)
    for path in folder.glob(f".*{TEMPORARY_SUFFIX}"):
        if own.is_free(path.name[1:].removesuffix(TEMPORARY_SUFFIX).rpartition(".")[0]):
            path.unlink(missing_ok=True)


def close(folder: Path, sweep: str) -> None:
    """Removes the notes of a sweep that is over."""
    ledger.cache_clear()
    for path in folder.glob(f"{NOTE_PREFIX}{sweep}-*"):
        path.unlink(missing_ok=True)


def _take_over(path: Path) -> str | None:
    """The text of a dead process's note, which is removed; None where the process lives."""
    try:
        note = path.open("r+b", buffering=0)
    except FileNotFoundError:
        return None
    with note:
        try:
            fcntl.lockf(note, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except (BlockingIOError, PermissionError):  # POSIX allows EAGAIN and EACCES for a lock that is held
            return None
        path.unlink(missing_ok=True)
        return note.read(MOST_NOTE_BYTES).decode(errors="replace")


def _try_lock(locks: IO[bytes], name: str) -> bool:
    try:
        fcntl.lockf(locks, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, _place(name))
    except (BlockingIOError, PermissionError):
        return False
    return True


def _place(name: str) -> int:
    """The byte that stands for a result: 56 bits of a digest, so that no two results share one."""
    return int.from_bytes(hashlib.sha256(name.encode()).digest()[:7])
