"""Compiles what a walk of `footslam` calls, once, before the first walk."""

from __future__ import annotations

import numpy as np

from pdrbench_lab.footslam.cloud import OdometryNoise, SlamCloud, SlamParams
from pdrbench_lab.footslam.hexagons import crossings


def warm_up() -> None:
    """Compiles them, or loads them from the cache."""
    cloud = SlamCloud(np.zeros(2), 0.0, OdometryNoise(), SlamParams(num_particles=2, delay=0), np.random.default_rng(0))
    for _ in range(3):
        cloud.stride(5.0, 0.0, 0)
    cloud.maps.enlarge()
    cloud.maps.replace(np.zeros(2, dtype=np.int64))
    crossings(np.zeros((1, 2)), np.ones((1, 2)), 0.5)
