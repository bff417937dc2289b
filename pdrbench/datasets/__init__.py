"""Registered recorded datasets: their files and hashes, where they lie, and how they are fetched and verified."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from pdrbench.datasets.catalogue import DataFile, Dataset, dataset, datasets
from pdrbench.datasets.folders import cache_folder, find, is_available
from pdrbench.datasets.integrity import Problem, verify

if TYPE_CHECKING:
    from pdrbench.datasets.download import fetch

__all__ = [
    "DataFile",
    "Dataset",
    "Problem",
    "cache_folder",
    "dataset",
    "datasets",
    "fetch",
    "find",
    "is_available",
    "verify",
]


def __getattr__(name: str) -> Any:
    """Loads `fetch` when it is asked for: what only reads data need not import a network."""
    if name == "fetch":
        return importlib.import_module("pdrbench.datasets.download").fetch
    raise AttributeError(f"module 'pdrbench.datasets' has no attribute {name!r}")
