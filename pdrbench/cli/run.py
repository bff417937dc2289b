"""`pdrbench run LOCALIZER ENV`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pdrbench.cli.options import (
    LOCALIZER_HELP,
    Confined,
    Isolation,
    Jobs,
    Nonce,
    Scheduler,
    Seeds,
    Split,
    Strict,
    Tuned,
    Walks,
    complete_env,
    complete_localizer,
    exit_on,
    isolation_of,
    make_folder,
    nonce_of,
    tuned_name,
)
from pdrbench.cli.output import AsJson, answer_only, note, print_json
from pdrbench.cli.ready import check_localizer_exists, ready_environment
from pdrbench.errors import UnsuitableError, quoted
from pdrbench.result import FAILED


def run(
    localizer: Annotated[
        str, typer.Argument(metavar="LOCALIZER", autocompletion=complete_localizer, help=LOCALIZER_HELP)
    ],
    env: Annotated[str, typer.Argument(metavar="ENV", autocompletion=complete_env, help="Registered environment.")],
    settings: Tuned = None,
    split: Split = None,
    seeds: Seeds = 1,
    walks: Walks = None,
    jobs: Jobs = 1,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER", file_okay=False, help="Store every walk here, and continue what a run before left here."
        ),
    ] = None,
    strict: Strict = False,
    isolation: Isolation = "process",
    confined: Confined = False,
    nonce: Nonce = "",
    scheduler: Scheduler = None,
    as_json: AsJson = False,
) -> None:
    """Run one localizer through one environment; exit 1 where it declines or fails on every walk."""
    from pdrbench.cli.scoreboard import failures, is_declined, print_scores
    from pdrbench.evaluation.wording import last_line

    with answer_only(as_json):
        nonce, kind = nonce_of(nonce), isolation_of(isolation, confined=confined)
        localizer = tuned_name(settings, localizer) if settings else localizer
        check_localizer_exists(localizer, kind)
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
                isolation=kind,
                nonce=nonce,
                progress=True,
            )
        if is_declined(results.results):
            raise UnsuitableError(f"{localizer} does not suit {env}: {last_line(results.results[0].failure)}")
        rows = results.rows()
    if as_json:
        print_json({"rows": rows})
    else:
        print_scores(rows)
    for line in results.notes():
        note(line)
    if nonce:
        note(f"run it again with: --nonce {nonce}")
    if out is not None:
        note(f"stored in {out}; draw it with: pdrbench plot {out}")
    if failed := failures(results.results, strict=strict):
        note(quoted(next(result.failure for result in results.results if result.status == FAILED)))
    exit_on(failed)
