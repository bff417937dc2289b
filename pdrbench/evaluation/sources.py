"""What produced a result: digests of the code that ran and facts on the machine."""

from __future__ import annotations

import functools
import importlib.metadata
import os
import platform
from collections.abc import Set
from pathlib import Path
from typing import Final

from pdrbench.evaluation.code import closure_sha256, files_sha256, package_sha256
from pdrbench.isolation.read_permissions import environment_packages
from pdrbench.localizer_folder import find_target, installed_sha256, list_files, parse_target, read_settings
from pdrbench.registry import PluginError, environments, localizer_entry, localizers, task_place
from pdrbench.settings import split_name

# Rooms and files of the core that cannot change an estimate: a change there keeps stored results valid.
NEUTRAL: Final = frozenset({"bench", "cli", "gym", "metrics", "picture", "report"})
NEUTRAL_FILES: Final = frozenset(
    f"evaluation/{name}.py"
    for name in (
        "cluster",
        "experiments",
        "looks",
        "progress",
        "protocol",
        "reproduce",
        "reproduction",
        "scoring",
        "suitability",
        "tables",
        "trace",
        "tune",
    )
)


def core_sha256(rooms: Set[str] = NEUTRAL, files: Set[str] = NEUTRAL_FILES) -> str:
    """Digest of the code of pdrbench but for some rooms and files; by default those that change no estimate."""
    root = Path(__file__).parents[1]
    relevant = [
        path
        for path in root.rglob("*.py")
        if path.relative_to(root).parts[0] not in rooms and path.relative_to(root).as_posix() not in files
    ]
    return files_sha256(root, relevant)


def environment_sha256(env: str) -> str:
    """Digest of the code that makes the walks of an environment: results are computed anew where it changes.

    Args:
        env: Id, or the place of a task that is a file.
    """
    place = task_place(env)
    if place is None:
        return target_sha256(environments()[env].target)
    file = Path(place.partition(":")[0])
    return files_sha256(file.parent, [file])


def localizer_target(name: str) -> str:
    """Where the class of a localizer is defined, without importing it; settings in its name are left out.

    Returns:
        `module:Class`, `/absolute/file.py:Class`, or the text of a `FolderTarget`.

    Raises:
        UnknownNameError: It is not registered.
        PluginError: It is a folder that cannot be run.
    """
    name, query = split_name(name)
    if name not in localizers() and (folder := find_target(name)) is not None:
        return str(folder)
    place, _, attribute = name.partition(":")
    if attribute and place.endswith(".py"):
        return f"{Path(place).absolute()}:{attribute}"
    return name if attribute else localizer_entry(name, query).target


def target_sha256(target: str) -> str:
    """Digest of the code behind a target: a file, a module with everything it imports, or a whole package.

    Args:
        target: As `localizer_target` returns it, or a package. Of a module those imports count that are in its own
            package or in one that makes walks; the core has a digest of its own. Of a folder all files that would be
            packed count, and what its requirements were installed into.

    Raises:
        PluginError: There is no such file or package.
    """
    place, _, attribute = target.partition(":")
    if (found := parse_target(target)) is not None:
        files = [found.folder / name for name in list_files(found.folder, read_settings(found.folder))]
        own = files_sha256(found.folder, files)
        return own if found.packages is None else f"{own[:32]}{installed_sha256(found.packages)[:32]}"
    if place.endswith(".py"):
        path = Path(place)
        if not path.is_file():
            raise PluginError(f"no file {path}; a localizer is an id, package.module:Class or path/to/file.py:Class")
        return files_sha256(path.parent, [path])
    if not attribute:
        return package_sha256(place)
    return closure_sha256(place, _walk_packages())


@functools.cache
def _walk_packages() -> frozenset[str]:
    return environment_packages()


@functools.cache
def versions() -> dict[str, str]:
    """Versions of what computes."""
    return {
        "pdrbench": importlib.metadata.version("pdrbench"),
        "numpy": importlib.metadata.version("numpy"),
        "python": platform.python_version(),
    }


@functools.cache
def machine() -> dict[str, str | int]:
    """Processor, cores and system; no host name."""
    return {
        "cpu": _cpu_model(),
        "cores": os.cpu_count() or 0,
        "system": f"{platform.system()} {platform.release()}",
        "architecture": platform.machine(),
    }


def _cpu_model() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor()
