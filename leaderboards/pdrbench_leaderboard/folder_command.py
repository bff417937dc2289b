"""`pdrbench submit lock|install`: the requirements of a localizer that is a folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pdrbench.cli.output import note, say
from pdrbench.errors import BundleError

WheelsFolder = Annotated[
    Path | None,
    typer.Option("--wheels", metavar="FOLDER", file_okay=False, help="Wheels of what a folder has locked."),
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


def add_folder_commands(app: typer.Typer) -> None:
    """Adds them to the commands of `submit`."""
    app.command("lock")(lock)
    app.command("install")(install)


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


def install(folder: Folder, wheels: WheelsFolder = None, packages: PackagesFolder = None) -> None:
    """Install what a folder has locked, as verification does, and print what to run then."""
    from pdrbench_leaderboard.folder_archive import pack_folder, read_archive
    from pdrbench_leaderboard.packages import default_place
    from pdrbench_leaderboard.packages import install as install_wheels

    installed = install_wheels(read_archive(pack_folder(folder)).lock, wheels, packages or default_place())
    for name, difference in installed.shared.items():
        note(f"{name} comes with pdrbench{f': {difference}' if difference else ''}")
    say(f"{folder}@{installed.folder}")
