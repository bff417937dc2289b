"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from pdrbench.errors import ResultError

IsolationKind = Literal["auto", "process", "none"]  # as `evaluate` takes it

LOCALIZER_HELP = "Registered id, package.module:Class or path/to/file.py:Class."

Split = Annotated[str, typer.Option(metavar="SPLIT", help="Walks of which split: train, val or test.")]
Seeds = Annotated[int, typer.Option(min=1, metavar="N", help="Repetitions of every walk, each with its own seed.")]
Walks = Annotated[
    int | None, typer.Option(min=1, metavar="N", help="Only the first N walks of an environment.", show_default="all")
]
Jobs = Annotated[int, typer.Option(min=1, metavar="N", help="Processes that share the walks.")]
Isolation = Annotated[
    IsolationKind,
    typer.Option(
        "--isolation",
        metavar="KIND",
        help="auto: a process for every walk, confined as far as the system lets us; process: only a process; "
        "none: this process, for debugging.",
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


def make_folder(folder: Path) -> Path:
    """The folder, made where it is missing, before any work is done for it."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ResultError(f"cannot make the folder {folder}: {error.strerror}; choose another place") from error
    return folder


def write_text(path: Path, text: str) -> Path:
    """Writes a file that the user asked for."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise ResultError(f"cannot write {path}: {error.strerror}; choose another place") from error
    return path
