"""Packages that a folder requires: a lock in pip's format, and pip that installs what it names from a folder of wheels.

What pdrbench itself needs is not installed again: a localizer finds the version that is here, whatever it has locked.
Nothing of a wheel is run, and pip asks no index.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import platform
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from packaging.markers import UndefinedEnvironmentName
from packaging.requirements import InvalidRequirement, Requirement
from packaging.utils import InvalidWheelFilename, canonicalize_name, parse_wheel_filename
from packaging.version import InvalidVersion, Version

from pdrbench.datasets.folders import cache_folder
from pdrbench.errors import BundleError
from pdrbench.files import sha256_of
from pdrbench_leaderboard.confine.shared_modules import shared_distributions

MAX_LOCK_BYTES: Final = 2_000_000
MAX_LOCKED: Final = 500
MAX_REQUIREMENT_CHARACTERS: Final = 1_000
INSTALL_S: Final = 600.0
KEY_CHARACTERS: Final = 32
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


@dataclass(frozen=True, slots=True)
class Installed:
    """Packages that were made ready."""

    folder: Path
    shared: dict[str, str]  # locked and not installed, since pdrbench brings it: "1.2 here, 1.1 is locked", or ""


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
    for line in _lines(text):
        locked = None if PLACES.match(line) else _locked(line, what)
        if locked is not None and found.setdefault(locked.name, locked) != locked:
            raise BundleError(f"{what} locks {locked.name} twice")
        if len(found) > MAX_LOCKED:
            raise BundleError(f"{what} has more than {MAX_LOCKED} requirements")
    return tuple(found[name] for name in sorted(found))


def lock_text(locked: Sequence[Locked]) -> str:
    """Requirements in pip's format."""
    lines = []
    for one in locked:
        hashes = [f"--hash=sha256:{digest}" for digest in sorted(one.sha256)]
        lines.append(" \\\n    ".join([f"{one.name}=={one.version}", *hashes]) + "\n")
    return "".join(lines)


def lock_of(wheels: Path) -> tuple[Locked, ...]:
    """Everything in a folder of wheels but what pdrbench brings, locked; raises `BundleError`."""
    found: dict[str, Locked] = {}
    for file in sorted(wheels.glob("*.whl")):
        try:
            name, version, _, _ = parse_wheel_filename(file.name)
        except (InvalidWheelFilename, InvalidVersion) as error:
            raise BundleError(f"{file}: {error}") from None
        if str(name) in shared_distributions():
            continue
        one = found.setdefault(name, Locked(name, str(version), frozenset()))
        if one.version != str(version):
            raise BundleError(f"{wheels} has {name} in two versions, {one.version} and {version}; keep one")
        found[name] = Locked(name, one.version, one.sha256 | {sha256_of(file)})
    if not found:
        raise BundleError(f"no wheels in {wheels} but of what pdrbench brings; {HOW_TO_LOCK}")
    return tuple(found[name] for name in sorted(found))


def default_place() -> Path:
    """Where packages are kept: beside the cache of data sets, which no localizer can read."""
    cache = cache_folder().absolute()
    return cache.with_name(f"{cache.name}-packages")


def install(lock: Sequence[Locked], wheels: Path | None, place: Path) -> Installed:
    """A folder with what a lock names, made once for each lock and Python.

    Args:
        lock: From `parse_lock`.
        wheels: Folder of wheels; None where there is none.
        place: Below which the folder is made.

    Raises:
        BundleError: A wheel is missing, another one than was locked or for another system: what pip says.
    """
    ours = shared_distributions()
    shared = {
        one.name: "" if ours[one.name] == one.version else f"{ours[one.name]} here, {one.version} is locked"
        for one in lock
        if one.name in ours
    }
    text = lock_text([one for one in lock if one.name not in shared])
    if text and wheels is None:
        raise BundleError(f"the localizer requires {text.split()[0]}: name a folder of wheels with --wheels")
    kind = f"{sys.implementation.cache_tag} {sys.platform} {platform.machine()}\n"
    folder = place / hashlib.sha256((kind + text).encode()).hexdigest()[:KEY_CHARACTERS]
    if not folder.is_dir():
        place.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".installing-", dir=place) as temporary:
            made = Path(temporary) / "packages"
            made.mkdir()
            if text:
                _run_pip(text, str(wheels), made)
            with contextlib.suppress(OSError):  # another process was faster
                made.rename(folder)
        if not folder.is_dir():
            raise BundleError(f"cannot move packages to {folder}")
    return Installed(folder, shared)


def _run_pip(text: str, wheels: str, folder: Path) -> None:
    lock = folder.with_name("lock.txt")
    lock.write_text(text, encoding="utf-8")
    options = ["--isolated", "--disable-pip-version-check", "--no-input", "--quiet", "--no-compile", "--no-deps"]
    options += ["--no-index", "--require-hashes", "--only-binary", ":all:", "--find-links", wheels]
    run = subprocess.run(
        [sys.executable, "-m", "pip", "install", *options, "--target", str(folder), "--requirement", str(lock)],
        capture_output=True,
        text=True,
        check=False,
        timeout=INSTALL_S,
        env={**os.environ, "PIP_NO_CACHE_DIR": "1"},
    )
    if run.returncode:
        lines = [line.strip() for line in run.stderr.splitlines() if line.strip()]
        why = " ".join(lines)[:500] or f"it ended with code {run.returncode}"
        raise BundleError(f"pip cannot install what is locked from {wheels}: {why}")


def _lines(text: str) -> Iterator[str]:
    """Lines that are continued are one; comments and empty ones are left out."""
    for line in re.sub(r"\\\r?\n", " ", text).splitlines():
        if whole := re.sub(r"(^|\s)#.*", "", line).strip():
            yield whole


def _locked(line: str, what: str) -> Locked | None:
    """The requirement in a line; None where it is one of another system."""
    pinned, *hashes = HASHES.split(line)
    if len(pinned) > MAX_REQUIREMENT_CHARACTERS:
        raise BundleError(f"{what}: a requirement has more than {MAX_REQUIREMENT_CHARACTERS} characters")
    try:
        needed = Requirement(pinned.strip())
        name = canonicalize_name(needed.name, validate=True)
        (version,) = needed.specifier
        if version.operator != "==" or needed.url is not None:
            raise InvalidRequirement("no single version")
        exact = str(Version(version.version))
        if needed.marker is not None and not needed.marker.evaluate({"extra": ""}):
            return None
    except (ValueError, UndefinedEnvironmentName, RecursionError):  # packaging has its own kinds of the first
        shown = pinned[:80]
        raise BundleError(
            f"{what}: {shown!r} is not one version with its hashes, as 'name==1.2 --hash=sha256:...'"
        ) from None
    digests = [found[1] for part in hashes if (found := SHA256.fullmatch(part.strip()))]
    if not digests or len(digests) < len(hashes):
        raise BundleError(f"{what}: {name} has no sha256 of its files; {HOW_TO_LOCK}")
    return Locked(name, exact, frozenset(digests))
