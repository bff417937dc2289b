"""`pdrbench plot RESULT`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pdrbench.cli.compare import RESULTS_FOLDER
from pdrbench.cli.options import make_folder
from pdrbench.cli.output import AsJson, answer_only, print_json, say


def plot(
    result: Annotated[
        Path, typer.Argument(metavar="RESULT", exists=True, help="A stored walk, or a folder of `run` or `compare`.")
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", file_okay=False, help="Where to write.", show_default="beside the results"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Draw stored results: error distributions, trajectories on the floor plan, tables."""
    with answer_only(as_json):
        from pdrbench.evaluation import load_results
        from pdrbench.report import write_report

        beside = result if result.is_dir() else result.parent
        stored = result / RESULTS_FOLDER if (result / RESULTS_FOLDER).is_dir() else result
        files = write_report(load_results(stored), make_folder(out if out is not None else beside))
    if as_json:
        print_json({"files": files})
    else:
        for file in files:
            say(str(file))
