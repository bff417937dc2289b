"""Buildings of a few polygons, as fixtures for whoever imports them into a conftest.py."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon


@pytest.fixture(scope="session")
def hangar() -> Building:
    """One floor of 40 m by 40 m with nothing on it."""
    return Building("hangar", (FloorPolygon("floor", rectangle(0, 0, 40, 40), [WALL] * 4, 0.0, 0),))


@pytest.fixture(scope="session")
def stairs() -> Building:
    """A room of 6 m by 6 m, 18 treads of 0.28 m that lead east and up by 0.17 m each, and a room above.

    The room is polygon 0, the treads are 1 to 18, the upper room 19; 20 is a room beside the lower one, without a door.
    """
    w, num_treads, tread_m, riser_m = WALL, 18, 0.28, 0.17
    outline = [[0, 0], [6, 0], [6, 2], [6, 4], [6, 6], [0, 6]]
    polygons = [FloorPolygon("lower", outline, [w, w, 1, w, w, w], 0.0, 0)]
    for i in range(1, num_treads + 1):
        corners = rectangle(6 + (i - 1) * tread_m, 2, 6 + i * tread_m, 4)
        polygons.append(FloorPolygon(f"tread-{i}", corners, [w, i + 1, w, i - 1], i * riser_m, int(i > 9), "stairs"))
    x0 = 6 + num_treads * tread_m
    outline = [[x0, 0], [x0 + 6, 0], [x0 + 6, 6], [x0, 6], [x0, 4], [x0, 2]]
    polygons.append(FloorPolygon("upper", outline, [w, w, w, w, num_treads, w], (num_treads + 1) * riser_m, 1))
    polygons.append(FloorPolygon("beside", rectangle(0, 6, 6, 8), [w] * 4, 0.0, 0))
    return Building("stairs", tuple(polygons))


def bare_ring() -> Building:
    """A corridor round a block without doors, 31 m by 15 m and 2 m wide; its middle line begins at (0, 0)."""
    holes = (np.array(rectangle(1, 1, 30, 14))[::-1],)
    ring = FloorPolygon("corridor", rectangle(-1, -1, 32, 16), [WALL] * 8, 0.0, 0, holes=holes)
    return Building("ring", (ring,))


def rectangle(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]
