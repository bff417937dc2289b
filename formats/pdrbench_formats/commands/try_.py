"""`pdrbench try FILE...`: recordings played by those to believe, or by all that can, scored, drawn and exported."""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final

import msgspec
import typer

from pdrbench.cli.options import LOCALIZER_HELP, Isolation, make_folder
from pdrbench.cli.output import AsJson, answer_only, note, print_json, print_table, say
from pdrbench.errors import PdrbenchError, plain_cell
from pdrbench_formats.commands.inspect import COLUMNS_HELP, RATE_HELP, rated
from pdrbench_formats.commands.map import DOORS_HELP

if TYPE_CHECKING:
    from pdrbench.result import Result
    from pdrbench_formats.taskfile import Walks

SPLIT: Final = "test"
RESULTS_FOLDER: Final = "results"
START_HELP: Final = "Where the walk begins, in metres of the plan."
HEADING_HELP: Final = "Heading of travel there, counter-clockwise from the x axis (east)."
OFFSET_HELP: Final = "Added to the times of the places, whose clock is another."
SURVEY_HELP: Final = "Radio survey: table, recording, or folder of them; the own outing is left out. Repeatable."
TRUTH_HELP: Final = "Places to score against: CSV with t_s,x_m,y_m,level."


def try_(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Recordings; or a folder of one building.")],
    plan: Annotated[
        Path | None, typer.Option("--map", metavar="PLAN", help="Plan of the building.", show_default="none")
    ] = None,
    survey: Annotated[
        list[Path] | None, typer.Option(metavar="PATH", help=SURVEY_HELP, show_default="none; of a building, its walks")
    ] = None,
    columns: Annotated[Path | None, typer.Option(metavar="FILE", help=COLUMNS_HELP, show_default="guessed")] = None,
    rate: Annotated[float | None, typer.Option(metavar="HZ", help=RATE_HELP, show_default="of its time")] = None,
    start: Annotated[str | None, typer.Option(metavar="X,Y,LEVEL", help=START_HELP, show_default="first place")] = None,
    heading: Annotated[float | None, typer.Option(metavar="DEGREES", help=HEADING_HELP, show_default="unknown")] = None,
    truth: Annotated[Path | None, typer.Option(metavar="FILE", help=TRUTH_HELP, show_default="of the file")] = None,
    truth_offset: Annotated[float, typer.Option(metavar="SECONDS", help=OFFSET_HELP)] = 0.0,
    mounting: Annotated[
        str, typer.Option(metavar="WHERE", help="Where it was carried: hand, pocket, foot.", show_default="of the file")
    ] = "",
    localizer: Annotated[
        list[str] | None,
        typer.Option(metavar="LOCALIZER", help=f"{LOCALIZER_HELP} Repeat for several.", show_default="the best three"),
    ] = None,
    plays_all: Annotated[bool, typer.Option("--all", help="Play all that can, and name those that cannot.")] = False,
    doors: Annotated[str, typer.Option(metavar="HOW", help=DOORS_HELP)] = "rooms",
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", file_okay=False, help="Pictures, paths, the table, and the task file.")
    ] = Path("pdrbench-try"),
    jobs: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Processes that share the walks.", show_default="one a core")
    ] = None,
    isolation: Isolation = "process",
    as_json: AsJson = False,
) -> None:
    """Play recordings: whom to believe, where they say you walked, as a picture and a table."""
    with answer_only(as_json):
        from pdrbench.cli.ready import ready_localizers
        from pdrbench.evaluation import Results, evaluate
        from pdrbench.registry import TASK_FILE
        from pdrbench.result import shown_name
        from pdrbench_formats.taskfile import advice, schema, walks_of_file
        from pdrbench_formats.taskfile.draft import write_draft

        begin = None if start is None else schema.StartTable.of_text(start)
        if heading is not None:
            begin = msgspec.structs.replace(begin or schema.StartTable(), heading_deg=heading)
        content = schema.TaskFile(
            plan=None if plan is None else schema.PlanTable(file=str(plan.absolute()), doors=doors),
            columns=rated(columns, rate),
            survey=schema.SurveyTable(file=tuple(str(one.absolute()) for one in survey)) if survey else None,
        )
        each = schema.WalkTable(
            file="",
            start=begin,
            mounting=mounting,
            truth="" if truth is None else str(truth.absolute()),
            truth_offset_s=truth_offset,
        )
        names = localizer or (None if plays_all else (*advice.ADVISED, advice.STANDING))
        localizers = ready_localizers(names, SPLIT, isolation)
        path, notes = files[0] / TASK_FILE, list[str]()
        if len(files) > 1 or not path.is_file():
            path, notes = write_draft(files, content, each, make_folder(out))
        elif (content, each) != (schema.TaskFile(), schema.WalkTable(file="")):
            raise PdrbenchError(f"{path} says all of its walks: leave out the options, or name a recording beside it")
        walks = walks_of_file(path)
        declined = advice.declined_results(localizers, str(path), SPLIT, walks.facts)
        played = [name for name in localizers if name not in {result.localizer for result in declined}]
        if not (localizer or plays_all):
            played, declined = [*advice.advised(played, walks)], []
        results = Results(tuple(declined))
        if played:
            results = evaluate(
                played,
                str(path),
                split=SPLIT,
                jobs=jobs or (1 if isolation == "none" else os.cpu_count() or 1),
                out=out / RESULTS_FOLDER,
                isolation=isolation,
                seeds=1,
                progress=True,
            )
        is_scored = any(walks.task.load(walk).reference.surveyed.any() for walk in walks.facts)
        rows = results.rows() if is_scored and played else []
        named = [replace(one, localizer=shown_name(one.localizer, one.division)) for one in results.results]
        written = _write(walks, named, advice.errors_of(rows, advice.MEAN), out)
        best, why = advice.believed(rows, [*results.results], walks)
        doubtful = list(advice.doubts(walks, results.results, best))
        found = [f"{walk}: {finding}" for walk, facts in walks.facts.items() for finding in facts.findings]
        notes = [*notes, *walks.notes, *found]
    if as_json:
        _print_json(walks, named, declined, rows, written, {"localizer": best, "why": why, "doubts": doubtful})
        for line in notes:
            note(line)
        return
    for line in (why, *doubtful):
        say(line)
    for file in written:
        if file.suffix == ".png":
            say(f"drawn in {file}")
    _print(walks, named, rows, is_turned=advice.is_aligned(walks))
    if plays_all or localizer:
        for reason, declining in _by_reason((*named, *declined)).items():
            note(f"not played, {reason}: {', '.join(declining)}")
        notes += [f"{walk}: {why}" for walk in walks.facts for why in dict.fromkeys(walks.missing(walk).values())]
    for line in notes:
        note(line)
    note(f"wrote {out / 'table.csv'}, and the paths in {out / 'paths'}")
    note(f"{path} makes it an environment: edit it, then: pdrbench run LOCALIZER {path.parent}")


