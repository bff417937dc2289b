from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.sparse.csgraph import connected_components
from scipy.spatial.distance import cdist

from pdrbench.building import Building
from pdrbench.geometry import FloatArray, IntArray
from pdrbench_baselines.woodman2008.clusters import NO_CLUSTER, cluster, near_polygons
from pdrbench_baselines.woodman2008.params import ParticleCloud

NUM_TREADS, TREAD_M = 18, 0.28  # of `stairs`
UPPER, BESIDE = NUM_TREADS + 1, NUM_TREADS + 2


def cloud_of(polygon: object, xy_m: object, weight: object = None, heading_rad: object = None) -> ParticleCloud:
    polygon = np.asarray(polygon)
    ones = np.ones(len(polygon))
    return ParticleCloud(
        np.asarray(xy_m, dtype=float),
        0 * ones if heading_rad is None else np.asarray(heading_rad, dtype=float),
        polygon,
        ones if weight is None else np.asarray(weight, dtype=float),
    )


def slow_labels(cloud: ParticleCloud, building: Building, eps_m: float) -> IntArray:
    """Slow reference of the flood fill: every pair, one by one."""
    first, near = near_polygons(building, eps_m)
    num_polygons = len(building.polygons)
    is_near = np.zeros((num_polygons, num_polygons), dtype=bool)
    is_near[np.repeat(np.arange(num_polygons), np.diff(first)), near] = True
    live = np.flatnonzero(cloud.weight > 0)
    linked = cdist(cloud.xy_m[live], cloud.xy_m[live]) <= eps_m
    linked &= is_near[np.ix_(cloud.polygon[live], cloud.polygon[live])]
    label = np.full(len(cloud), NO_CLUSTER)
    label[live] = connected_components(linked, directed=False)[1]
    return label


def neighbours(building: Building, polygon: int, within_m: float) -> list[int]:
    first, near = near_polygons(building, within_m)
    return near[first[polygon] : first[polygon + 1]].tolist()


def test_nearness_is_walking_distance(stairs: Building) -> None:
    # from tread 9 over k treads in between, each 0.28 m long
    assert neighbours(stairs, 9, 0.01) == [8, 9, 10]
    assert neighbours(stairs, 9, 2 * TREAD_M + 0.01) == [6, 7, 8, 9, 10, 11, 12]
    assert neighbours(stairs, 9, 2.0) == list(range(1, NUM_TREADS))  # seven of them are 1.96 m
    assert neighbours(stairs, 0, 2.0) == list(range(9))
    assert BESIDE not in neighbours(stairs, 0, 50.0)
    assert neighbours(stairs, BESIDE, 50.0) == [BESIDE]


@pytest.mark.parametrize("count", [1, 7, 60, 1500])
def test_agrees_with_every_pair_looked_at(stairs: Building, rng: np.random.Generator, count: int) -> None:
    polygon, xy_m = stairs.sample_uniform(rng, count)
    weight = rng.random(count) * (rng.random(count) < 0.7)
    weight[0] = 1.0
    for eps_m in (0.3, 2.0):
        cloud = cloud_of(polygon, xy_m, weight)
        found, expected = cluster(cloud, stairs, eps_m), slow_labels(cloud, stairs, eps_m)
        assert (found.label[expected == NO_CLUSTER] == NO_CLUSTER).all()
        assert len(found) == expected.max() + 1
        assert len(np.unique(np.column_stack([found.label, expected]), axis=0)) == len(np.unique(expected))
        assert (np.diff(found.fraction) <= 1e-15).all()


def test_a_wall_without_a_door_parts_and_a_flight_joins(stairs: Building) -> None:
    apart = cluster(cloud_of([0, BESIDE], [[3, 5.9], [3, 6.1]]), stairs)
    assert len(apart) == 2
    x_m = np.arange(5.5, 6 + NUM_TREADS * TREAD_M + 1, TREAD_M)
    polygon = np.clip(np.floor((x_m - 6) / TREAD_M) + 1, 0, UPPER).astype(int)
    assert len(cluster(cloud_of(polygon, np.column_stack([x_m, 0 * x_m + 3])), stairs)) == 1


def test_sums_of_a_cluster(stairs: Building) -> None:
    heading_rad = [math.pi - 0.1, -math.pi + 0.3, 0.0, 0.5]
    weight = [3.0, 1.0, 0.0, 4.0]
    found = cluster(cloud_of([0, 0, 0, UPPER], [[1, 1], [2, 1], [5, 5], [14, 3]], weight, heading_rad), stairs)
    assert found.label.tolist() == [0, 0, NO_CLUSTER, 1] or found.label.tolist() == [1, 1, NO_CLUSTER, 0]
    two = found.label[0]
    assert found.fraction == pytest.approx([0.5, 0.5])
    assert found.xy_m[two] == pytest.approx([1.25, 1.0])  # eq. (20), (21)
    assert found.sigma_m[two] == pytest.approx(math.sqrt(0.5 * (3 * 0.25**2 + 0.75**2) / 4))
    x, y = 3 * math.cos(math.pi - 0.1) + math.cos(-math.pi + 0.3), 3 * math.sin(math.pi - 0.1) + math.sin(0.3 - math.pi)
    assert found.heading_rad[two] == pytest.approx(math.atan2(y, x))
    assert found.polygon[1 - two] == UPPER
    assert found.total_sigma_m == pytest.approx(_sigma(np.array([[1, 1], [2, 1], [14, 3]]), np.array([3, 1, 4])))


def _sigma(xy_m: FloatArray, weight: IntArray) -> float:
    normed = weight / weight.sum()
    return math.sqrt(0.5 * (normed @ (xy_m - normed @ xy_m) ** 2).sum())


def test_weights_of_any_size_and_none(stairs: Building) -> None:
    found = cluster(cloud_of([0, 0], [[1, 1], [2, 1]], [1e-300, 3e-300]), stairs)
    assert found.fraction == pytest.approx([1.0])
    assert found.xy_m[0] == pytest.approx([1.75, 1.0])
    found = cluster(cloud_of([0, 0], [[1, 1], [2, 1]], [0.0, 0.0]), stairs)
    assert len(found) == 0
    assert found.label.tolist() == [NO_CLUSTER, NO_CLUSTER]
