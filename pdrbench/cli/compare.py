"""`pdrbench compare`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from pdrbench.cli.options import (
    AllColumns,
    Columns,
    Confined,
    Isolation,
    Jobs,
    LocalizerList,
    Nonce,
    Scheduler,
    Seeds,
    Split,
    Strict,
    Tuned,
    Walks,
    columns_of,
    complete_env,
    complete_localizer,
    exit_on,
    isolation_of,
    make_folder,
    nonce_of,
    tuned_name,
    write_text,
)
from pdrbench.cli.output import AsJson, answer_only, note, print_json, say
from pdrbench.cli.ready import available_environments, ready_environment, suited_localizers
from pdrbench.errors import UnsuitableError
from pdrbench.settings import split_name

RESULTS_FOLDER: Final = "results"  # walks as they were answered, below the folder of the report


def compare(
    env: Annotated[
        list[str] | None,
        typer.Option(
            metavar="ENV",
            autocompletion=complete_env,
            help="Environment; repeat for several.",
            show_default="all with data",
        ),
    ] = None,
    localizer: LocalizerList = None,
    against: Annotated[
        str | None,
        typer.Option(metavar="LOCALIZER", autocompletion=complete_localizer, help="Compare each other with this one."),
    ] = None,
    settings: Tuned = None,
    split: Split = None,
    seeds: Seeds = 1,
    walks: Walks = None,
    jobs: Jobs = 1,
    out: Annotated[
        Path,
        typer.Option(metavar="FOLDER", file_okay=False, help="Tables, plots, and the walks that a later run reuses."),
    ] = Path("pdrbench-results"),
    latex: Annotated[Path | None, typer.Option(metavar="FILE", dir_okay=False, help="The table in LaTeX.")] = None,
    html: Annotated[
        Path | None, typer.Option(metavar="FILE", dir_okay=False, help="Tables and pictures as one web page.")
    ] = None,
    every: Annotated[
        bool, typer.Option("--all", help="Name every localizer that is left out, and why, in place of their number.")
    ] = False,
    methods: Annotated[bool, typer.Option("--methods", help="A paragraph on methods for a paper, and BibTeX.")] = False,
    columns: Columns = "",
    all_columns: AllColumns = False,
    strict: Strict = False,
    isolation: Isolation = "process",
    confined: Confined = False,
    nonce: Nonce = "",
    scheduler: Scheduler = None,
    as_json: AsJson = False,
) -> None:
    """Compare the localizers that suit environments: a table for each environment, and a folder of plots.

    Best first: rank, ratio to the best, geometric mean of the walks' third quartile of the error (which ranks), mean
    error, and the fraction of walks that were lost. What a run before has stored is not computed again. Exit 1 where a
    localizer fails on every walk.
    """
    from pdrbench.cli.scoreboard import failures, print_scores
    from pdrbench.evaluation.wording import score_tables, stacked
    from pdrbench.registry import canonical_localizer

    with answer_only(as_json):
        nonce, shown = nonce_of(nonce), columns_of(columns, shows_all=all_columns)
        envs = (
            tuple(ready_environment(name, split) for name in dict.fromkeys(env))
            if env
            else available_environments(split)
        )
        make_folder(out)
        for wanted in filter(None, (latex, html)):
            write_text(wanted, "")  # so that a place that cannot be written is reported before the walks
        kind = isolation_of(isolation, confined=confined)
        if settings is not None:
            tuned = tuned_name(settings)
            localizer = [*(localizer or [split_name(tuned)[0]]), tuned]
        if against and localizer:
            localizer = [*localizer, against]
        localizers = suited_localizers(localizer, envs, split, kind, shows_all=every)
        if against and canonical_localizer(against) not in {name for of in localizers.values() for name in of}:
            raise UnsuitableError(f"{against} is not played here: name it with --localizer, beside those to compare")
        from pdrbench.evaluation import evaluate
        from pdrbench.evaluation.cluster import on_cluster
        from pdrbench.report import comparison_page, write_report

        with on_cluster(scheduler):
            results = evaluate(
                localizers,
                tuple(localizers),
                split=split,
                seeds=seeds,
                walks=walks,
                jobs=jobs,
                out=out / RESULTS_FOLDER,
                isolation=kind,
                nonce=nonce,
                progress=True,
            )
        results = results.against(against) if against else results
        note("scoring")
        rows = results.rows()
        notes = results.notes(shown)
        note("drawing")
        files = write_report(results, out, columns=shown)
        if html is not None:
            pictures = [file for file in files if file.suffix == ".png"]
            files.append(write_text(html, comparison_page(score_tables(rows, stacked, shown), notes, pictures)))
        if latex is not None:
            files.append(write_text(latex, results.to_latex(shown)))
        text = results.methods(shown) if methods else ""
    if as_json:
        print_json({"rows": rows, **({"methods": text} if methods else {})})
    else:
        print_scores(rows, shown)
        for line in text.splitlines():
            say(line)
    for line in notes:
        note(line)
    if nonce:
        note(f"run it again with: --nonce {nonce}")
    note(f"wrote {len(files)} files:")
    for file in files:
        note(f"  {file}")
    exit_on(failures(results.results, strict=strict))
