"""What produced a result: digests of the code that ran and facts on the machine."""

from __future__ import annotations

import functools
import hashlib
import importlib.metadata
import importlib.util
import os
import platform
from collections.abc import Iterator, Set
from pathlib import Path
from typing import Final

from pdrbench.registry import PluginError, environments, localizers

# Rooms and files of the core that cannot change an estimate: a change there keeps stored results valid.
NEUTRAL: Final = frozenset({"bench", "cli", "gym", "leaderboard", "metrics", "picture", "report"})
NEUTRAL_FILES: Final = frozenset(
    f"evaluation/{name}.py"
    for name in ("cluster", "experiments", "progress", "reproduce", "reproduction", "scoring", "tables", "trace")
)

CARDS: Final = "cards.toml"  # of the localizers of a package, see `pdrbench.leaderboard.card`


def core_sha256(rooms: Set[str] = NEUTRAL, files: Set[str] = NEUTRAL_FILES) -> str:
    """Digest of the sources of pdrbench but for some rooms and files; by default those that change no estimate."""
    root = Path(__file__).parents[1]
    relevant = [
        path
        for path in sorted(root.rglob("*.py"))
        if path.relative_to(root).parts[0] not in rooms and path.relative_to(root).as_posix() not in files
    ]
    return _digest(root, relevant)


def environment_sha256(env: str) -> str:
    """Digest of the package that registered an environment: what is told is code, and not in `task.sha256`."""
    return target_sha256(environments()[env].target)


def localizer_target(name: str) -> str:
    """Where the class of a localizer is defined, without importing it: `module:Class` or `/absolute/file.py:Class`."""
    place, _, attribute = name.partition(":")
    if attribute and place.endswith(".py"):
        return f"{Path(place).absolute()}:{attribute}"
    return name if attribute else localizers()[name].target


def target_sha256(target: str) -> str:
    """Digest of the code behind a target: the file itself, or every file of the top-level package but some.

    Files other than sources count too: the weights of a learned model lie beside its code. Caches and cards, which say
    who wrote it, do not count, nor does what a file or package imports from elsewhere.
    """
    place = target.partition(":")[0]
    if place.endswith(".py"):
        path = Path(place)
        if not path.is_file():
            raise PluginError(f"no file {path}; a localizer is an id, package.module:Class or path/to/file.py:Class")
        return _digest(path.parent, [path])
    top = place.partition(".")[0]
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError) as error:
        raise PluginError(f"{target}: {top!r} cannot be found: {error}") from error
    if spec is None:
        raise PluginError(f"{target}: there is no module {top!r}; is its package installed?")
    roots = [Path(place) for place in spec.submodule_search_locations or ()]
    if roots:
        return _join(_digest(root, sorted(_package_files(root))) for root in roots)
    if spec.origin is None or not Path(spec.origin).is_file():
        raise PluginError(f"{target}: the source of {top!r} cannot be found, so its results could not be told apart")
    return _digest(Path(spec.origin).parent, [Path(spec.origin)])


def _package_files(root: Path) -> Iterator[Path]:
    for path in root.rglob("*"):
        parts = path.relative_to(root).parts
        is_hidden = "__pycache__" in parts or any(part.startswith(".") for part in parts)
        if path.is_file() and not is_hidden and path.name != CARDS:
            yield path


def _digest(root: Path, files: list[Path]) -> str:
    return _join(f"{path.relative_to(root).as_posix()} {_file_sha256(path)}" for path in files)


def _file_sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _join(lines: Iterator[str]) -> str:
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()


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
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return models[0] if models else platform.processor()
