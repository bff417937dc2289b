"""`pdrbench plot RESULT`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pdrbench.cli.compare import RESULTS_FOLDER
from pdrbench.cli.options import make_folder
from pdrbench.cli.output import AsJson, answer_only, print_json, say
from pdrbench.errors import PdrbenchError

MAX_SIZE_IN = 60.0


def plot(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", exists=True, help="A stored walk, or a folder of `run` or `compare`.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", file_okay=False, help="Where to write.", show_default="beside the results"),
    ] = None,
    size: Annotated[
        str | None, typer.Option(metavar="WxH", help="Of distributions and spreads, in inches: 3.5x2.6.")
    ] = None,
    formats: Annotated[str, typer.Option("--format", metavar="LIST", help="Of png, pdf and svg.")] = "png,pdf",
    label: Annotated[
        list[str] | None, typer.Option(metavar="ID=TEXT", help="What to call a localizer; repeat for several.")
    ] = None,
    title: Annotated[
        str | None, typer.Option(metavar="TEXT", help="Of every figure.", show_default="environment and split")
    ] = None,
    log: Annotated[bool, typer.Option("--log", help="Errors on a logarithmic axis.")] = False,
    captions: Annotated[
        bool, typer.Option("--captions", help="For papers: titles stand in captions.md, not in the figures.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Draw stored results: error distributions, trajectories on the floor plan, tables."""
    with answer_only(as_json):
        from pdrbench.evaluation import load_results
        from pdrbench.report import FigureOptions, write_report

        options = FigureOptions(_size(size), tuple(formats.split(",")), _labels(label or ()), title, log, captions)
        folder = make_folder(out if out is not None else result if result.is_dir() else result.parent)
        stored = result / RESULTS_FOLDER if (result / RESULTS_FOLDER).is_dir() else result
        files = write_report(load_results(stored), folder, options)
    if as_json:
        print_json({"files": files})
    else:
        for file in files:
            say(str(file))


def _size(text: str | None) -> tuple[float, float] | None:
    if text is None:
        return None
    try:
        width, height = (float(part) for part in text.split("x"))
    except ValueError:
        width = height = 0.0
    if not (0 < width <= MAX_SIZE_IN and 0 < height <= MAX_SIZE_IN):
        raise PdrbenchError(f"--size is width x height in inches, as in 3.5x2.6; got {text!r}")
    return width, height


def _labels(pairs: list[str] | tuple[()]) -> dict[str, str]:
    labels = {name: text for name, found, text in (pair.partition("=") for pair in pairs) if found and text}
    if len(labels) < len(pairs):
        raise PdrbenchError("--label is the id of a localizer and its text, each id once, as in mine=Ours")
    return labels
