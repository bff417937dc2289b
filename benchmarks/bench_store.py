"""Where results go: a file each, as `evaluate` stores them, against rows of SQLite and parts of Parquet, side by side.

Every store takes the same results of 200 answers, written by two processes, each result as soon as it is there; listing
asks which are done, reading decodes all of them, and a writer is killed on the way to see what is left. "Durable" waits
until the disk has each result, as `evaluate` does.

    python benchmarks/bench_store.py [NUMBER]
"""

from __future__ import annotations

import importlib.util
import multiprocessing
import os
import signal
import sqlite3
import sys
import tempfile
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar

import numpy as np

from pdrbench.evaluation import store
from pdrbench.files import sync
from pdrbench.result import Result
from pdrbench.trajectory import ESTIMATE_COLUMNS, Estimates

T = TypeVar("T")
ROWS, WRITERS, PER_PART, FULL = 200, 2, 1000, 200_000


def content_of(number: int) -> tuple[str, bytes]:
    """Name and bytes of a result, as stored."""
    rng = np.random.default_rng(number)
    columns = rng.normal(size=(len(ESTIMATE_COLUMNS), ROWS))
    walk = f"walk-{number:06d}"
    key = store.result_key({"walk": walk})
    result = Result(
        env="Bench-v0",
        split="test",
        walk=walk,
        localizer="bench-v0",
        seed=0,
        estimates=Estimates.from_columns(np.arange(ROWS) * 1.0, columns),
        step_s=np.full(ROWS, 1e-3),
        provenance={"key": key},
    )
    return store.result_name("Bench-v0", "bench-v0", walk, 0, key), store.encode(result)


