from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon, Zone

TREADS = 12
TREAD_M, RISER_M = 0.29, 0.165


def rectangle(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]


@pytest.fixture(scope="session")
def house() -> Building:
    """An L-shaped room with a pillar, a door to a second room, and a stair that climbs back over the first."""
    w = WALL
    polygons = [
        FloorPolygon(
            "hall",
            [[0, 0], [10, 0], [10, 2], [10, 3], [10, 6], [4, 6], [4, 10], [0, 10]],
            [w, w, 1, w, w, w, w, w, w, w, w, w],
            0.0,
            0,
            holes=([[2, 2], [2, 3], [3, 3], [3, 2]],),
        ),
        FloorPolygon("room", [[10, 0], [16, 0], [16, 6], [10, 6], [10, 3], [10, 2]], [w, w, 2, w, 0, w], 0.0, 0),
    ]
    # treads run from y = 6 upwards, then the landing of level 1 lies over them in plan
    y_m = 6 + TREAD_M * np.arange(TREADS + 1)
    polygons[1] = FloorPolygon(
        "room", [[10, 0], [16, 0], [16, 6], [14, 6], [10, 6], [10, 3], [10, 2]], [w, w, 2, w, w, 0, w], 0.0, 0
    )
    for i in range(TREADS):
        below = 1 if i == 0 else i + 1
        above = i + 3
        polygons.append(
            FloorPolygon(
                f"tread-{i}",
                rectangle(14, y_m[i], 16, y_m[i + 1]),
                [below, w, above, w],
                RISER_M * (i + 1),
                int(i >= TREADS // 2),
                "stairs",
            )
        )
    top = y_m[-1]
    polygons.append(
        FloorPolygon(
            "gallery",
            [[14, top], [16, top], [16, top + 3], [0, top + 3], [0, top]],
            [TREADS + 1, w, w, w, w],
            RISER_M * (TREADS + 1),
            1,
        )
    )
    return Building("house", tuple(polygons), (Zone("z1", "Café", rectangle(0, 0, 3, 3), 0, "shop"),))
