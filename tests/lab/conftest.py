"""Leaves the tests of the laboratory out, with the reason, where it is not installed."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

WHY = "the laboratory is not installed: pip install -e lab"
IS_THERE = importlib.util.find_spec("pdrbench_lab") is not None


class Skipped(pytest.Item):
    """Says why."""

    def runtest(self) -> None:
        pytest.skip(WHY)


class LeftOutFolder(pytest.Directory):
    """A folder of tests that is not looked into, since its conftest.py imports the laboratory."""

    def collect(self) -> list[pytest.Item]:
        return [Skipped.from_parent(self, name="left_out")]


class LeftOutFile(pytest.File):
    """A file of tests that is not imported."""

    def collect(self) -> list[pytest.Item]:
        return [Skipped.from_parent(self, name="left_out")]


def pytest_collect_directory(path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    return None if IS_THERE else LeftOutFolder.from_parent(parent, path=path)


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    return None if IS_THERE else LeftOutFile.from_parent(parent, path=module_path)
