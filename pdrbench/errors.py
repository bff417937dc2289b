"""Errors that a user can fix: what was expected, what came, what to do."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from typing import Any, Final

MAX_NAMES: Final = 24  # an error lists: every environment, not every walk


class PdrbenchError(Exception):
    """Root of every error whose cause lies outside pdrbench; the command line prints it without traceback."""


class MapError(PdrbenchError):
    """A building or map file is wrong; names polygon and edge."""


class RecordingError(PdrbenchError):
    """A recording or log file is wrong; names file, line or row."""


class RecordingWarning(UserWarning):
    """A recording can be used, and something in it will make results worse."""


class DatasetError(PdrbenchError):
    """Recorded data is missing, incomplete or differs from its registered hash."""


REFUSALS: Final = (MapError, RecordingError)  # by which a walk is refused: a failure of that walk and of no other


class EstimateError(PdrbenchError):
    """An estimate that cannot be scored: wrong shape, not finite, or none."""


class UnsuitableError(PdrbenchError):
    """A localizer cannot work with what the briefing offers (no such sensor, no radio map, no start)."""


class ResultError(PdrbenchError):
    """A stored result is incomplete, of another kind or does not fit its environment."""


class BundleError(PdrbenchError):
    """A bundle, an entry of a leaderboard or a card is not what `pdrbench submit pack` writes."""


class PluginError(PdrbenchError):
    """Something registered or named cannot be loaded; names the package or file and its own error."""


class UnknownNameError(PdrbenchError):
    """No such name; suggests the nearest one."""


def plain_text(text: str) -> str:
    """A text without what a terminal would obey or a reader not see: control characters, and marks of direction.

    >>> plain_text("a\\x1b[2Jb\\n\\tc")
    'a?[2Jb\\n\\tc'
    """
    return "".join(sign if sign in "\n\t" or sign.isprintable() else "?" for sign in text)


def plain_value(value: Any) -> Any:
    """A text from outside as it goes into a page: without marks of direction; what is HTML already stays."""
    return plain_text(value) if type(value) is str else value


def plain_line(text: str) -> str:
    """The same on one line, so that a text from outside forges none.

    >>> plain_line("no idea\\npdrbench: all passed")
    'no idea pdrbench: all passed'
    """
    return plain_text(" ".join(text.splitlines())).replace("\t", " ").replace("\n", " ").strip()


def plain_cell(text: str) -> str:
    """The same as a cell of a table that a spreadsheet opens: what it would compute is marked as text.

    >>> plain_cell("=1+1"), plain_cell("walk-1")
    ("'=1+1", 'walk-1')
    """
    line = plain_line(text)
    return f"'{line}" if line.startswith(("=", "+", "-", "@")) else line


def quoted(text: str) -> str:
    """The same over several lines, each of which shows that it is not pdrbench's."""
    return "\n".join(f"  | {line}" for line in plain_text(text).splitlines())


def not_loaded(reasons: Mapping[str, str]) -> str:
    """Lines below an error, each with the name and the reason of something registered that could not be loaded."""
    return "".join(f"\n    (not loaded: {name!r}: {reason})" for name, reason in reasons.items())


def unknown_name(
    kind: str, name: object, known: Iterable[str], broken: Mapping[str, str] | None = None
) -> UnknownNameError:
    """Builds the error for a name that is not registered.

    Args:
        kind: What was asked for, as in "localizer".
        name: What is not known, usually a name.
        known: Every registered name.
        broken: Reason by name for what is registered and could not be loaded.
    """
    known = sorted(known)
    near = difflib.get_close_matches(str(name), known, n=1, cutoff=0.5)
    if near:
        remedy = f"did you mean {near[0]!r}?"
    elif known:
        more = f" and {len(known) - MAX_NAMES} more" if len(known) > MAX_NAMES else ""
        remedy = f"known: {', '.join(known[:MAX_NAMES])}{more}"
    else:
        remedy = f"no {kind} is registered"
    return UnknownNameError(f"no {kind} named {name!r}; {remedy}{not_loaded(broken or {})}")
