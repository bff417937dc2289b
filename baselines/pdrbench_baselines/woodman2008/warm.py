"""Compiles every particle kernel, or loads it from the cache of compiled code."""

from __future__ import annotations

import numpy as np

from pdrbench.building import WALL, Building, FloorPolygon, FloorRegion
from pdrbench.filters.params import MapFilterParams
from pdrbench_baselines.woodman2008.literal import LiteralMapFilter
from pdrbench_baselines.woodman2008.map_filter import FEW, MapFilter


def warm_up(*, literal: bool = True) -> None:
    """Runs every kernel once on two rooms.

    Args:
        literal: The kernels of `LiteralMapFilter`, too.
    """
    building, region = _two_rooms()
    kinds: list[tuple[type[MapFilter] | type[LiteralMapFilter], MapFilterParams]] = [
        (MapFilter, MapFilterParams()),
        (MapFilter, MapFilterParams(min_particles=FEW + 1)),
    ]
    if literal:
        kinds.append((LiteralMapFilter, MapFilterParams()))
    for kind, params in kinds:
        particles = kind(building, np.random.default_rng(0), params)
        particles.start(region)
        particles.update(0.1, 0.0, 0.0)


def _two_rooms() -> tuple[Building, FloorRegion]:
    building = Building(
        "two rooms",
        (
            FloorPolygon("a", [[0, 0], [1, 0], [1, 1], [0, 1]], [WALL, 1, WALL, WALL], 0.0, 0),  # type: ignore[arg-type]
            FloorPolygon("b", [[1, 0], [2, 0], [2, 1], [1, 1]], [WALL, WALL, WALL, 0], 0.17, 0),  # type: ignore[arg-type]
        ),
    )
    return building, FloorRegion.whole(building)
