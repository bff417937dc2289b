"""`pdrbench error-model`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
import typer

from pdrbench.cli.options import write_text
from pdrbench.cli.output import AsJson, answer_only, note, print_json, print_table
from pdrbench.errors import PdrbenchError

if TYPE_CHECKING:
    from pdrbench_lab.stride_errors.error_file import ErrorFile, ErrorStatistic


def error_model(
    filter_name: Annotated[
        str, typer.Option("--filter", metavar="NAME", help="Settings of the inertial filter: literal or adaptive.")
    ] = "literal",
    env: Annotated[
        list[str] | None,
        typer.Option("--env", metavar="ENV", help="Only on this environment; may be repeated.", show_default="all"),
    ] = None,
    law: Annotated[
        bool, typer.Option("--law", help="Fit the law that environments draw with, and test it on each set left out.")
    ] = False,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", dir_okay=False, help="Write a file with what was measured.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Measure on recorded walks how far the strides of a foot-mounted unit are off."""
    with answer_only(as_json):
        from pdrbench_lab.stride_errors.stride_errors import SETS, measure_errors
        from pdrbench_lab.stride_errors.stride_fit import measure_law

        if law and (env or filter_name != "literal"):
            raise PdrbenchError("--law is fitted to all sets with the literal filter; leave --env and --filter out")
        found = measure_law() if law else measure_errors(filter_name, env or tuple(SETS))
    if out is not None:
        write_text(out, found.encode())
    if as_json:
        print_json(msgspec.to_builtins(found))
    else:
        _print_statistics(found)
    if law and not as_json:
        for name, size in msgspec.to_builtins(found.errors).items():
            note(f"{name}: {size}")
    for source in found.sources:
        for walk, why in source.left_out.items():
            note(f"{source.env or source.dataset}: {walk} left out: {why}")
    if out is not None:
        note(f"wrote {out}")


def _print_statistics(found: ErrorFile) -> None:
    right = {"justify": "right"}
    head: dict[str, Mapping[str, Any]] = {
        "statistic": {"no_wrap": True},
        **dict.fromkeys(("value", "low", "high"), right),
    }
    head |= {"unit": {}, "walks": right, "strides": right, "note 1": {}}
    walks = ", ".join(f"{source.num_walks} walks of {source.env or source.dataset}" for source in found.sources)
    print_table(head, [_cells(row) for row in found.statistics], title=f"strides of the {found.filter} filter, {walks}")


def _cells(row: ErrorStatistic) -> list[str]:
    numbers = ["-" if value is None else f"{value:.3g}" for value in (row.value, row.low, row.high)]
    return [row.name, *numbers, row.unit, str(row.num_walks), str(row.num_strides), row.note_1]
