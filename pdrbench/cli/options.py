"""Options that several commands share."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from pdrbench.errors import PdrbenchError, ResultError

IsolationKind = Literal["auto", "process", "none"]  # as `evaluate` takes it

LOCALIZER_HELP = "Registered id, package.module:Class, path/to/file.py:Class or path/to/folder."

Split = Annotated[
    str | None,
    typer.Option(metavar="SPLIT", help="Walks of which split: train, val or test.", show_default="test, val if sealed"),
]
Why = Annotated[
    str, typer.Option(metavar="REASON", help="Why you look at the test split of a sealed environment: it is counted.")
]
Folds = Annotated[
    int, typer.Option(min=2, metavar="N", help="Parts of the train split, each of whole sessions or buildings.")
]
FoldsOrNone = Annotated[
    int | None,
    typer.Option(
        "--folds",
        min=2,
        metavar="N",
        help="Play the train split, each walk without what its fold contributes to the survey, and show each fold.",
        show_default="no folds",
    ),
]
Seeds = Annotated[int, typer.Option(min=1, metavar="N", help="Repetitions of every walk, each with its own seed.")]
SeedsOrNone = Annotated[
    int | None,
    typer.Option(
        min=1,
        metavar="N",
        help="Repetitions of every walk, each with its own seed.",
        show_default="1; 3 where a localizer draws random numbers",
    ),
]
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


def nonce_of(text: str) -> str:
    """The nonce that was asked for: a new one for `new`."""
    from pdrbench.evaluation.randomness import check_nonce, new_nonce

    return new_nonce() if text == "new" else check_nonce(text)


def train_of(folds: int | None, split: str | None) -> str | None:
    """The split to play: folds are parts of train."""
    if folds is None:
        return split
    if split not in (None, "train"):
        raise PdrbenchError(f"folds are parts of the train split; got --folds {folds} with --split {split}")
    return "train"
