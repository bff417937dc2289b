"""`pdrbench run LOCALIZER ENV`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pdrbench.cli.options import LOCALIZER_HELP, Isolation, Jobs, Scheduler, Seeds, Split, Walks, make_folder
from pdrbench.cli.output import AsJson, answer_only, note, print_json
from pdrbench.cli.ready import check_localizer_exists, ready_environment
from pdrbench.errors import UnsuitableError


def run(
    localizer: Annotated[str, typer.Argument(metavar="LOCALIZER", help=LOCALIZER_HELP)],
    env: Annotated[str, typer.Argument(metavar="ENV", help="Registered environment.")],
    split: Split = "test",
    seeds: Seeds = 1,
    walks: Walks = None,
    jobs: Jobs = 1,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", file_okay=False, help="Store every walk here, and continue what a run before left here."
        ),
    ] = None,
    isolation: Isolation = "auto",
    scheduler: Scheduler = None,
    as_json: AsJson = False,
) -> None:
    """Run one localizer through one environment; exit 1 where it declines or fails on every walk."""
    from pdrbench.cli.scoreboard import footnotes, is_declined, is_incomplete, last_line, print_scores, warnings_of

    with answer_only(as_json):
        check_localizer_exists(localizer, isolation)
        env = ready_environment(env, split)
        if out is not None:
            make_folder(out)
        from pdrbench.evaluation import evaluate
        from pdrbench.evaluation.cluster import on_cluster

        with on_cluster(scheduler):
            results = evaluate(
                localizer,
                env,
                split=split,
                seeds=seeds,
                walks=walks,
                jobs=jobs,
                out=out,
                isolation=isolation,
                progress=True,
            )
        if is_declined(results.results):
            raise UnsuitableError(f"{localizer} does not suit {env}: {last_line(results.results[0].failure)}")
        rows = results.rows()
    if as_json:
        print_json({"rows": rows})
    else:
        print_scores(rows, results.results)
    for line in [*footnotes(results.results), *warnings_of([env])]:
        note(line)
    if out is not None:
        note(f"stored in {out}; draw it with: pdrbench plot {out}")
    if is_incomplete(results.results):
        note(results.results[0].failure)
        raise typer.Exit(1)
