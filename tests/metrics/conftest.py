"""Fixtures of the metrics."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import Building, FloorPolygon


@pytest.fixture(scope="session")
def two_levels() -> Building:
    """Two rooms of 10 m by 10 m above each other, 3.5 m apart."""
    square = np.array([[0.0, 0.0], [10.0, 0.0], [10.0, 10.0], [0.0, 10.0]])
    walls = np.full(4, -1)
    rooms = [FloorPolygon(f"room-{level}", square, walls, height_m=3.5 * level, level=level) for level in (0, 1)]
    return Building("two levels", tuple(rooms))
