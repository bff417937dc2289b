from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon


@pytest.fixture(scope="session")
def house() -> Building:
    """A hall of 10 m by 6 m with a pillar of 1 m by 1 m, a door to a room of 6 m by 6 m, an attic over the hall."""
    w = WALL
    hall = FloorPolygon(
        "hall",
        np.array([[0, 0], [10, 0], [10, 2], [10, 3], [10, 6], [0, 6]], dtype=float),
        np.array([w, w, 1, w, w, w, w, w, w, w]),
        0.0,
        0,
        holes=(np.array([[2, 2], [2, 3], [3, 3], [3, 2]], dtype=float),),
    )
    room = FloorPolygon(
        "room",
        np.array([[10, 0], [16, 0], [16, 6], [10, 6], [10, 3], [10, 2]], dtype=float),
        np.array([w, w, w, w, 0, w]),
        0.0,
        0,
    )
    attic = FloorPolygon("attic", np.array([[0, 0], [8, 0], [8, 6], [0, 6]], dtype=float), np.full(4, w), 3.0, 1)
    return Building("house", (hall, room, attic))
