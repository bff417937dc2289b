"""`pdrbench bench` and `pdrbench warm-up`."""

from __future__ import annotations

import dataclasses
import inspect
import time
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pdrbench.cli.output import AsJson, answer_only, note, print_json, print_table
from pdrbench.registry import WARM_UPS_GROUP, entries, find_entry

if TYPE_CHECKING:
    from pdrbench_lab.speed.timing import Timing


def bench(
    what: Annotated[str | None, typer.Argument(metavar="WHAT", help="What to time; without it, what there is.")] = None,
    quick: Annotated[
        bool, typer.Option("--quick", help="A tenth of the size, fewer rounds: to see that it runs.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Time the hot code beside what one would use instead, in turns in one run."""
    from pdrbench_lab.speed.timing import BENCHES_GROUP

    if what is None:
        summaries = {name: _summary(found.load()) for name, found in entries(BENCHES_GROUP).items()}
        if as_json:
            return print_json({"items": [{"id": name, "summary": text} for name, text in summaries.items()]})
        return print_table(
            {"id": {"no_wrap": True}, "summary": {"ratio": 1}}, [[name, text] for name, text in summaries.items()]
        )
    entry = find_entry(BENCHES_GROUP, "bench", what)
    with answer_only(as_json):
        rows = entry.load()(quick, lambda doing: note(f"{what}: {doing}"))
    return print_timings(rows, as_json)


def _summary(function: Callable[..., Any]) -> str:
    """The first paragraph of the docstring of its module, on one line."""
    return (inspect.getdoc(inspect.getmodule(function)) or "").partition("\n\n")[0].replace("\n", " ")


def print_timings(rows: Sequence[Timing], as_json: bool) -> None:
    """Timings as a table, or as JSON."""
    if as_json:
        print_json({"results": [dataclasses.asdict(row) for row in rows]})
        return
    head = {"name": {}, "value": {"justify": "right"}, "unit": {}, "ratio": {"justify": "right"}, "against": {}}
    cells = [
        [row.name, f"{row.value:.4g}", row.unit, "" if row.ratio is None else f"{row.ratio:.3g} x", row.against]
        for row in rows
    ]
    print_table(head, cells)


def warm_up(as_json: AsJson = False) -> None:
    """Compile everything that is compiled on first use, so that no walk has to wait for it."""
    taken = {}
    with answer_only(as_json):
        for name, entry in entries(WARM_UPS_GROUP).items():
            began = time.perf_counter()
            entry.load()()
            taken[name] = time.perf_counter() - began
            note(f"{name}: {taken[name]:.1f} s")
    if as_json:
        print_json({"items": [{"id": name, "seconds": seconds} for name, seconds in taken.items()]})
