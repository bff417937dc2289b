"""A walk of a phone whose true motion is known, for formats to hold and for checks to find fault with."""

from __future__ import annotations

import numpy as np
import pytest
from recording_samples import make_walk


@pytest.fixture(scope="session")
def phone_walk() -> dict[str, np.ndarray]:
    """Rows by sensor of 30 s."""
    return make_walk()
