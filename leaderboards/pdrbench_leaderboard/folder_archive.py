"""A folder as one member of a bundle: a zip of its files, stored as they are.

Sources are text; weights travel with it up to a limit, and are put beside it by their digests otherwise.
"""

from __future__ import annotations

import hashlib
import shutil
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from pdrbench.errors import BundleError, PluginError
from pdrbench.files import sha256_of
from pdrbench.localizer_folder import (
    MAX_FILES,
    MAX_SOURCE_BYTES,
    PATH,
    PROJECT_FILE,
    SETTINGS_FILE,
    Settings,
    list_files,
    parse_settings,
    read_settings,
    weights_toml,
)
from pdrbench_leaderboard.bundle import read_members, write_members
from pdrbench_leaderboard.packages import Locked, parse_lock
from pdrbench_leaderboard.schema import Finding

ARCHIVE_FILE: Final = "folder.zip"  # its name in a bundle
MAX_WEIGHTS_INSIDE: Final = 48_000_000  # bytes of all that travel with it


@dataclass(frozen=True, slots=True)
class Archive:
    """A folder that was read and not unpacked."""

    settings: Settings
    files: Mapping[str, bytes]  # content by path: sources and weights
    lock: tuple[Locked, ...]  # its requirements
    absent: tuple[str, ...]  # declared weights that did not travel with it

    @property
    def summary(self) -> str:
        """What is in it, in one line."""
        weights = len(self.settings.weights)
        beside = f", {len(self.absent)} of them beside it" if self.absent else ""
        return f"{len(self.files)} files, {weights} of weights{beside}, {len(self.lock)} locked requirements"


def pack_folder(folder: Path) -> bytes:
    """The archive of a folder; the same folder gives the same bytes.

    Raises:
        PluginError: It is no localizer, or not as it was declared.
        BundleError: It holds a binary file that is not declared, or its lock cannot be read.
    """
    settings = read_settings(folder)
    files = list_files(folder, settings)
    members = {}
    for name in files:
        if name in settings.weights:
            continue
        try:
            members[name] = (folder / name).read_bytes()
        except OSError as error:
            raise BundleError(f"cannot read {folder / name}: {error.strerror}") from error
        if not _is_text(members[name]):
            raise BundleError(
                f"{folder}: {name} is no text; declare it as weights in {SETTINGS_FILE}, or take it away:\n"
                f"{weights_toml(folder, name)}"
            )
    left = MAX_WEIGHTS_INSIDE
    for name, weights in sorted(settings.weights.items(), key=lambda item: item[1].bytes):
        left -= weights.bytes
        if left >= 0:
            members[name] = (folder / name).read_bytes()
    content = write_members(dict(sorted(members.items())))
    read_archive(content)
    return content


def read_archive(content: bytes) -> Archive:
    """The folder in the bytes of an untrusted file: nothing of it is executed, written or looked up.

    Raises:
        BundleError: It is no such archive, or anything of it is not as its settings say.
    """
    files = read_members(content, PATH)
    name = SETTINGS_FILE if SETTINGS_FILE in files else PROJECT_FILE
    if name not in files:
        raise BundleError(f"the folder has neither {SETTINGS_FILE} nor {PROJECT_FILE}")
    try:
        settings = parse_settings(files[name], is_project=name == PROJECT_FILE)
    except PluginError as error:
        raise BundleError(f"the folder's {name}: {error}") from None
    size = sum(len(file) for path, file in files.items() if path not in settings.weights)
    if len(files) > MAX_FILES or size > MAX_SOURCE_BYTES:
        raise BundleError(f"the folder has more than {MAX_FILES} files or {MAX_SOURCE_BYTES} bytes without weights")
    seen: set[str] = set()
    for path in sorted(files, key=str.lower):
        if path.lower() in seen:
            raise BundleError(f"the folder has two files named {path}, but for capitals")
        seen.add(path.lower())
        if any(path.startswith(f"{other}/") for other in files):
            raise BundleError(f"the folder has a file and a folder of the same name on the way to {path}")
    for path, file in files.items():
        declared = settings.weights.get(path)
        if declared is None and not _is_text(file):
            raise BundleError(f"the folder's {path} is no text and not declared as weights")
        if declared is not None and hashlib.sha256(file).hexdigest() != declared.sha256:
            raise BundleError(f"the folder's weights {path} are not those that it declares")
    if settings.requirements is not None and settings.requirements not in files:
        raise BundleError(f"the folder's lock is missing: {settings.requirements}")
    lock = () if settings.requirements is None else parse_lock(files[settings.requirements], settings.requirements)
    absent = tuple(sorted(settings.weights.keys() - files.keys()))
    return Archive(settings, files, lock, absent)


def folder_findings(source: Mapping[str, bytes]) -> list[Finding]:
    """Whether a folder that travels with a bundle can be read; none where there is no folder."""
    if ARCHIVE_FILE not in source:
        return []
    try:
        return [Finding("its folder", True, read_archive(source[ARCHIVE_FILE]).summary)]
    except BundleError as error:
        return [Finding("its folder", False, str(error))]


def unpack(archive: Archive, folder: Path, weights: Path | None = None) -> None:
    """Writes a folder, with the weights that did not travel with it.

    Args:
        archive: From `read_archive`.
        folder: Made where it is missing.
        weights: Folder with files of weights, whatever they are called.

    Raises:
        BundleError: It is for another Python, or weights are missing.
    """
    here = f"{sys.version_info.major}.{sys.version_info.minor}"
    if archive.settings.python not in ("", here):
        raise BundleError(
            f"the folder is for Python {archive.settings.python}; this is {here}: verify it with that one"
        )
    beside = {path: _find_weights(archive.settings, path, weights) for path in archive.absent}
    for path, content in archive.files.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        (folder / path).write_bytes(content)
    for path, found in beside.items():
        (folder / path).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(found, folder / path)


def _find_weights(settings: Settings, path: str, places: Path | None) -> Path:
    declared = settings.weights[path]
    for candidate in sorted(places.iterdir()) if places is not None else ():
        is_same_size = candidate.is_file() and candidate.stat().st_size == declared.bytes
        if is_same_size and sha256_of(candidate) == declared.sha256:
            return candidate.resolve()
    raise BundleError(
        f"the folder's weights {path} did not travel with it: put the file of {declared.bytes} bytes with the sha256 "
        f"{declared.sha256} into a folder and name that with --weights"
    )


def _is_text(content: bytes) -> bool:
    try:
        return "\0" not in content.decode()
    except UnicodeDecodeError:
        return False
