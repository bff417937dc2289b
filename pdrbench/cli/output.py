"""Where words go: the answer to standard output, everything else to standard error."""

from __future__ import annotations

import contextlib
import json
import math
import os
import sys
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import typer

from pdrbench.errors import plain_line, plain_text

if TYPE_CHECKING:
    from rich.console import Console

LOG_WIDTH: Final = 160  # characters of a table line where no terminal says how wide it is
GAP: Final = 3  # characters between two columns
MIN_TEXT: Final = 30  # characters that a column of sentences has at least
MIN_CUT_TEXT: Final = 20  # where sentences are cut

AsJson = Annotated[bool, typer.Option("--json", help="Print JSON on standard output, and nothing else there.")]


def print_json(answer: object) -> None:
    """One JSON document on standard output; NaN and infinities, which JSON lacks, become null."""
    has_all = (sys.stdout.encoding or "").lower().startswith("utf")  # of Unicode; others get what JSON writes instead
    text = json.dumps(_plain(answer), indent=2, ensure_ascii=not has_all, allow_nan=False)
    # what a terminal would obey is written as JSON writes it
    signs = (sign if sign == "\n" or sign.isprintable() else json.dumps(sign)[1:-1] for sign in text)
    sys.stdout.write("".join(signs) + "\n")


def _plain(value: object) -> object:
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return str(value) if isinstance(value, Path) else value


def note(text: str) -> None:
    """A line for people beside the answer."""
    sys.stderr.write(plain_text(text) + "\n")
    sys.stderr.flush()


def say(text: object) -> None:
    """A line of the answer; names, paths and words of strangers in it do nothing to a terminal."""
    typer.echo(plain_text(str(text)))


def verdict(passed: bool, name: str, why: str, otherwise: str = "FAIL") -> str:
    """The line of one check."""
    return plain_line(f"{'pass' if passed else otherwise}  {name}{f': {why}' if why else ''}")


def console() -> Console:
    """A rich console on standard output that prints names as they are."""
    from rich.console import Console

    width = None if sys.stdout.isatty() or "COLUMNS" in os.environ else LOG_WIDTH
    return Console(file=sys.stdout, width=width, markup=False, highlight=False, emoji=False)


def print_table(
    head: Mapping[str, Mapping[str, Any]], rows: list[list[str]], title: str = "", dispensable: Sequence[str] = ()
) -> None:
    """A table for people that breaks no word: options of rich by column, then the cells.

    The last column is cut to what is left of a line where its overflow is an ellipsis. Where the table is too wide,
    columns are left out, in the order of `dispensable`, and a note says which; where it still is, each row becomes a
    paragraph.
    """
    from rich import box
    from rich.table import Table

    names, width = list(head), console().width
    needed = [_needed(name, head[name], [row[i] for row in rows]) for i, name in enumerate(names)]
    shown = list(range(len(names)))
    for name in filter(names.__contains__, dispensable):
        if sum(needed[i] for i in shown) <= width:
            break
        shown.remove(names.index(name))
    if sum(_needed(names[i], head[names[i]], [row[i] for row in rows], min_text=0) for i in shown) > width:
        _print_paragraphs([names[i] for i in shown], [[row[i] for i in shown] for row in rows], title, width)
    else:
        table = Table(box=box.SIMPLE_HEAD, pad_edge=False)
        for i in shown:
            table.add_column(names[i], **head[names[i]])
        is_cut = head[names[shown[-1]]].get("overflow") == "ellipsis"
        left = width - sum(needed[i] for i in shown[:-1]) - GAP if is_cut else None
        for row in rows:
            *cells, last = (plain_text(row[i]) for i in shown)
            table.add_row(*cells, last if left is None or len(last) <= left else f"{last[: left - 1].rstrip()}…")
        if title:
            console().print(title)
        console().print(table)
    if len(shown) < len(names):
        left_out = ", ".join(name.replace("\n", "") for i, name in enumerate(names) if i not in shown)
        note(f"left out, since the terminal is narrow: {left_out}; --json prints all")


def _needed(name: str, options: Mapping[str, Any], cells: Sequence[str], min_text: int = MIN_TEXT) -> int:
    """Characters that a column needs so that no word is broken, with the gap to the next; sentences have `min_text`."""
    if options.get("overflow") == "ellipsis":
        return GAP + min(min_text, MIN_CUT_TEXT)
    lines = [line for text in (name, *cells) for line in text.splitlines()]
    unbroken = lines if options.get("no_wrap") else [word for line in lines for word in line.split()]
    widest = max(map(len, unbroken), default=0)
    return GAP + (max(widest, min(min_text, max(map(len, lines), default=0))) if "ratio" in options else widest)


def _print_paragraphs(names: Sequence[str], rows: Iterable[Sequence[str]], title: str, width: int) -> None:
    for line in filter(None, [title]):
        say(textwrap.fill(line, width))
    for first, *rest in rows:
        say(textwrap.fill(" ".join(first.split()), width, break_long_words=False))
        for name, cell in zip(names[1:], rest, strict=True):
            text = f"    {name.replace(chr(10), '')}: {' '.join(cell.split())}"
            if cell:
                say(textwrap.fill(text, width, subsequent_indent="      ", break_long_words=False))


@contextlib.contextmanager
def answer_only(as_json: bool) -> Iterator[None]:
    """While it lasts and JSON is wanted, whatever a plug-in or a worker prints goes to standard error."""
    if not as_json:
        yield
        return
    sys.stdout.flush()
    saved = os.dup(1)
    try:
        os.dup2(2, 1)  # also for what is not written in Python, and for child processes
        with contextlib.redirect_stdout(sys.stderr):
            yield
    finally:
        os.dup2(saved, 1)
        os.close(saved)
