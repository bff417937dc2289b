"""Registered recorded datasets: files, hashes and folders, and whether they are intact. `download` has `fetch`."""

from __future__ import annotations

from pdrbench.datasets.catalogue import DataFile, Dataset, dataset, datasets
from pdrbench.datasets.folders import cache_folder, find, is_available
from pdrbench.datasets.integrity import Problem, verify

__all__ = ["DataFile", "Dataset", "Problem", "cache_folder", "dataset", "datasets", "find", "is_available", "verify"]
