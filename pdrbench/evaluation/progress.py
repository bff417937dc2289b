"""Shows how far a run is: bars on a terminal, plain lines with counts elsewhere. Always on stderr."""

from __future__ import annotations

import contextlib
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Final

from pdrbench.result import FAILED, UNSUITABLE

LINE_EVERY_S: Final = 5.0

Advance = Callable[[str], None]


@contextlib.contextmanager
def reporting(total: int, done: int, *, shown: bool, what: str = "walks") -> Iterator[Advance]:
    """Gives the function to call with the status of every job that is finished; `done` of them were stored before."""
    if not shown:
        yield lambda status: None
    elif sys.stderr.isatty():
        with _bar(total, done, what) as advance:
            yield advance
    else:
        with _lines(total, done, what) as advance:
            yield advance


@contextlib.contextmanager
def _bar(total: int, done: int, what: str) -> Iterator[Advance]:
    from rich import console, progress

    columns = (
        progress.TextColumn(what),
        progress.BarColumn(),
        progress.MofNCompleteColumn(),
        progress.TimeElapsedColumn(),
        progress.TimeRemainingColumn(),
        progress.TextColumn("{task.description}"),
    )
    with progress.Progress(*columns, console=console.Console(stderr=True)) as bar:
        task = bar.add_task("", total=total, completed=done)
        counts: Counter[str] = Counter()

        def advance(status: str) -> None:
            counts[status] += 1
            bar.update(task, advance=1, description=_not_complete(counts))

        yield advance


@contextlib.contextmanager
def _lines(total: int, done: int, what: str) -> Iterator[Advance]:
    counts: Counter[str] = Counter()
    last_s = time.monotonic()

    def show() -> None:
        finished = done + sum(counts.values())
        rest = _not_complete(counts)
        print(f"{finished}/{total} {what}{', ' if rest else ''}{rest}", file=sys.stderr, flush=True)  # noqa: T201

    def advance(status: str) -> None:
        nonlocal last_s
        counts[status] += 1
        if time.monotonic() - last_s >= LINE_EVERY_S:
            last_s = time.monotonic()
            show()

    show()
    try:
        yield advance
    finally:
        if counts:
            show()


def _not_complete(counts: Counter[str]) -> str:
    return ", ".join(f"{counts[status]} {status}" for status in (FAILED, UNSUITABLE) if counts[status])
