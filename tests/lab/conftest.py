"""Leaves the tests of the laboratory out, with the reason, where it is not installed."""

from __future__ import annotations

import importlib.util
from pathlib import Path

import pytest

WHY = "the laboratory is not installed: pip install -e lab"
IS_THERE = importlib.util.find_spec("pdrbench_lab") is not None


class LeftOut(pytest.File):
    """A file of tests that is not imported."""

    def collect(self) -> list[pytest.Item]:
        return [Skipped.from_parent(self, name=self.path.stem)]


class Skipped(pytest.Item):
    """Says why."""

    def runtest(self) -> None:
        pytest.skip(WHY)


def pytest_collect_file(file_path: Path, parent: pytest.Collector) -> pytest.Collector | None:
    """A file of the laboratory's tests becomes one skipped test."""
    if IS_THERE or not file_path.name.startswith("test_"):
        return None
    return LeftOut.from_parent(parent, path=file_path)
