"""A small building: a room with a door, a corridor around a column, a stair of ten treads, a hall above."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon, Zone

TREAD_M, RISE_M, NUM_TREADS = 0.29, 0.17, 10


def make_building() -> Building:
    room = FloorPolygon(
        "room",
        np.array([[0.0, 2], [4, 2], [5, 2], [8, 2], [8, 7], [0, 7]]),
        np.array([WALL, 1, WALL, WALL, WALL, WALL]),
        0.0,
        0,
    )
    column = np.array([[2.0, 0.5], [2, 1.2], [3, 1.2], [3, 0.5]])
    corridor = FloorPolygon(
        "corridor",
        np.array([[0.0, 0], [12, 0], [12, 2], [8, 2], [5, 2], [4, 2], [0, 2]]),
        np.array([WALL, 2, WALL, WALL, 0, WALL, WALL, WALL, WALL, WALL, WALL]),
        0.0,
        0,
        "floor",
        (column,),
    )
    treads = [_tread(k) for k in range(NUM_TREADS)]
    x_m = _edge_m(NUM_TREADS)
    hall = FloorPolygon(
        "hall",
        np.array([[x_m, 0.0], [22, 0], [22, 7], [x_m, 7], [x_m, 2]]),
        np.array([WALL, WALL, WALL, WALL, 1 + NUM_TREADS]),
        RISE_M * (NUM_TREADS + 1),
        1,
    )
    zone = Zone("zone", "room A", room.outline_xy_m, 0)
    return Building("hand-made", (room, corridor, *treads, hall), (zone,))


def _edge_m(tread: int) -> float:
    """x of the lower edge of a tread; the same sum on both sides of an edge, so that they coincide exactly."""
    return 12.0 + TREAD_M * tread if tread else 12.0


def _tread(k: int) -> FloorPolygon:
    low_m, high_m = _edge_m(k), _edge_m(k + 1)
    return FloorPolygon(
        f"tread-{k}",
        np.array([[low_m, 0.0], [high_m, 0], [high_m, 2], [low_m, 2]]),
        np.array([WALL, 3 + k, WALL, 1 + k]),
        RISE_M * (k + 1),
        0 if k < NUM_TREADS // 2 else 1,
        "stairs",
    )


@pytest.fixture(scope="session")
def building() -> Building:
    return make_building()
