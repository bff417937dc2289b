"""An installed package from outside with an environment, and a file of localizers."""

from __future__ import annotations

import importlib
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pdrbench import registry

HERE = Path(__file__).parent / "plugin"


def clear_registry() -> None:
    registry._scan.cache_clear()
    registry.registered_task.cache_clear()
    importlib.invalidate_caches()


@pytest.fixture(scope="session")
def plugin_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as pip leaves it: a module, and the entry points of its distribution."""
    root = tmp_path_factory.mktemp("site")
    shutil.copy(HERE / "corridor_plugin.py", root)
    about = root / "corridor_plugin-0.1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: corridor-plugin\nVersion: 0.1\n")
    (about / "entry_points.txt").write_text(
        "[pdrbench.environments]\nx = corridor_plugin:ENVIRONMENTS\n"
        "[pdrbench.localizers]\nx = corridor_plugin:LOCALIZERS\n"
    )
    return root


@pytest.fixture(autouse=True)
def plugin(plugin_root: Path) -> Iterator[None]:
    """The package is installed while a test runs."""
    sys.path.insert(0, str(plugin_root))
    clear_registry()
    yield
    sys.path.remove(str(plugin_root))
    clear_registry()


@pytest.fixture(scope="session")
def localizer() -> Callable[[str], str]:
    """Specification of a class in the file of strange localizers."""
    return lambda name: f"{HERE / 'strange_localizers.py'}:{name}"
