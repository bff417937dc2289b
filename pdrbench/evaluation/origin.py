"""Where a result comes from: versions, the bytes of the localizer, and facts on the machine.

A stored result is used again where the ids of environment and localizer, the versions of packages and the bytes of the
localizer agree. What is played is said by the id of the environment and the version of its package.
"""

from __future__ import annotations

import ast
import functools
import importlib.metadata
import importlib.util
import os
import platform
import threading
from pathlib import Path

from pdrbench.errors import PluginError, unknown_name
from pdrbench.files import bytes_sha256
from pdrbench.localizer_folder import find_target, installed_sha256, list_files, parse_target, read_settings
from pdrbench.registry import environments, localizer_entry, localizers, task_place
from pdrbench.settings import split_name

_IMPORTS = (ast.Import, ast.ImportFrom)
_PARSING = threading.Lock()  # CPython 3.11 counts the depth of all threads as one, and fails where two parse at once


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
    """Digest of the bytes behind a target: of a file, of a folder as it would be packed, or of a top-level package.

    Args:
        target: As `localizer_target` returns it. What the requirements of a folder were installed into counts too.

    Raises:
        PluginError: There is no such file or package.
    """
    place = target.partition(":")[0]
    if (found := parse_target(target)) is not None:
        files = list_files(found.folder, read_settings(found.folder))
        own = bytes_sha256([found.folder / name for name in files], found.folder)
        return own if found.packages is None else f"{own[:32]}{installed_sha256(found.packages)[:32]}"
    if not place.endswith(".py"):
        return package_sha256(place.partition(".")[0])
    if not Path(place).is_file():
        raise PluginError(f"no file {place}; a localizer is an id, package.module:Class or path/to/file.py:Class")
    _check_defined(Path(place), target.rpartition(":")[2])
    return bytes_sha256([Path(place)])


def _check_defined(path: Path, attribute: str) -> None:
    """Raises `PluginError` where a file, which is not run, plainly has no such class."""
    try:
        with _PARSING:
            lines = ast.parse(path.read_bytes()).body
    except (SyntaxError, ValueError):  # whoever loads it says what is wrong
        return
    names = [line.name for line in lines if isinstance(line, (ast.ClassDef, ast.FunctionDef))]
    texts = [line for line in lines if isinstance(line, ast.Expr) and isinstance(line.value, ast.Constant)]
    if all(line in texts or isinstance(line, (ast.ClassDef, ast.FunctionDef, *_IMPORTS)) for line in lines):
        imported = [of.asname or of.name for line in lines if isinstance(line, _IMPORTS) for of in line.names]
        if attribute not in names and attribute not in imported and "*" not in imported:
            raise PluginError(f"{path} defines no {attribute!r}: {unknown_name('class', attribute, names)}")


def package_sha256(name: str) -> str:
    """Digest of the bytes of a top-level package or module; raises `PluginError` where it has none."""
    try:
        spec = importlib.util.find_spec(name)
    except (ImportError, ValueError) as error:
        raise PluginError(f"{name!r} cannot be found: {error}") from error
    if spec is None:
        raise PluginError(f"there is no module {name!r}; is its package installed?")
    places = [Path(place) for place in spec.submodule_search_locations or ()] or [Path(spec.origin or "")]
    if not all(place.exists() for place in places):
        raise PluginError(f"the source of {name!r} cannot be found, so stored results may be of other code")
    return bytes_sha256(places)


def environment_version(env: str) -> str:
    """Package and version that make the walks of an environment; of a task that is a file, digest of that file.

    Args:
        env: As `registry.make_task` takes it.
    """
    place = task_place(env)
    if place is not None:
        return bytes_sha256([Path(place.partition(":")[0])])
    package = environments()[env].package
    return f"{package} {importlib.metadata.version(package)}"


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
