"""`pdrbench submit card|pack|check|lock|install`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pdrbench.cli.options import LOCALIZER_HELP
from pdrbench.cli.output import AsJson, answer_only, note, print_json, say, verdict
from pdrbench.errors import BundleError

if TYPE_CHECKING:
    from pdrbench_leaderboard.schema import Finding

app = typer.Typer(no_args_is_help=True, help="Pack and check a submission.")

WheelsFolder = Annotated[
    Path | None, typer.Option("--wheels", metavar="FOLDER", file_okay=False, help="Wheels of what a folder has locked.")
]
WeightsFolder = Annotated[
    Path | None,
    typer.Option("--weights", metavar="FOLDER", file_okay=False, help="Weights that did not travel with a folder."),
]
PackagesFolder = Annotated[
    Path | None,
    typer.Option(
        "--packages",
        metavar="FOLDER",
        file_okay=False,
        help="Install wheels below this folder; on a cluster, one that all machines see.",
        show_default="beside the cache",
    ),
]
Folder = Annotated[Path, typer.Argument(metavar="FOLDER", exists=True, file_okay=False, help="A localizer.")]


@app.command("card")
def card(localizer: Annotated[str, typer.Argument(metavar="LOCALIZER", help=LOCALIZER_HELP)]) -> None:
    """Print a card to fill in."""
    from pdrbench_leaderboard.card import template

    say(template(localizer).rstrip("\n"))


@app.command("pack")
def pack(
    localizer: Annotated[str, typer.Argument(metavar="LOCALIZER", help=LOCALIZER_HELP)],
    card: Annotated[
        Path | None, typer.Option(metavar="FILE", dir_okay=False, help="card.toml.", show_default="beside the code")
    ] = None,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", dir_okay=False, help="The bundle.", show_default="<name>.pdrz")
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Pack the code of a localizer and its card into one file; nothing is run."""
    with answer_only(as_json):
        from pdrbench.evaluation.store import write_whole
        from pdrbench_leaderboard.bundle import SUFFIX, write_bundle
        from pdrbench_leaderboard.submission import make_bundle

        bundle = make_bundle(localizer, card)
        path = out or Path(f"{bundle.card.name}{SUFFIX}")
        write_whole(path, write_bundle(bundle))
    if as_json:
        print_json({"file": path, "localizer": bundle.card.name, "source": sorted(bundle.source)})
    else:
        say(f"{path}: {bundle.card.name}, with {', '.join(sorted(bundle.source)) or 'no code'}")


@app.command("check")
def check(path: Annotated[Path, typer.Argument(metavar="BUNDLE", dir_okay=False)], as_json: AsJson = False) -> None:
    """Check a bundle without running anything of it; exit 1 where it breaks a rule."""
    with answer_only(as_json):
        from pdrbench_leaderboard.submission import check_bundle

        findings = check_bundle(path)
    tell_findings(findings, as_json=as_json)


def tell_findings(findings: Sequence[Finding], *, as_json: bool) -> None:
    """Prints what was looked at; exits with 1 where anything is not as it should be."""
    if as_json:
        print_json({"checks": [{"name": f.name, "pass": f.passed, "why": f.why} for f in findings]})
    else:
        for found in findings:
            say(verdict(found.passed, found.name, found.why))
    if not all(found.passed for found in findings):
        raise typer.Exit(1)


@app.command("lock")
def lock(folder: Folder, wheels: WheelsFolder = None) -> None:
    """Write the lock that a folder names: every wheel of another folder, with its sha256."""
    from pdrbench.evaluation.store import write_whole
    from pdrbench.localizer_folder import read_settings
    from pdrbench_leaderboard.packages import lock_of, lock_text

    if wheels is None:
        raise BundleError("name the folder of wheels with --wheels")
    settings = read_settings(folder)
    if settings.requirements is None:
        raise BundleError(f'{folder}: its settings name no lock; add the line `requirements = "requirements.txt"`')
    locked = lock_of(wheels)
    write_whole(folder / settings.requirements, lock_text(locked).encode())
    say(f"{folder / settings.requirements}: {len(locked)} requirements")


@app.command("install")
def install(folder: Folder, wheels: WheelsFolder = None, packages: PackagesFolder = None) -> None:
    """Install what a folder has locked, as verification does, and print what to run then."""
    from pdrbench_leaderboard.folder_archive import pack_folder, read_archive
    from pdrbench_leaderboard.packages import default_place
    from pdrbench_leaderboard.packages import install as install_wheels

    installed = install_wheels(read_archive(pack_folder(folder)).lock, wheels, packages or default_place())
    for name, difference in installed.shared.items():
        note(f"{name} comes with pdrbench{f': {difference}' if difference else ''}")
    say(f"{folder}@{installed.folder}")
