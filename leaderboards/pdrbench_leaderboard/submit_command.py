"""`pdrbench submit card|pack|check|verify|suites`."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace as replaced
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pdrbench.cli.options import LOCALIZER_HELP, Jobs, Scheduler, make_folder, nonce_of
from pdrbench.cli.output import AsJson, answer_only, note, print_json, say, verdict
from pdrbench.errors import BundleError, PdrbenchError
from pdrbench.result import FAILED
from pdrbench_leaderboard.folder_command import PackagesFolder, WeightsFolder, WheelsFolder, add_folder_commands

if TYPE_CHECKING:
    from pdrbench_leaderboard.bundle import Bundle
    from pdrbench_leaderboard.entry import Entry
    from pdrbench_leaderboard.verification import HeldOut
    from pdrbench_leaderboard.verify import Verified

app = typer.Typer(no_args_is_help=True, help="Pack, check and verify a submission.")
add_folder_commands(app)

SuiteName = Annotated[str, typer.Option("--suite", metavar="SUITE", help="See `pdrbench submit suites`.")]
ResultsFolder = Annotated[
    Path | None,
    typer.Option(metavar="FOLDER", file_okay=False, help="Keep every walk here, and continue what was left here."),
]
Replace = Annotated[
    bool, typer.Option("--replace", help="Replace entries of the same authors and name, whatever they hold.")
]
KeyFile = Annotated[
    Path | None, typer.Option("--key", metavar="FILE", dir_okay=False, help="Private key that signs what was found.")
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
            "commitments": {listed.env: suite.round_of(listed.env) for listed in suite.environments},
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
        for digest in dict.fromkeys(filter(None, item["commitments"].values())):
            of = [env for env, other in item["commitments"].items() if other == digest]
            where = "" if len(of) == len(item["environments"]) else f" of {', '.join(of)}"
            say(f"    held-out walks{where}: sha256 of the secret {digest}")


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
    suite: SuiteName = "pdr-core-v3",
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
    nonce: Annotated[
        str | None,
        typer.Option(
            metavar="TEXT",
            help="What randomness depends on besides seed and walk: 32 hexadecimal digits, or `new`; it is published.",
            show_default="that of --results where there is one, else new",
        ),
    ] = None,
    replace: Replace = False,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    results: ResultsFolder = None,
    as_json: AsJson = False,
) -> None:
    """Run a localizer on a suite and pack what it answered into one file."""
    with answer_only(as_json):
        from pdrbench.evaluation.cluster import on_cluster
        from pdrbench_leaderboard.bundle import SUFFIX
        from pdrbench_leaderboard.pack import kept_nonce, make_bundle, play_suite, save_bundle
        from pdrbench_leaderboard.suites import find_suite

        chosen = find_suite(suite)
        specs = _specs(localizer, every=every, into=into, out=out, card=card)
        cards = {spec: _card(spec, card) for spec in specs}  # a wrong card is reported before the walks
        for name in env or ():
            chosen.environment(name)
        if env and into is None:
            raise BundleError("a bundle is of a whole suite: --env goes with --into")
        for place in (results, into, Path() if out is None and into is None else out and out.parent):
            if place is not None:
                make_folder(place)
        drawn = kept_nonce(results, None if nonce is None else nonce_of(nonce))
        common: dict[str, Any] = {"results": results, "seeds": seeds, "nonce": drawn, "jobs": jobs}
        with on_cluster(scheduler):
            runs = play_suite(specs, chosen, envs=env or (), progress=True, **common)
        written = []
        for spec in specs:
            suite_run = runs[spec]
            if every and not suite_run.results:
                note(f"{spec}: suits no environment of {suite}")
                continue
            bundle = make_bundle(spec, cards[spec], chosen, suite_run, seeds=seeds, with_source=source)
            files = [] if into is None else _enter(into, bundle.entries(), is_replacing=replace)
            if into is None or out is not None:
                place = out or Path(f"{bundle.manifest.localizer}.{suite}{SUFFIX}")
                files.append(save_bundle(bundle, place))
            written.append(_written(bundle, files))
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


def _written(bundle: Bundle, files: Sequence[Path]) -> dict[str, Any]:
    return {
        "localizer": bundle.manifest.localizer,
        "suite": bundle.manifest.suite,
        "environments": [record.env for record in bundle.manifest.environments],
        "runs": sum(len(record.walks) for record in bundle.manifest.environments),
        "failed": sum(walk.status == FAILED for record in bundle.manifest.environments for walk in record.walks),
        "unsuitable": bundle.manifest.unsuitable,
        "absent": bundle.manifest.absent,
        "nonce": bundle.manifest.nonce,
        "content_sha256": bundle.content_sha256,
        "files": [str(path) for path in files],
    }


@app.command("check")
def check(
    path: Annotated[Path, typer.Argument(metavar="FILE|FOLDER", help="A bundle, or the folder of an entry.")],
    into: Into = None,
    replace: Replace = False,
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
        _note_entered(_enter(into, checked.entries, is_replacing=replace))


@app.command("verify")
def verify(
    path: Annotated[Path, typer.Argument(metavar="FILE|FOLDER", help="A bundle, or the folder of an entry.")],
    rerun: Annotated[bool, typer.Option("--rerun", help="Run it again, isolated. Without it: as `check`.")] = False,
    share: Annotated[
        str,
        typer.Option(
            metavar="SHARE", help="Of the walks of each environment: below 1, a spot check, which never ranks."
        ),
    ] = ALL_WALKS,
    secret: Annotated[
        list[Path] | None,
        typer.Option(metavar="FILE", dir_okay=False, help="Secret behind held-out walks; repeat for several."),
    ] = None,
    seed: Annotated[
        int | None, typer.Option(metavar="N", min=0, help="Chooses the walks of a spot check.", show_default="random")
    ] = None,
    key: KeyFile = None,
    into: Into = None,
    replace: Replace = False,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    results: ResultsFolder = None,
    wheels: WheelsFolder = None,
    weights: WeightsFolder = None,
    packages: PackagesFolder = None,
    as_json: AsJson = False,
) -> None:
    """Check a submission, run it again, confined, and compare scores and places; exit 1 where they differ."""
    if not rerun:
        if secret or key is not None:
            raise BundleError("--secret and --key go with --rerun")
        check(path, into, replace, as_json)
        return
    with answer_only(as_json):
        import numpy as np

        from pdrbench.evaluation.cluster import on_cluster
        from pdrbench_leaderboard.checking import bundle_of, load_bundle
        from pdrbench_leaderboard.checking import check as check_path
        from pdrbench_leaderboard.folders import Supplies
        from pdrbench_leaderboard.pack import second_nonce
        from pdrbench_leaderboard.signing import check_listed
        from pdrbench_leaderboard.verify import Terms
        from pdrbench_leaderboard.verify import verify as verify_bundle

        terms = Terms(
            nonce="",
            secrets=tuple(map(read_secret, secret or ())),
            share=_fraction(share),
            draw=np.random.default_rng(seed),
            results=results,
            key=key,
            supplies=Supplies(wheels, weights, packages),
        )
        if terms.secrets and terms.share < 1:
            raise BundleError("--secret goes with a run of all walks, not with --share: a spot check never ranks")
        if key is not None:
            check_listed(key, into)  # raises before anything is run
        checked = check_path(path)
        broken = [finding for finding in checked.findings if not (finding.passed or finding.is_flag)]
        if broken:
            raise BundleError(f"{path}: {broken[0].name}: {broken[0].why}")
        bundle = bundle_of(checked.entries[0]) if path.is_dir() else load_bundle(path)
        if results is not None:
            make_folder(results)
        with on_cluster(scheduler):
            nonce = second_nonce(results, bundle.content_sha256)
            found = verify_bundle(bundle, replaced(terms, nonce=nonce), jobs=jobs, progress=True)
    differences = list(dict.fromkeys(what for one in found for what in one.differences))
    _print_verified(found, as_json=as_json, differences=differences)
    if differences:
        raise PdrbenchError(f"{path} is refused: {differences[0]}")
    if key is None:
        note("nothing was signed, so that no tier is given: --key FILE signs what was found")
    if into is not None:
        _note_entered(_enter(into, [one.entry for one in found], is_replacing=replace))


def _fraction(text: str) -> float:
    try:
        return 1.0 if text == ALL_WALKS else float(text)
    except ValueError:
        raise BundleError(f"--share is a number above 0 and at most 1, or {ALL_WALKS}; got {text!r}") from None


def read_secret(path: Path) -> str:
    """The secret in a file."""
    try:
        return path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise BundleError(f"cannot read the secret in {path}: {type(error).__name__}") from None


def verified_facts(one: Verified) -> dict[str, Any]:
    """What came of running an entry again, for `--json`."""
    entry, record = one.entry, one.record
    facts: dict[str, Any] = {"env": entry.env, "localizer": entry.localizer, "tier": entry.tier}
    if record is None:
        return facts | dict.fromkeys(("found", "reran", "of", "nonce", "isolation", "held_out"))
    facts |= {"found": record.tier, "reran": record.reran, "of": record.of}
    facts |= {"nonce": record.nonce, "isolation": sorted({str(way.get("mode", "")) for way in record.isolation})}
    return facts | {"held_out": None if record.held_out is None else held_out_facts(record.held_out)}


def held_out_facts(found: HeldOut) -> dict[str, Any]:
    """Means over held-out walks by metric, and how many runs failed or were declined."""
    means = {}
    for name, values in found.values.items():
        present = [value for value in values if value is not None]
        means[name] = sum(present) / len(present)
    return {"walks": len(found.units), "failed": found.failed, "declined": found.declined, "metrics": means}


def verified_line(facts: Mapping[str, Any]) -> str:
    """The same in one line."""
    if facts["found"] is None:
        return f"DIFFERS  {facts['env']}"
    signed = "" if facts["tier"] == facts["found"] else " (not signed)"
    line = f"{facts['found']}{signed}  {facts['env']}: {facts['reran']} of {facts['of']} runs come to the same"
    if held_out := facts["held_out"]:
        name, value = next(iter(held_out["metrics"].items()))
        line += f"; {held_out['walks']} held-out walks, {name} {value:.3g}"
        for what in ("failed", "declined"):
            line += f", {held_out[what]} runs {what}" if held_out[what] else ""
    return line


def _print_verified(found: Sequence[Verified], *, as_json: bool, differences: list[str]) -> None:
    rows = [verified_facts(one) for one in found]
    if as_json:
        print_json({"entries": rows, "differences": differences})
        return
    for row in rows:
        say(verified_line(row))
    for difference in differences:
        say(f"differs  {difference}")


def _note_entered(folders: Sequence[Path]) -> None:
    for folder in folders:
        note(f"entered {folder}")


def _enter(into: Path, entries: Sequence[Entry], *, is_replacing: bool) -> list[Path]:
    """Adds entries to a leaderboard; the folders that were written.

    Another entry of the same name stays, unless its authors are the same and it is to be replaced; a better tier of the
    same entry stays too.
    """
    from pdrbench_leaderboard.entry import folder_name, write_entry

    written = []
    for entry in [
        entry for entry in entries if _is_wanted(into / entry.env / folder_name(entry.localizer), entry, is_replacing)
    ]:
        written.append(write_entry(into, entry))
    return written


def _is_wanted(folder: Path, entry: Entry, is_replacing: bool) -> bool:
    """Whether an entry may take the place of what lies there; raises `BundleError` where that is another one."""
    from pdrbench_leaderboard.card import CARD_FILE, read_card
    from pdrbench_leaderboard.entry import SUBMISSION_FILE, read_entry
    from pdrbench_leaderboard.schema import MAX_TEXT_BYTES, read_limited
    from pdrbench_leaderboard.verification import TIERS

    if not (folder / SUBMISSION_FILE).exists():
        return True
    card = read_card(read_limited(folder / CARD_FILE, MAX_TEXT_BYTES), str(folder / CARD_FILE))
    if card.authors != entry.card.authors:
        raise BundleError(f"{folder} is an entry of other authors; choose another name in the card")
    if is_replacing:
        return True
    present = read_entry(folder)
    if present.sha256 != entry.sha256:
        raise BundleError(
            f"{folder} is another entry of this name: a change that moves an estimate is a new version, with a new "
            "name in the card; --replace where these authors take the old one back"
        )
    if TIERS.index(present.tier) > TIERS.index(entry.tier):
        note(f"left as it is, since it is {present.tier}: {folder}")
        return False
    return True
