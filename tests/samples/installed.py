"""Packages from outside, as pip leaves them in a folder."""

from __future__ import annotations

import contextlib
import importlib
import sys
from collections.abc import Iterator
from pathlib import Path

from pdrbench import registry


def declare(folder: Path, name: str, entry_points: str) -> None:
    """Writes what is known of an installed distribution: its name, and entry points as lines of their file."""
    about = folder / f"{name.replace('-', '_')}-1.0.dist-info"
    about.mkdir()
    (about / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(entry_points)


def clear_registry() -> None:
    """What is registered is looked up anew."""
    registry._scan.cache_clear()
    registry.registered_task.cache_clear()
    importlib.invalidate_caches()


@contextlib.contextmanager
def importable(folder: Path) -> Iterator[None]:
    """What a folder holds is installed meanwhile."""
    sys.path.insert(0, str(folder))
    clear_registry()
    yield
    sys.path.remove(str(folder))
    clear_registry()
