"""Options that several commands share."""

from __future__ import annotations

import tempfile
import tomllib
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import typer

from pdrbench.cli.output import note
from pdrbench.errors import PdrbenchError, ResultError
from pdrbench.registry import environments, localizers
from pdrbench.settings import with_settings

IsolationKind = Literal["process", "none"]


def complete_env(incomplete: str) -> list[str]:
    """Ids of environments that begin so, for the shell."""
    return [name for name in environments() if name.startswith(incomplete)]


def complete_localizer(incomplete: str) -> list[str]:
    """Ids of localizers that begin so, for the shell."""
    return [name for name in localizers() if name.startswith(incomplete)]


LOCALIZER_HELP = (
    "Registered id, package.module:Class, path/to/file.py:Class or path/to/folder, with settings where wanted: "
    "'li2012?map=false'."
)

LocalizerList = Annotated[
    list[str] | None,
    typer.Option(
        metavar="LOCALIZER",
        autocompletion=complete_localizer,
        help=f"{LOCALIZER_HELP} Repeat for several.",
        show_default="all registered that suit",
    ),
]
Tuned = Annotated[Path | None, typer.Option("--settings", metavar="FILE", help="Settings that `pdrbench tune` wrote.")]
Split = Annotated[
    str | None, typer.Option(metavar="SPLIT", help="Walks of which split: train, val or test.", show_default="test")
]
Seeds = Annotated[int, typer.Option(min=1, metavar="N", help="Repetitions of every walk, each with its own seed.")]
Walks = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="Only the first N walks of an environment.", show_default="all")
]
Columns = Annotated[
    str,
    typer.Option(
        metavar="NAMES",
        help="Columns of the tables, as rank,p95_m,outside_pct; `pdrbench list metrics` has their names.",
        show_default="rank,ratio_to_best,p75_geometric_m,mean_m,lost",
    ),
]
AllColumns = Annotated[
    bool,
    typer.Option(
        "--all-columns", help="Besides the usual columns those of level, map, coverage and time, where they apply."
    ),
]
Strict = Annotated[
    bool, typer.Option("--strict", help="Exit 1 where any walk failed, not only where every walk of a localizer did.")
]
Jobs = Annotated[int, typer.Option(min=1, metavar="N", help="Processes that share the walks.")]
Isolation = Annotated[
    IsolationKind,
    typer.Option(
        "--isolation",
        metavar="KIND",
        help="process: a process of its own, which plays one walk after the other; none: this process, for debugging.",
    ),
]
Confined = Annotated[
    bool,
    typer.Option(
        "--confined",
        help="Play every walk alone, as strangers' code is verified: without files, networks and other processes. "
        "Linux only.",
    ),
]
Nonce = Annotated[
    str,
    typer.Option(
        "--nonce",
        metavar="TEXT",
        help="What randomness depends on besides seed and walk: 32 hexadecimal digits, or `new` to draw them.",
        show_default="none: the same in every run",
    ),
]
Scheduler = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Dask scheduler whose workers compute the walks, as tcp://10.0.0.1:8786; results go to a folder that they "
        "all see.",
        show_default="this machine",
    ),
]


def isolation_of(isolation: IsolationKind, *, confined: bool) -> Literal["process", "confined", "none"]:
    """What localizers run in, as `evaluate` takes it."""
    if confined and isolation == "none":
        raise PdrbenchError("--confined is of a process of its own, and --isolation none of this one: leave one out")
    return "confined" if confined else isolation


def tuned_name(path: Path, localizer: str | None = None) -> str:
    """The localizer of a file that `tune` wrote, with the settings there; `localizer` is the one it has to be."""
    try:
        found = tomllib.loads(path.read_text(encoding="utf-8"))
        if localizer not in (None, found["localizer"]):
            raise ValueError(f"its settings are of {found['localizer']}, not of {localizer}")
        return with_settings(found["localizer"], found["settings"])
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise PdrbenchError(f"cannot read {path} as `pdrbench tune` writes it: {error!r}") from error


def columns_of(names: str, *, shows_all: bool) -> tuple[str, ...] | None:
    """Columns that were asked for; None for the usual ones."""
    from pdrbench.evaluation.wording import ALL_COLUMNS, check_columns

    if names and shows_all:
        raise PdrbenchError("--columns names the columns and --all-columns shows all: leave one out")
    return ALL_COLUMNS if shows_all else check_columns([name.strip() for name in names.split(",")]) if names else None


def make_folder(folder: Path) -> Path:
    """The folder, made where it is missing and known to take files, before any work is done for it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return folder
    except OSError as error:
        verb = "write into" if folder.is_dir() else "make"
        raise ResultError(f"cannot {verb} the folder {folder}: {error.strerror}; choose another place") from error


def write_text(path: Path, text: str) -> Path:
    """Writes a file that the user asked for."""
    try:
        path.write_text(text, encoding="utf-8", newline="\n")
    except OSError as error:
        raise ResultError(f"cannot write {path}: {error.strerror}; choose another place") from error
    return path


def exit_on(failures: Sequence[str]) -> None:
    """Ends the command with status 1 where something failed, each in a line of its own."""
    for line in failures:
        note(line)
    if failures:
        raise typer.Exit(1)


def nonce_of(text: str) -> str:
    """The nonce that was asked for: a new one for `new`."""
    from pdrbench.evaluation.randomness import check_nonce, new_nonce

    return new_nonce() if text == "new" else check_nonce(text)
