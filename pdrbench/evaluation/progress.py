"""Shows how far a run is: bars on a terminal, plain lines with counts elsewhere. Always on stderr."""

from __future__ import annotations

import contextlib
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Final

from pdrbench.errors import plain_text
from pdrbench.result import FAILED, UNSUITABLE

LINE_EVERY_S: Final = 5.0

Advance = Callable[[str, str], None]  # given the status of a job and what it is called


def reporting(
    total: int, done: int, *, shown: bool, what: str = "walks", expected_s: float = 0.0
) -> contextlib.AbstractContextManager[Advance]:
    """Gives the function to call with status and name of each finished job; `done` of them were stored before."""
    if not shown:
        return contextlib.nullcontext(lambda status, label: None)
    if expected_s:
        sys.stderr.write(f"{total - done} {what}, {_duration(expected_s)}\n")
    return (_bar if sys.stderr.isatty() else _lines)(total, done, what)


@contextlib.contextmanager
def _bar(total: int, done: int, what: str) -> Iterator[Advance]:
    from rich import console, progress, table

    columns = (
        progress.BarColumn(20),
        progress.MofNCompleteColumn(),
        progress.TimeRemainingColumn(),
        progress.TextColumn("{task.description}", markup=False, table_column=table.Column(no_wrap=True)),
    )
    with progress.Progress(*columns, console=console.Console(stderr=True)) as bar:
        task = bar.add_task(what, total=total, completed=done)
        counts: Counter[str] = Counter()

        def advance(status: str, label: str) -> None:
            counts[status] += 1
            bar.update(task, advance=1, description=plain_text(f"{what}{_not_complete(counts)}: {label}"))

        yield advance


@contextlib.contextmanager
def _lines(total: int, done: int, what: str) -> Iterator[Advance]:
    counts: Counter[str] = Counter()
    last_s = time.monotonic()

    def show(label: str = "") -> None:
        finished = done + sum(counts.values())
        text = f"{finished}/{total} {what}{_not_complete(counts)}{': ' if label else ''}{label}"
        print(plain_text(text), file=sys.stderr, flush=True)  # noqa: T201

    def advance(status: str, label: str) -> None:
        nonlocal last_s
        counts[status] += 1
        if time.monotonic() - last_s >= LINE_EVERY_S:
            last_s = time.monotonic()
            show(label)

    show()
    try:
        yield advance
    finally:
        if counts:
            show()


def _not_complete(counts: Counter[str]) -> str:
    return "".join(f", {counts[status]} {status}" for status in (FAILED, UNSUITABLE) if counts[status])


def _duration(seconds: float) -> str:
    """As "about 40 s"; minutes and hours from two of them on."""
    unit_s, name = (3600.0, "h") if seconds >= 7200.0 else (60.0, "min") if seconds >= 120.0 else (1.0, "s")
    return f"about {max(1, round(seconds / unit_s))} {name}"
