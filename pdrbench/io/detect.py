"""Recognises the format of a file or folder by its content, and reads it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pdrbench.errors import RecordingError, not_loaded
from pdrbench.io import READERS
from pdrbench.io.reader import head_of


def detect(path: Path | str) -> str:
    """The format of a file or folder: a key of `READERS`, the first that recognises it.

    Raises:
        RecordingError: It is missing or damaged, or in no format that is known; says which are.
    """
    head = head_of(Path(path))
    damage = None
    broken = READERS.broken()
    loaded = {name: READERS[name] for name in READERS if name not in broken}
    for name in sorted(loaded, key=lambda name: loaded[name].fallback):
        try:
            if loaded[name].sniff(head):
                return name
        except RecordingError as error:  # another format may recognise what this one takes for damaged
            damage = damage or error
    if damage is not None:
        raise damage
    members = ", ".join(head.members()[:3])
    raise RecordingError(
        f"{path}: in no format that pdrbench knows ({', '.join(sorted(READERS))}); name the format where its content "
        f"does not show it{f', or one of the files in it ({members}, ...)' if members else ''}{not_loaded(broken)}"
    )


def read(path: Path | str, kind: str | None = None, **options: Any) -> Any:
    """Reads a file or folder by the reader of its format.

    Args:
        path: Of the file or folder.
        kind: A key of `READERS`; None to recognise the format by the content.
        options: Of the reader; `strict=False` is passed to those that know it.

    Returns:
        What that reader returns: a `Log`, a `Recording`, a `Building`, or a record of its own.

    Raises:
        RecordingError, MapError: No such format, or as the reader says; or it has no such option.
    """
    kind = detect(path) if kind is None else kind
    reader = READERS[kind]
    if "strict" not in reader.options:
        options.pop("strict", None)
    for option in options.keys() - set(reader.options):
        raise RecordingError(f"{path}: the format {kind} has no option {option!r}; leave it out")
    return reader.read(Path(path), **options)