def _write(walks: Walks, results: Sequence[Result], error_m: Mapping[str, float], out: Path) -> list[Path]:
    from pdrbench_formats.pages.tried import draw_walks, path_rows, write_paths

    table = out / "table.csv"
    rows = path_rows(results)
    columns = ["mean_m", *(rows[0] if rows else ())]
    lines = [columns]
    for row in rows:
        error = error_m.get(row["localizer"], math.nan)
        cells = (plain_cell(value) if isinstance(value, str) else str(value) for value in row.values())
        lines.append(["" if math.isnan(error) else repr(error), *cells])
    with table.open("w", encoding="utf-8", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows(lines)
    return [*draw_walks(walks, results, error_m, out), table, *write_paths(walks, results, out / "paths")]


def _by_reason(results: Sequence[Result]) -> dict[str, list[str]]:
    """Localizers that declined a walk, by the reason."""
    from pdrbench.result import UNSUITABLE

    names: dict[str, dict[str, None]] = {}
    for result in results:
        if result.status == UNSUITABLE:
            names.setdefault(result.failure, {})[result.localizer] = None
    return {reason: list(of) for reason, of in names.items()}


def _print_json(
    walks: Walks,
    results: Sequence[Result],
    declined: Sequence[Result],
    rows: Sequence[Mapping[str, Any]],
    written: Sequence[Path],
    believe: Mapping[str, Any],
) -> None:
    from pdrbench.result import FAILED, UNSUITABLE
    from pdrbench_formats.pages.tried import path_rows

    print_json(
        {
            "believe": believe,
            "task": walks.reader.path,
            "rows": rows,
            "paths": path_rows(results),
            "declined": {r.localizer: r.failure for r in (*results, *declined) if r.status == UNSUITABLE},
            "failed": {r.localizer: r.failure.strip().splitlines()[-1] for r in results if r.status == FAILED},
            "missing": {walk: walks.missing(walk) for walk in walks.facts},
            "files": written,
        }
    )


def _print(walks: Walks, results: Sequence[Result], rows: Sequence[Mapping[str, Any]], *, is_turned: bool) -> None:
    """Errors where there are places, else lengths and ends; and what became of answers that are not complete."""
    from pdrbench.cli.scoreboard import print_scores
    from pdrbench.evaluation.wording import COLUMNS, incidents
    from pdrbench.result import ONLINE, UNSUITABLE
    from pdrbench_formats.pages.tried import path_rows
    from pdrbench_formats.taskfile.advice import ALIGNED

    if rows and is_turned:
        say(f"no heading at the start is known: {ALIGNED} is of paths turned onto the places; --heading settles it")
    paths = path_rows(results)
    if rows:
        print_scores(rows, (ALIGNED, *COLUMNS) if is_turned else None)
    elif paths:
        head: dict[str, Mapping[str, Any]] = {name: {"justify": "right", "no_wrap": True} for name in paths[0]}
        cells = [
            [f"{round(v, 1) + 0.0:.1f}" if isinstance(v, float) else str(v) for v in row.values()] for row in paths
        ]
        print_table(head, cells, title="no places to score against: lengths and ends of the paths")
    for line in incidents([result for result in results if result.status != UNSUITABLE and result.division == ONLINE]):
        note(line)
