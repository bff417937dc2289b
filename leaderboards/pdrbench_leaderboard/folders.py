"""Folders before they are packed, and as they are run again from a bundle."""

from __future__ import annotations

import importlib.metadata
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from packaging.utils import canonicalize_name

from pdrbench.cli.output import note
from pdrbench.errors import BundleError
from pdrbench.evaluation.origin import localizer_target
from pdrbench.localizer_folder import FolderTarget, find_target, parse_target
from pdrbench.registry import localizers
from pdrbench_leaderboard.confine.read_permissions import permissions_of
from pdrbench_leaderboard.confine.shared_modules import shared_distributions, shared_modules
from pdrbench_leaderboard.folder_archive import ARCHIVE_FILE, Archive, pack_folder, read_archive, unpack
from pdrbench_leaderboard.packages import HOW_TO_LOCK, default_place, install

SOURCE_SUFFIX: Final = ".py"
ARCHIVE_FOLDER: Final = "folder"  # into which an archive is unpacked


@dataclass(frozen=True, slots=True)
class Supplies:
    """What a maintainer has ready for folders."""

    wheels: Path | None = None  # folder of wheels
    weights: Path | None = None  # folder of weights that did not travel with their folder
    packages: Path | None = None  # where packages are unpacked; None: beside the cache of this user


def folder_of(spec: str) -> Path | None:
    """The folder that a specification names; None where it names something else."""
    target = _target(spec)
    return None if target is None else target.folder


def check_packable(spec: str) -> None:
    """Whether a folder that runs here can run elsewhere: what it imports is locked, in the version that is here.

    Raises:
        BundleError: It is not; says what to do.
        PluginError: The folder is no localizer, or not as it was declared.
    """
    target = _target(spec)
    if target is None:
        return
    archive = read_archive(pack_folder(target.folder))
    shared = shared_distributions()
    locked = {one.name: one.version for one in archive.lock if one.name not in shared}
    if target.packages is None:
        for name, version in locked.items():
            here = _version_here(name)
            if here != version:
                what = f"{here} is installed" if here else "it is not installed"
                raise BundleError(f"{spec} locks {name} {version}, and {what}: pack it with what it locks")
        _check_imports(spec, target, archive, locked)


def make_runnable(content: bytes, folder: Path, supplies: Supplies) -> str:
    """Unpacks a folder and what it requires; nothing of either is run.

    Args:
        content: Of an archive.
        folder: Into which it goes.
        supplies: What is ready for it.

    Returns:
        What `evaluate` runs: the folder, and the packages that it imports instead of what is installed.

    Raises:
        BundleError: It is no such archive, is for another Python, or wheels or weights are missing or others.
        PluginError: It has no such entry.
    """
    archive = read_archive(content)
    unpack(archive, folder, supplies.weights)
    installed = install(archive.lock, supplies.wheels, supplies.packages or default_place())
    for name, difference in installed.shared.items():
        if difference:
            note(f"{name}: {difference}; only estimates decide")
    spec = f"{folder}@{installed.folder}"
    find_target(spec)  # raises where its entry or its weights are not there
    return spec


def unpack_source(source: Mapping[str, bytes], spec: str, folder: Path, supplies: Supplies) -> str:
    """Writes what travels with a bundle into a folder; returns what `evaluate` runs.

    Args:
        source: Content by name.
        spec: Of the manifest: one of these names, with a class where it is a file.
        folder: An existing one.
        supplies: For a folder, which `make_runnable` describes as well as what is raised.
    """
    place, colon, attribute = spec.partition(":")
    if place == ARCHIVE_FILE:
        return make_runnable(source[ARCHIVE_FILE], folder / ARCHIVE_FOLDER, supplies)
    for name, content in source.items():
        (folder / name).write_bytes(content)
    return f"{folder / place}{colon}{attribute}"


def _target(spec: str) -> FolderTarget | None:
    if spec in localizers() or ":" in spec:
        return parse_target(spec)
    return find_target(spec)


def _version_here(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return ""


def _check_imports(spec: str, target: FolderTarget, archive: Archive, locked: Mapping[str, str]) -> None:
    own = {Path(path).name.removesuffix(SOURCE_SUFFIX) for root in target.roots for path in Path(root).iterdir()}
    named = {name.partition(".")[0] for name in permissions_of(spec, localizer_target(spec)).imports}
    providers = importlib.metadata.packages_distributions()
    for module in sorted(named - own - shared_modules() - sys.stdlib_module_names):
        distributions = [canonicalize_name(name) for name in providers.get(module, ())]
        if distributions and not set(distributions) & locked.keys():
            what = "has no lock" if archive.settings.requirements is None else "does not lock it"
            raise BundleError(f"{spec} imports {module!r} from {distributions[0]} and {what}; {HOW_TO_LOCK}")
