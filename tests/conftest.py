"""Fixtures that every room's tests share."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed: same numbers in every run."""
    return np.random.default_rng(20080921)


@pytest.fixture(scope="session")
def data_root() -> Path:
    """Folder that holds the recorded datasets by name; skips where there is none."""
    for place in os.environ.get("PDRBENCH_DATA", "").split(os.pathsep):
        if place and Path(place).is_dir() and any(Path(place).iterdir()):
            return Path(place)
    pytest.skip("recorded data not found: set PDRBENCH_DATA to the folder that holds ilc20/")
