"""An installed package from outside with an environment, and a file of localizers."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from installed import declare, importable

HERE = Path(__file__).parent / "plugin"


@pytest.fixture(scope="session")
def plugin_root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder as pip leaves it: a module, and the entry points of its distribution."""
    root = tmp_path_factory.mktemp("site")
    shutil.copy(HERE / "corridor_plugin.py", root)
    points = "[pdrbench.environments]\nx = corridor_plugin:ENVIRONMENTS\n"
    declare(root, "corridor-plugin", points + "[pdrbench.localizers]\nx = corridor_plugin:LOCALIZERS\n")
    return root


@pytest.fixture(autouse=True)
def plugin(plugin_root: Path) -> Iterator[None]:
    """The package is installed while a test runs."""
    with importable(plugin_root):
        yield


@pytest.fixture(scope="session")
def localizer() -> Callable[[str], str]:
    """Specification of a class in the file of strange localizers."""
    return lambda name: f"{HERE / 'strange_localizers.py'}:{name}"
