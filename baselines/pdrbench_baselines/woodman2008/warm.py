"""Compiles every kernel of the particle filters, or loads it from the cache of compiled code."""

from __future__ import annotations

import numpy as np

from pdrbench.building import FloorRegion
from pdrbench.filters.warm import two_rooms
from pdrbench_baselines.woodman2008.clusters import cluster
from pdrbench_baselines.woodman2008.map_filter import FEW, WoodmanFilter
from pdrbench_baselines.woodman2008.params import WoodmanFilterParams


def warm_up() -> None:
    """Runs every kernel once on two rooms."""
    building, rng = two_rooms(), np.random.default_rng(0)
    many = WoodmanFilterParams(min_particles=FEW + 1)
    for particles in (WoodmanFilter(building, rng), WoodmanFilter(building, rng, many)):
        particles.start(FloorRegion.whole(building))
        particles.update(0.1, 0.0, 0.0)
    cluster(particles.cloud(100), building)
