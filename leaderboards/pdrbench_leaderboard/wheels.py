"""Packages for a localizer, unpacked from a folder of wheels: offline, by digest, and nothing of them is run.

What pdrbench itself needs is not installed again: a localizer finds the version that is here, whatever it has locked.
"""

from __future__ import annotations

import contextlib
import email
import hashlib
import json
import os
import platform
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from packaging.markers import UndefinedComparison, UndefinedEnvironmentName
from packaging.requirements import InvalidRequirement, Requirement
from packaging.tags import sys_tags
from packaging.utils import InvalidWheelFilename, parse_wheel_filename
from packaging.version import InvalidVersion

from pdrbench.datasets.folders import cache_folder
from pdrbench.errors import BundleError
from pdrbench.isolation.shared_modules import normalised, shared_distributions
from pdrbench.localizer_folder import file_sha256
from pdrbench_leaderboard import wheel_unpacking
from pdrbench_leaderboard.locked import HOW_TO_LOCK, Locked

MAX_METADATA_BYTES: Final = 2_000_000
UNPACK_S: Final = 600.0
KEY_CHARACTERS: Final = 32


@dataclass(frozen=True, slots=True)
class Installed:
    """Packages that were made ready."""

    folder: Path
    shared: dict[str, str]  # locked and not installed, since pdrbench brings it: "1.2 here, 1.1 is locked", or ""


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
        BundleError: A wheel is missing, another one than was locked or for another system, or cannot be unpacked; or
            a package needs one that is not locked.
    """
    ours = shared_distributions()
    shared = {
        one.name: "" if ours[one.name] == one.version else f"{ours[one.name]} here, {one.version} is locked"
        for one in lock
        if one.name in ours
    }
    chosen = [find_wheel(one, wheels) for one in lock if one.name not in shared]
    folder = place / _key(chosen)
    if not folder.is_dir():
        place.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".unpacking-", dir=place) as temporary:
            made = Path(temporary) / "packages"
            made.mkdir()
            _unpack(chosen, made)
            _check_needs(made, {*ours, *(one.name for one in lock)})
            with contextlib.suppress(OSError):  # another process was faster
                made.rename(folder)
            if made.exists() and not folder.is_dir():
                raise BundleError(f"cannot move packages to {folder}")
    return Installed(folder, shared)


def find_wheel(locked: Locked, wheels: Path | None) -> Path:
    """The wheel of a requirement for this Python; raises `BundleError`, for each reason another."""
    name = f"{locked.name} {locked.version}"
    if wheels is None:
        raise BundleError(f"the localizer requires {name}: name a folder of wheels with --wheels")
    try:
        files = sorted(wheels.glob("*.whl"))
    except OSError as error:
        raise BundleError(f"cannot read {wheels}: {error.strerror}") from error
    tags, found, fitting = frozenset(sys_tags()), [], []
    for file in files:
        with contextlib.suppress(InvalidWheelFilename, InvalidVersion):
            its_name, version, _, its_tags = parse_wheel_filename(file.name)
            if (its_name, str(version)) == (locked.name, locked.version):
                found.append(file)
                fitting += [file] if its_tags & tags else []
    if not found:
        raise BundleError(
            f"no wheel of {name} is in {wheels}: `pip download --no-deps --only-binary :all: -d {wheels} "
            f"{locked.name}=={locked.version}` brings it"
        )
    if not fitting:
        here = f"Python {platform.python_version()} on {platform.machine()}"
        raise BundleError(f"the wheel {found[0].name} is not for {here}")
    for file in fitting:
        if file_sha256(file) in locked.sha256:
            return file
    raise BundleError(f"the wheel {fitting[0].name} is not the one that was locked: its sha256 is another")


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
        found[name] = Locked(name, one.version, one.sha256 | {file_sha256(file)})
    if not found:
        raise BundleError(f"no wheels in {wheels} but of what pdrbench brings; {HOW_TO_LOCK}")
    return tuple(found[name] for name in sorted(found))


def _key(chosen: Sequence[Path]) -> str:
    """The same for the same wheels on the same kind of Python."""
    what = [sys.implementation.cache_tag, sys.platform, platform.machine(), *map(file_sha256, chosen)]
    return hashlib.sha256("\n".join(map(str, what)).encode()).hexdigest()[:KEY_CHARACTERS]


def _unpack(chosen: Sequence[Path], folder: Path) -> None:
    """Unpacks wheels in a process that can read these wheels, write this folder, and nothing else."""
    orders = {"wheels": [str(path.resolve()) for path in chosen], "folder": str(folder.resolve()), "path": sys.path}
    run = subprocess.run(
        [sys.executable, "-s", "-P", "-B", wheel_unpacking.__file__],
        input=json.dumps(orders),
        capture_output=True,
        text=True,
        check=False,
        timeout=UNPACK_S,
        env={"PATH": os.defpath, "LANG": "C.UTF-8", "SYSTEMROOT": os.environ.get("SYSTEMROOT", "")},
        cwd=folder,
    )
    if run.returncode:
        lines = run.stderr.strip().splitlines() or [f"its process ended with code {run.returncode}"]
        shutil.rmtree(folder, ignore_errors=True)
        raise BundleError(f"wheels cannot be unpacked: {lines[-1][:300]}")


def _check_needs(folder: Path, known: set[str]) -> None:
    """Raises `BundleError` where a package needs one that is neither locked nor brought by pdrbench."""
    for metadata in sorted(folder.glob("*.dist-info/METADATA")):
        if metadata.stat().st_size > MAX_METADATA_BYTES:
            raise BundleError(f"{metadata.parent.name} describes itself in more than {MAX_METADATA_BYTES} bytes")
        headers = email.message_from_bytes(metadata.read_bytes())
        for line in headers.get_all("Requires-Dist") or ():
            with contextlib.suppress(InvalidRequirement, UndefinedComparison, UndefinedEnvironmentName):
                needed = Requirement(str(line))
                applies = needed.marker is None or needed.marker.evaluate({"extra": ""})
                if applies and normalised(needed.name) not in known:
                    who = str(headers.get("Name", metadata.parent.name))
                    raise BundleError(f"{who} needs {needed.name}, which is not locked; {HOW_TO_LOCK}")