class Store(ABC):
    """Results by name."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @abstractmethod
    def put(self, name: str, content: bytes) -> None:
        """Stores one result."""

    @abstractmethod
    def close(self) -> None:
        """Stores what still waits."""

    @abstractmethod
    def names(self) -> set[str]:
        """Those that are stored."""

    @abstractmethod
    def contents(self) -> list[bytes]:
        """All of them."""


class Files(Store):
    """A file each: what `evaluate` does."""

    def put(self, name: str, content: bytes) -> None:
        store.write_whole(self.folder / name, content)

    def close(self) -> None:
        sync(self.folder)

    def names(self) -> set[str]:
        return {entry.name for entry in os.scandir(self.folder) if entry.name.endswith(store.SUFFIX)}

    def contents(self) -> list[bytes]:
        return [(self.folder / name).read_bytes() for name in sorted(self.names())]


class Sqlite(Store):
    """A row each in one file, with a log that is written ahead; `synchronous` FULL waits for the disk."""

    synchronous = "FULL"

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._data = sqlite3.connect(folder / "results.sqlite", timeout=60.0, isolation_level=None)
        self._data.execute("PRAGMA journal_mode=WAL")
        self._data.execute(f"PRAGMA synchronous={self.synchronous}")
        self._data.execute("CREATE TABLE IF NOT EXISTS result (name TEXT PRIMARY KEY, content BLOB)")

    def put(self, name: str, content: bytes) -> None:
        self._data.execute("INSERT OR REPLACE INTO result VALUES (?, ?)", (name, content))

    def close(self) -> None:
        self._data.close()

    def names(self) -> set[str]:
        return {name for (name,) in self._data.execute("SELECT name FROM result")}

    def contents(self) -> list[bytes]:
        return [content for (content,) in self._data.execute("SELECT content FROM result ORDER BY name")]


class SqliteLate(Sqlite):
    """The same without waiting for the disk: a power cut takes back the last results."""

    synchronous = "NORMAL"


class Parquet(Store):
    """Parts of a thousand results: what a part still gathers is lost with its writer."""

    def __init__(self, folder: Path) -> None:
        super().__init__(folder)
        self._rows: list[tuple[str, bytes]] = []

    def put(self, name: str, content: bytes) -> None:
        self._rows.append((name, content))
        if len(self._rows) == PER_PART:
            self.close()

    def close(self) -> None:
        import pyarrow
        from pyarrow import parquet

        if self._rows:
            names, contents = zip(*self._rows, strict=True)
            table = pyarrow.table({"name": names, "content": contents})
            parquet.write_table(table, self.folder / f"{names[0]}.tmp")
            (self.folder / f"{names[0]}.tmp").rename(self.folder / f"{names[0]}.parquet")
            self._rows = []

    def names(self) -> set[str]:
        from pyarrow import parquet

        parts = sorted(self.folder.glob("*.parquet"))
        return {name for part in parts for name in parquet.read_table(part, columns=["name"])["name"].to_pylist()}

    def contents(self) -> list[bytes]:
        from pyarrow import parquet

        parts = sorted(self.folder.glob("*.parquet"))
        return [one for part in parts for one in parquet.read_table(part, columns=["content"])["content"].to_pylist()]


def write(
    kind: type[Store], folder: Path, first: int, count: int, used_s: multiprocessing.Queue[tuple[float, float]]
) -> None:
    """Every second result from `first` on; what making them takes is not counted."""
    made = [content_of(number) for number in range(first, first + WRITERS * count, WRITERS)]
    began_s, wall_s = time.process_time(), time.perf_counter()
    to = kind(folder)
    for name, content in made:
        to.put(name, content)
    to.close()
    used_s.put((time.process_time() - began_s, time.perf_counter() - wall_s))


def measure(kind: type[Store], number: int, root: Path) -> str:
    """A row of the table."""
    folder = root / kind.__name__
    folder.mkdir()
    used_s: multiprocessing.Queue[tuple[float, float]] = multiprocessing.Queue()
    kind(folder)
    half = number // WRITERS
    writers = [multiprocessing.Process(target=write, args=(kind, folder, k, half, used_s)) for k in range(WRITERS)]
    for writer in writers:
        writer.start()
    used = [used_s.get() for _ in writers]
    written_s, waited_s = sum(cpu_s for cpu_s, _ in used), max(wall_s for _, wall_s in used)
    for writer in writers:
        writer.join()
    listed_s, names = timed(lambda: kind(folder).names())
    read_s, contents = timed(lambda: kind(folder).contents())
    decoded_s, _ = timed(lambda: [store.decode(content, "") for content in contents])
    assert len(names) == len(contents) == WRITERS * half, "a result is missing"
    size = sum(file.stat().st_size for file in folder.iterdir()) / sum(map(len, contents))
    left = killed(kind, root)
    each = [1e6 * seconds / number for seconds in (waited_s, written_s, listed_s, read_s, decoded_s)]
    full = (listed_s + read_s + decoded_s) * FULL / number
    return f"{kind.__name__:>10} " + " ".join(f"{one:9.1f}" for one in each) + f" {full:9.0f} s {size:6.2f} {left:8.0%}"


def killed(kind: type[Store], root: Path) -> float:
    """Fraction of the results stored by a writer that are there when it was killed, all of them whole."""
    folder = root / f"{kind.__name__}-killed"
    folder.mkdir()
    kind(folder)
    reading, writing = os.pipe()
    child = os.fork()
    if not child:
        to = kind(folder)
        for number in range(10**6):
            to.put(*content_of(number))
            os.write(writing, b".")
    stored = 0
    while stored < PER_PART * 3 // 2:
        stored += len(os.read(reading, 64))
    os.kill(child, signal.SIGKILL)
    os.waitpid(child, 0)
    os.close(writing)
    while more := os.read(reading, 4096):
        stored += len(more)
    for content in kind(folder).contents():
        store.decode(content, "")  # raises where it is torn
    return min(len(kind(folder).names()) / stored, 1.0)


def timed(call: Callable[[], T]) -> tuple[float, T]:
    """Processor seconds of a call, and what it returned."""
    began_s = time.process_time()
    returned = call()
    return time.process_time() - began_s, returned


def main() -> None:
    number = int(sys.argv[1]) if sys.argv[1:] else 20_000
    kinds: list[type[Store]] = [Files, Sqlite, SqliteLate]
    if importlib.util.find_spec("pyarrow") is not None:
        kinds.append(Parquet)
    else:
        print("no Parquet: pip install pyarrow", file=sys.stderr)
    print(f"{number} results of {len(content_of(0)[1]) / 1024:.0f} kB; us a result, processor time but for the wait")
    heads = ("wait", "write", "list", "read", "decode")
    print(f"{'':>10} {' '.join(f'{head:>9}' for head in heads)} {f'of {FULL}':>11} {'size':>6} {'killed':>8}")
    with tempfile.TemporaryDirectory(dir=Path.cwd()) as root:
        for kind in kinds:
            print(measure(kind, number, Path(root)), flush=True)


if __name__ == "__main__":
    main()
