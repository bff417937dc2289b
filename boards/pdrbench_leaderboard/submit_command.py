"""`pdrbench submit card|pack|check|verify|suites`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pdrbench.cli.options import LOCALIZER_HELP, Jobs, Scheduler, make_folder
from pdrbench.cli.output import AsJson, answer_only, note, print_json, say, verdict
from pdrbench.errors import BundleError, PdrbenchError
from pdrbench.result import FAILED
from pdrbench_leaderboard.folder_command import PackagesFolder, WeightsFolder, WheelsFolder, add_folder_commands

if TYPE_CHECKING:
    from pdrbench_leaderboard.bundle import Bundle
    from pdrbench_leaderboard.entry import Entry
    from pdrbench_leaderboard.suites import Suite

app = typer.Typer(no_args_is_help=True, help="Pack, check and verify a submission.")
add_folder_commands(app)

SuiteName = Annotated[str, typer.Option("--suite", metavar="SUITE", help="See `pdrbench submit suites`.")]
ResultsFolder = Annotated[
    Path | None,
    typer.Option(metavar="FOLDER", file_okay=False, help="Keep every walk here, and continue what was left here."),
]
Into = Annotated[
    Path | None,
    typer.Option(metavar="FOLDER", file_okay=False, help="Write entries below this folder, such as leaderboards."),
]
ALL_WALKS = "all"


@app.command("suites")
def suites(as_json: AsJson = False) -> None:
    """List the suites: what a submission is run on."""
    from pdrbench_leaderboard.suites import suites as known

    items: list[dict[str, Any]] = [
        {
            "id": suite.name,
            "summary": suite.summary,
            "seeds": suite.seeds,
            "metrics": list(suite.metrics),
            "commitment": suite.commitment,
            "environments": {listed.env: listed.walks for listed in suite.environments},
        }
        for suite in known().values()
    ]
    if as_json:
        print_json({"items": items})
        return
    for item in items:
        say(f"{item['id']}  {item['summary']}")
        for env, walks in item["environments"].items():
            say(f"    {env}, {walks} walks")
        if item["commitment"]:
            say(f"    held-out walks: sha256 of the secret {item['commitment']}")


@app.command("card")
def card(localizer: Annotated[str, typer.Argument(metavar="LOCALIZER", help=LOCALIZER_HELP)]) -> None:
    """Print a card to fill in."""
    from pdrbench_leaderboard.card import template

    say(template(localizer).rstrip("\n"))


@app.command("pack")
def pack(
    localizer: Annotated[
        str | None, typer.Argument(metavar="LOCALIZER", help=f"{LOCALIZER_HELP} Left out with --all.")
    ] = None,
    suite: SuiteName = "pdr-core-v1",
    card: Annotated[
        Path | None,
        typer.Option(metavar="FILE", dir_okay=False, help="card.toml; registered localizers bring their own."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(metavar="FILE", dir_okay=False, help="The bundle.", show_default="<name>.<suite>.pdrz"),
    ] = None,
    into: Into = None,
    every: Annotated[bool, typer.Option("--all", help="Every registered localizer, with --into.")] = False,
    env: Annotated[
        list[str] | None,
        typer.Option(metavar="ENV", help="Only this environment, for a try; repeat for several. With --into."),
    ] = None,
    seeds: Annotated[
        int | None,
        typer.Option(min=1, metavar="N", help="Runs of every walk where they differ.", show_default="the suite's"),
    ] = None,
    source: Annotated[
        bool, typer.Option(help="Pack the file of the localizer too, so that maintainers can run it again.")
    ] = True,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    results: ResultsFolder = None,
    as_json: AsJson = False,
) -> None:
    """Run a localizer on a suite and pack what it answered into one file."""
    with answer_only(as_json):
        from pdrbench.evaluation.cluster import on_cluster
        from pdrbench_leaderboard.pack import make_bundle, play_suite
        from pdrbench_leaderboard.suites import find_suite

        chosen = find_suite(suite)
        specs = _specs(localizer, every=every, into=into, out=out, card=card)
        cards = {spec: _card(spec, card) for spec in specs}  # a wrong card is reported before the walks
        for name in env or ():
            chosen.environment(name)
        if env and into is None:
            raise BundleError("a bundle is of a whole suite: --env goes with --into")
        if results is not None:
            make_folder(results)
        with on_cluster(scheduler):
            runs = play_suite(specs, chosen, results=results, seeds=seeds, envs=env or (), jobs=jobs, progress=True)
        written = []
        for spec in specs:
            suite_run = runs[spec]
            if every and not suite_run.results:
                note(f"{spec}: suits no environment of {suite}")
                continue
            bundle = make_bundle(spec, cards[spec], chosen, suite_run, seeds=seeds, with_source=source)
            written.append(_written(bundle, chosen, out, into))
    if as_json:
        print_json({"bundles": written})
        return
    for item in written:
        failed = f", {item['failed']} failed" if item["failed"] else ""
        played = f"{item['runs']} runs of {len(item['environments'])} environments of {suite}{failed}"
        say(f"{item['localizer']}: {played}")
        say(f"    sha256 of the content {item['content_sha256']}")
        for path in item["files"]:
            say(f"    {path}")


def _specs(localizer: str | None, *, every: bool, into: Path | None, out: Path | None, card: Path | None) -> list[str]:
    if every:
        if localizer is not None or into is None or out is not None or card is not None:
            raise BundleError("--all goes with --into and without LOCALIZER, --out and --card")
        from pdrbench.cli.ready import ready_localizers

        return list(ready_localizers(None, "test"))
    if localizer is None:
        raise BundleError("name a localizer, or --all")
    return [localizer]


def _card(spec: str, path: Path | None) -> Any:
    from pdrbench_leaderboard.card import card_of, read_card

    if path is None:
        return card_of(spec)
    try:
        return read_card(path.read_bytes(), str(path))
    except OSError as error:
        raise BundleError(f"cannot read {path}: {error.strerror}") from error


def _written(bundle: Bundle, suite: Suite, out: Path | None, into: Path | None) -> dict[str, Any]:
    from pdrbench_leaderboard.bundle import SUFFIX
    from pdrbench_leaderboard.entry import write_entry
    from pdrbench_leaderboard.pack import save_bundle

    files = []
    if into is not None:
        files += [write_entry(into, entry) for entry in bundle.entries()]
    if into is None or out is not None:
        files.append(save_bundle(bundle, out or Path(f"{bundle.manifest.localizer}.{suite.name}{SUFFIX}")))
    return {
        "localizer": bundle.manifest.localizer,
        "suite": suite.name,
        "environments": [record.env for record in bundle.manifest.environments],
        "runs": len(bundle.estimates),
        "failed": sum(walk.status == FAILED for record in bundle.manifest.environments for walk in record.walks),
        "unsuitable": bundle.manifest.unsuitable,
        "absent": bundle.manifest.absent,
        "content_sha256": bundle.content_sha256,
        "files": [str(path) for path in files],
    }


@app.command("pin", hidden=True)
def pin(
    envs: Annotated[
        list[str] | None, typer.Argument(metavar="[ENV]...", help="Environments; those of all suites by default.")
    ] = None,
    replace: Annotated[
        list[str] | None,
        typer.Option(metavar="ENV", help="Its walks may have changed: there are no submissions to it yet."),
    ] = None,
) -> None:
    """For maintainers: write digests of all walks into `walks.json` of their package; exit 1 where walks changed."""
    from pdrbench_leaderboard.pinning import pin as pin_walks

    for line in pin_walks(envs or (), replace or ()):
        say(line)


@app.command("check")
def check(
    path: Annotated[Path, typer.Argument(metavar="FILE|FOLDER", help="A bundle, or the folder of an entry.")],
    into: Into = None,
    as_json: AsJson = False,
) -> None:
    """Check a submission and compute its scores; exit 1 where a rule is broken. Flags are shown and break nothing."""
    with answer_only(as_json):
        from pdrbench_leaderboard.checking import check as check_path

        checked = check_path(path)
    if as_json:
        items = [
            {"name": f.name, "pass": f.passed, "why": f.why, "kind": "flag" if f.is_flag else "rule"}
            for f in checked.findings
        ]
        print_json({"checks": items, "pass": checked.passed})
    else:
        for f in checked.findings:
            say(verdict(f.passed, f.name, f.why, otherwise="flag" if f.is_flag else "FAIL"))
    if not checked.passed:
        raise typer.Exit(1)
    if into is not None:
        _enter(into, checked.entries)


@app.command("verify")
def verify(
    path: Annotated[Path, typer.Argument(metavar="FILE|FOLDER", help="A bundle, or the folder of an entry.")],
    rerun: Annotated[bool, typer.Option("--rerun", help="Run it again, isolated. Without it: as `check`.")] = False,
    share: Annotated[
        str, typer.Option(metavar="SHARE", help="Of the walks of each environment: above 0 and at most 1, or all.")
    ] = "0.2",
    secret: Annotated[
        Path | None, typer.Option(metavar="FILE", dir_okay=False, help="Secret behind the held-out walks of the suite.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="Chooses the walks.", show_default="random")
    ] = None,
    into: Into = None,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    results: ResultsFolder = None,
    wheels: WheelsFolder = None,
    weights: WeightsFolder = None,
    packages: PackagesFolder = None,
    as_json: AsJson = False,
) -> None:
    """Check a submission, run it again and compare byte for byte; exit 1 where anything differs."""
    if not rerun:
        if secret is not None:
            raise BundleError("--secret goes with --rerun")
        check(path, into, as_json)
        return
    with answer_only(as_json):
        import numpy as np

        from pdrbench.evaluation.cluster import on_cluster
        from pdrbench_leaderboard.checking import bundle_of, code_remark, load_bundle
        from pdrbench_leaderboard.checking import check as check_path
        from pdrbench_leaderboard.folders import Supplies
        from pdrbench_leaderboard.verify import verify as verify_bundle

        checked = check_path(path)
        broken = [finding for finding in checked.findings if not (finding.passed or finding.is_flag)]
        if broken:
            raise BundleError(f"{path}: {broken[0].name}: {broken[0].why}")
        bundle = bundle_of(checked.entries[0]) if path.is_dir() else load_bundle(path)
        if results is not None:
            make_folder(results)
        remark = code_remark(bundle.manifest)
        if remark:
            note(f"{path}: {remark}; only estimates decide")
        with on_cluster(scheduler):
            differences, entries = verify_bundle(
                bundle,
                np.random.default_rng(seed),
                share=_fraction(share),
                secret=None if secret is None else _secret(secret),
                results=results,
                supplies=Supplies(wheels, weights, packages),
                jobs=jobs,
                progress=True,
            )
    _print_entries(entries, as_json=as_json, differences=differences)
    if differences:
        raise PdrbenchError(f"{path} is refused: {differences[0]}{f' ({remark})' if remark else ''}")
    if into is not None:
        _enter(into, entries)


def _fraction(text: str) -> float:
    try:
        return 1.0 if text == ALL_WALKS else float(text)
    except ValueError:
        raise BundleError(f"--share is a number above 0 and at most 1, or {ALL_WALKS}; got {text!r}") from None


def _secret(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise BundleError(f"cannot read the secret in {path}: {type(error).__name__}") from None


def _print_entries(entries: Sequence[Entry], *, as_json: bool, differences: list[str]) -> None:
    rows: list[dict[str, Any]] = []
    for entry in entries:
        found = entry.submission.verification
        row: dict[str, Any] = {"env": entry.env, "localizer": entry.localizer, "tier": entry.tier}
        row |= dict.fromkeys(("reran", "of", "deterministic", "isolation", "held_out"))
        if found:
            row |= {"reran": found.reran, "of": found.of, "deterministic": found.is_deterministic}
            row |= {"isolation": found.isolation, "held_out": found.held_out.metrics if found.held_out else None}
        rows.append(row)
    if as_json:
        print_json({"entries": rows, "differences": differences})
        return
    for row in rows:
        if row["reran"] is None:
            say(f"DIFFERS  {row['env']}")
            continue
        twice = "the same twice" if row["deterministic"] else "NOT the same twice"
        say(f"{row['tier']}  {row['env']}: {row['reran']} of {row['of']} runs give the same bytes, {twice}")
        for name, (value, low, high) in (row["held_out"] or {}).items():
            say(f"    held out, {name}: {_interval(value, low, high)}")
    for difference in differences:
        say(f"differs  {difference}")


def _interval(value: float | None, low: float | None, high: float | None) -> str:
    if value is None:
        return "–"
    return f"{value:.3g}" if low is None or high is None else f"{value:.3g} [{low:.3g}, {high:.3g}]"


def _enter(into: Path, entries: Sequence[Entry]) -> None:
    """Adds entries to a leaderboard; an entry of another submitter under the same name stays."""
    from pdrbench_leaderboard.entry import SUBMISSION_FILE, read_entry, write_entry

    better = set()
    for entry in entries:
        folder = into / entry.env / entry.localizer
        if not (folder / SUBMISSION_FILE).is_file():
            continue
        present = read_entry(folder)
        if present.card.authors != entry.card.authors:
            raise BundleError(f"{folder} is an entry of other authors; choose another name in the card")
        is_same = present.submission.content_sha256 == entry.submission.content_sha256
        if is_same and present.submission.verification and not entry.submission.verification:
            better.add(entry.env)
    for entry in entries:
        if entry.env in better:
            note(f"left as it is, since it has been run again: {into / entry.env / entry.localizer}")
        else:
            note(f"entered {write_entry(into, entry)}")
