"""`pdrbench replay RESULT`."""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from pdrbench.cli.compare import RESULTS_FOLDER
from pdrbench.cli.output import AsJson, answer_only, note, print_json, say
from pdrbench.errors import ResultError

if TYPE_CHECKING:
    from pdrbench.result import Result

MAX_LISTED: Final = 5


def replay(
    result: Annotated[Path, typer.Argument(metavar="RESULT", exists=True, help="A stored walk, a .result file.")],
    out: Annotated[Path, typer.Option(metavar="FILE", dir_okay=False, help="Page to write (.html).")],
    fps: Annotated[int, typer.Option(min=1, max=60, metavar="N", help="Frames a second.")] = 10,
    from_s: Annotated[float, typer.Option("--from", metavar="S", help="First second of the walk to show.")] = 0.0,
    to_s: Annotated[
        float | None, typer.Option("--to", metavar="S", help="Last second of the walk.", show_default="its end")
    ] = None,
    every: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Observations from one frame to the next.",
            show_default="a second, or more: 600 frames at most",
        ),
    ] = None,
    loose: Annotated[
        bool, typer.Option("--loose", help="Go on, with a warning, where the answers are not the stored ones.")
    ] = False,
    as_json: AsJson = False,
) -> None:
    """Play a stored walk again and show what the localizer thought: particles, estimate, reference.

    The localizer is made anew and runs in this process; its answers must be the stored ones.
    """
    with answer_only(as_json):
        stored = _one_result(result)
        from pdrbench.evaluation.progress import reporting
        from pdrbench.result import COMPLETE
        from pdrbench_formats.replays import plan_replay, write_replay

        planned = plan_replay(stored, fps=fps, from_s=from_s, to_s=math.inf if to_s is None else to_s, every=every)
        with (
            warnings.catch_warnings(record=True) as caught,
            reporting(len(planned), 0, shown=True, what="frames") as done,
        ):
            warnings.simplefilter("always", UserWarning)
            write_replay(planned, out, strict=not loose, advance=lambda: done(COMPLETE, planned.title))
    for warning in caught:
        note(f"pdrbench: {warning.message}")
    if as_json:
        print_json({"file": out, "frames": len(planned), "seconds": planned.span_s})
    else:
        say(str(out))


def _one_result(path: Path) -> Result:
    """The result in a file, or of the only walk in a folder, with its first seed."""
    from pdrbench.evaluation import store

    if path.is_dir():
        folder = path / RESULTS_FOLDER if (path / RESULTS_FOLDER).is_dir() else path
        found = sorted(folder.glob(f"*{store.SUFFIX}"))
        walks, runs = ({file.name.rsplit(".", parts)[0] for file in found} for parts in (3, 2))  # see `result_name`
        if len(walks) != 1 or len(runs) != len(found):
            listed = "".join(f"\n    {file}" for file in found[:MAX_LISTED])
            more = f"\n    and {len(found) - MAX_LISTED} more" if len(found) > MAX_LISTED else ""
            raise ResultError(
                f"{path} holds {len(found)} stored walks; name one of them{':' if found else ''}{listed}{more}"
            )
        path = found[0]
    return store.load(path)
