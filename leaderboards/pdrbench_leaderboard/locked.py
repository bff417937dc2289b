"""Locked requirements: a file in pip's format in which every line names one version and its digests."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from packaging.markers import InvalidMarker, Marker, UndefinedComparison, UndefinedEnvironmentName
from packaging.utils import InvalidName, canonicalize_name
from packaging.version import InvalidVersion, Version

from pdrbench.errors import BundleError

MAX_LOCK_BYTES: Final = 2_000_000
MAX_LOCKED: Final = 500
MAX_LINE_CHARACTERS: Final = 100_000  # a line has the digests of every file of a version
PINNED: Final = re.compile(
    r"(?P<name>[A-Za-z0-9][A-Za-z0-9._-]{0,99})\s*(\[[A-Za-z0-9._, -]{0,200}\])?\s*==\s*"
    r"(?P<version>[A-Za-z0-9.!+_-]{1,99})\s*(;(?P<marker>.{1,1000}))?\Z"
)
HASHES: Final = re.compile(r"\s--hash=")
SHA256: Final = re.compile(r"sha256:([0-9a-f]{64})")
# Options that say where pip downloads from, which nothing is here
PLACES: Final = re.compile(r"(--index-url|-i|--extra-index-url|--find-links|-f|--trusted-host|--only-binary)[ =]")
HOW_TO_LOCK: Final = (
    "lock them with hashes: `pdrbench submit lock FOLDER --wheels DIR` after `pip download --only-binary :all: -d DIR "
    "NAME...`, or `pip-compile --generate-hashes`"
)


@dataclass(frozen=True, slots=True)
class Locked:
    """One requirement."""

    name: str  # normalised
    version: str  # likewise
    sha256: frozenset[str]  # of each file that may be installed


def parse_lock(content: bytes, what: str) -> tuple[Locked, ...]:
    """The requirements of this system in a lock, by name.

    Args:
        content: Of an untrusted file.
        what: What the error calls it.

    Raises:
        BundleError: A requirement has no version or no digest, or the file holds anything else.
    """
    if len(content) > MAX_LOCK_BYTES:
        raise BundleError(f"{what} has {len(content)} bytes, {MAX_LOCK_BYTES} are allowed")
    try:
        text = content.decode()
    except UnicodeDecodeError as error:
        raise BundleError(f"{what} is no text: {error.reason}") from None
    found: dict[str, Locked] = {}
    for line in _lines(text, what):
        if PLACES.match(line):
            continue
        locked = _locked(line, what)
        if locked is None:
            continue
        if found.setdefault(locked.name, locked) != locked:
            raise BundleError(f"{what} locks {locked.name} twice")
        if len(found) > MAX_LOCKED:
            raise BundleError(f"{what} has more than {MAX_LOCKED} requirements")
    return tuple(found[name] for name in sorted(found))


def lock_text(locked: tuple[Locked, ...]) -> str:
    """Requirements in pip's format."""
    lines = []
    for one in locked:
        lines.append(
            " \\\n    ".join([f"{one.name}=={one.version}", *(f"--hash=sha256:{d}" for d in sorted(one.sha256))])
        )
    return "\n".join(lines) + "\n" if lines else ""


def _lines(text: str, what: str) -> Iterator[str]:
    """Lines that are continued are one; comments and empty ones are left out."""
    parts: list[str] = []
    length = 0
    for line in (*text.splitlines(), ""):
        parts.append(line.removesuffix("\\"))
        length += len(line)
        if length > MAX_LINE_CHARACTERS:
            raise BundleError(f"{what}: a line has more than {MAX_LINE_CHARACTERS} characters")
        if not line.endswith("\\"):
            whole = re.sub(r"(^|\s)#.*", "", " ".join(parts)).strip()
            parts, length = [], 0
            if whole:
                yield whole


def _locked(line: str, what: str) -> Locked | None:
    """The requirement in a line; None where it is one of another system."""
    shown = line[:80]
    pinned, *hashes = HASHES.split(line)
    match = PINNED.match(pinned.strip())
    if match is None:
        raise BundleError(f"{what}: {shown!r} is not one version with its hashes, as 'name==1.2 --hash=sha256:...'")
    try:
        name, version = canonicalize_name(match["name"], validate=True), str(Version(match["version"]))
        if match["marker"] is not None and not Marker(match["marker"].strip()).evaluate({"extra": ""}):
            return None
    except (InvalidName, InvalidVersion, InvalidMarker, UndefinedComparison, UndefinedEnvironmentName) as error:
        raise BundleError(f"{what}: {shown!r}: {error}") from None
    except RecursionError:
        raise BundleError(f"{what}: {shown!r} is nested too deeply") from None
    digests = [found[1] for part in hashes if (found := SHA256.fullmatch(part.strip()))]
    if not digests or len(digests) < len(hashes):
        raise BundleError(f"{what}: {name} has no sha256 of its files; {HOW_TO_LOCK}")
    return Locked(name, version, frozenset(digests))
