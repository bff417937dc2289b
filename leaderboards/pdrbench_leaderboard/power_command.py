"""`pdrbench power BOARD|ENV`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pdrbench.cli.options import Jobs, LocalizerList, Seeds, Walks, complete_env
from pdrbench.cli.output import AsJson, answer_only, note, print_json, print_table
from pdrbench.errors import DatasetError, PdrbenchError

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from pdrbench.evaluation.tables import Results
    from pdrbench.result import Result


def power(
    name: Annotated[
        str, typer.Argument(metavar="BOARD|ENV", autocompletion=complete_env, help="Board, or registered environment.")
    ],
    localizer: LocalizerList = None,
    results: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Measure on stored results, as compare and run leave them; play nothing."),
    ] = None,
    seeds: Seeds = 1,
    walks: Walks = None,
    jobs: Jobs = 1,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", file_okay=False, help="Store every walk here, and continue what is there."),
    ] = None,
    root: Annotated[
        Path | None, typer.Option(metavar="DIR", file_okay=False, help="Of a competition: the folder of its boards.")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Print the smallest ratio that the walks of a board or an environment can tell, and the walks that ratios need.

    Told means: between neighbours in the ranking, with a power of 80 %, corrected by Holm over 15 entries. How much
    ratios differ between buildings, walks and seeds is measured on the val split, by playing the localizers that suit.
    """
    with answer_only(as_json):
        from pdrbench.evaluation import load_results
        from pdrbench.evaluation.sweep import SCORES_FOLDER
        from pdrbench.evaluation.tables import Results
        from pdrbench_leaderboard.power import measured, power_rows, ranked_walks

        board, counts = ranked_walks(name, root)
        if results is None:
            found = _play(counts, localizer, seeds, walks, jobs, out)
        else:
            found = Results(load_results(results).results, jobs, kept=results / SCORES_FOLDER)
        played = {env: of for env, of in measured(found).items() if env in counts}
        for env in counts.keys() - played.keys():
            note(f"left out: {env}: nothing was played of it")
        if not played:
            raise PdrbenchError(f"no results of {', '.join(counts)}; leave --results out to play")
        rows = power_rows(board, counts, played)
    if as_json:
        print_json({"rows": rows})
    else:
        _print_rows(rows)


def _play(
    counts: Mapping[str, int], named: Sequence[str] | None, seeds: int, walks: int | None, jobs: int, out: Path | None
) -> Results:
    """Plays each environment whose data is there, on the split that spreads are measured on."""
    from pdrbench.cli.ready import ready_environment, suited_localizers
    from pdrbench.evaluation import evaluate
    from pdrbench.evaluation.tables import Results
    from pdrbench.registry import make_task
    from pdrbench_leaderboard.power import measuring_split

    found: list[Result] = []
    for env in counts:
        split = measuring_split(make_task(env))
        try:
            place = ready_environment(env, split)
        except DatasetError as error:
            note(f"left out: {env}: {error}")
            continue
        suited = suited_localizers(named, (place,), split, "process", shows_all=False)[place]
        suited = [spec for spec in suited if spec != "oracle"]  # no entry of a board
        found += evaluate(
            suited, place, split=split, seeds=seeds, walks=walks, jobs=jobs, out=out, progress=True
        ).results
    return Results(tuple(found), jobs=jobs)


def _print_rows(rows: Sequence[Mapping[str, Any]]) -> None:
    """A line for each row, and what the numbers mean below."""
    ratios = list(rows[0]["walks_for"])
    head: dict[str, dict[str, Any]] = {"": {"no_wrap": True}}
    names = ("walks", "units", "smallest\nratio", *(f"walks\nfor {ratio}" for ratio in ratios), "spread: unit", "walk")
    head |= {column: {"justify": "right", "no_wrap": True} for column in (*names, "seed")}
    lines = [
        [
            str(row["env"] or row["board"]),
            *(str(row["walks"]), str(row["units"]), _number(row["smallest_ratio"])),
            *(str(row["walks_for"][ratio] or "–") for ratio in ratios),
            *(_number(row["spread"][part]) for part in ("unit", "walk", "seed")),
        ]
        for row in rows
    ]
    print_table(head, lines)
    note("ratio: between neighbours in the ranking, 80 % power, Holm over 15 entries")
    note("spread: standard deviation of its logarithm between units, walks of a unit, seeds; 0: within the one before")


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"
