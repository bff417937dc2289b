"""Clusters of particles (claim W16): has the cloud become one, and where is it?"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from pdrbench.compiled import compiled, inner
from pdrbench.geometry import FloatArray, IntArray, read_only

if TYPE_CHECKING:
    from pdrbench.building import Building
    from pdrbench_baselines.woodman2008.params import ParticleCloud

NO_CLUSTER: Final = -1
_TOUCH_M: Final = 1e-9  # what crossing a connection costs: sparse graphs take no zero
_SOURCES: Final = 256  # polygons whose surroundings are searched at a time: bounds the memory


@dataclass(frozen=True, slots=True)
class Clusters:
    """Groups of live particles, the heaviest first.

    Attributes:
        label: (N,) int, cluster of each particle, `NO_CLUSTER` where its weight is 0.
        fraction: (C,) of the weight of all particles; sums to 1.
        xy_m: (C, 2) weighted mean, eq. (20) and (21).
        heading_rad: (C,) weighted circular mean.
        sigma_m: (C,) standard deviation per axis: the root of half the trace of the covariance.
        polygon: (C,) int, the floor polygon that carries most of the weight.
    """

    label: IntArray
    fraction: FloatArray
    xy_m: FloatArray
    heading_rad: FloatArray
    sigma_m: FloatArray
    polygon: IntArray

    def __len__(self) -> int:
        return len(self.fraction)

    @property
    def total_sigma_m(self) -> float:
        """Standard deviation per axis of all live particles together."""
        centre_m = self.fraction @ self.xy_m
        variance_m2 = self.fraction @ (self.sigma_m**2 + 0.5 * ((self.xy_m - centre_m) ** 2).sum(axis=1))
        return math.sqrt(max(float(variance_m2), 0.0))


def cluster(cloud: ParticleCloud, building: Building, eps_m: float = 2.0) -> Clusters:
    """Single linkage, which is DBSCAN with one sample a core: a chain of particles, each near the next.

    Two particles are near when they are at most `eps_m` apart and stand on the same floor polygon, or on two between
    which one walks at most `eps_m` through the polygons in between; see `near_polygons`. The time grows with the
    number of live particles and with how many of them stand close to each other on polygons that are not near.

    Args:
        cloud: Particles; those of weight 0 belong to no cluster.
        building: Whose floor polygons they stand on.
        eps_m: Largest distance between neighbours.
    """
    first, near = near_polygons(building, eps_m)
    live = np.flatnonzero(cloud.weight > 0.0)
    found, sums = _link(cloud.xy_m, cloud.heading_rad, cloud.polygon, cloud.weight, live, float(eps_m), first, near)
    order = np.argsort(-sums[:, 0], kind="stable")
    rank = np.full(len(sums) + 1, NO_CLUSTER)  # the last for `NO_CLUSTER` itself
    rank[order] = np.arange(len(sums))
    label, sums = rank[found], sums[order]
    return Clusters(
        label=label,
        fraction=sums[:, 0],
        xy_m=sums[:, 1:3],
        heading_rad=sums[:, 3],
        sigma_m=sums[:, 4],
        polygon=sums[:, 5].astype(np.int64),
    )


@functools.lru_cache(maxsize=16)
def near_polygons(building: Building, within_m: float) -> tuple[IntArray, IntArray]:
    """Which floor polygons are near each other: itself, the adjacent ones, and the next across short ones.

    The way from one polygon to another leads from connection to connection, straight within each polygon in between;
    it costs nothing to step over a connection. Treads of 0.28 m are thus near over seven of them at 2 m.

    Returns:
        first: (P + 1,) polygon p is near `near[first[p]:first[p + 1]]`.
        near: (M,) int, ascending for each polygon.
    """
    from scipy.sparse.csgraph import dijkstra

    num_polygons = len(building.polygons)
    edges = np.flatnonzero(building.edge_twin >= 0)
    graph = _ways(building, edges, within_m)
    owner = np.concatenate([np.arange(num_polygons), building.edge_polygon[edges]])
    pairs = []
    for first_source in range(0, num_polygons, _SOURCES):
        sources = np.arange(first_source, min(first_source + _SOURCES, num_polygons))
        distance_m = dijkstra(graph, indices=sources, limit=within_m + 1e-6)
        source, node = np.nonzero(np.isfinite(distance_m))
        pairs.append(np.unique(sources[source] * num_polygons + owner[node]))
    pair = np.concatenate(pairs)
    counts = np.bincount(pair // num_polygons, minlength=num_polygons)
    return read_only(np.concatenate([[0], np.cumsum(counts)]), np.int64), read_only(pair % num_polygons, np.int64)


def _ways(building: Building, edges: IntArray, within_m: float) -> Any:
    """Graph whose nodes are the polygons, where ways begin, and the connections, seen from each side."""
    import shapely
    from scipy.sparse import csr_array

    num_polygons, owner = len(building.polygons), building.edge_polygon[edges]
    node = np.full(len(building.edge_twin), -1)
    node[edges] = num_polygons + np.arange(len(edges))
    lines = shapely.linestrings(np.stack([building.edge_start_xy_m[edges], building.edge_end_xy_m[edges]], axis=1))
    i, j = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=within_m)
    inside = (owner[i] == owner[j]) & (i != j)
    i, j = i[inside], j[inside]
    begin = np.concatenate([owner, node[edges], node[edges[i]]])
    end = np.concatenate([node[edges], node[building.edge_twin[edges]], node[edges[j]]])
    touch_m = np.full(2 * len(edges), _TOUCH_M)
    cost_m = np.concatenate([touch_m, np.maximum(shapely.distance(lines[i], lines[j]), _TOUCH_M)])
    size = num_polygons + len(edges)
    return csr_array((cost_m, (begin, end)), shape=(size, size))


@compiled
def _link(
    xy_m: FloatArray,
    heading_rad: FloatArray,
    polygon: IntArray,
    weight: FloatArray,
    live: IntArray,
    eps_m: float,
    first_near: IntArray,
    near: IntArray,
) -> tuple[IntArray, FloatArray]:
    """Labels particles, and sums up each cluster; see `cluster`. `live` are the particles with a weight.

    Returns:
        label: (N,).
        sums: (C, 6) fraction, mean x, mean y, heading, sigma, polygon.
    """
    member, first_member = _components(xy_m, polygon, live, eps_m, first_near, near)
    count = len(first_member) - 1
    sums = np.empty((count, 6))
    total = 0.0
    for i in range(len(weight)):
        total += weight[i]
    label = np.empty(len(weight), dtype=np.int64)
    for i in range(len(label)):
        label[i] = NO_CLUSTER
    in_polygon = np.zeros(len(first_near) - 1)
    for c in range(count):
        _summarise(
            member[first_member[c] : first_member[c + 1]],
            *(xy_m, heading_rad, polygon, weight, total),
            in_polygon,
            sums[c],
        )
        for k in range(first_member[c], first_member[c + 1]):
            label[member[k]] = c
    return label, sums


@inner
def _components(
    xy_m: FloatArray, polygon: IntArray, live: IntArray, eps_m: float, first_near: IntArray, near: IntArray
) -> tuple[IntArray, IntArray]:
    """Floods from particle to particle; those not yet reached wait in square buckets and leave them when they are.

    Returns:
        member: (L,) live particles, cluster by cluster.
        first_member: (C + 1,) cluster c owns `member[first_member[c]:first_member[c + 1]]`.
    """
    count = len(live)
    waiting, bucket_of, first, left, columns = _buckets(xy_m, live, eps_m)
    kind, first_kind, of_polygon, num_waiting = _kinds(polygon, live, waiting, first, left)
    rows = len(left) // columns
    member = np.empty(count, dtype=np.int64)
    first_member = np.empty(count + 1, dtype=np.int64)
    num_clusters, reached, done, next_bucket = 0, 0, 0, 0
    while reached < count:
        while left[next_bucket] == 0:
            next_bucket += 1
        left[next_bucket] -= 1
        member[reached] = waiting[first[next_bucket] + left[next_bucket]]
        num_waiting[kind[member[reached]]] -= 1
        first_member[num_clusters] = reached
        num_clusters += 1
        reached += 1
        while done < reached:
            at = live[member[done]]
            home = bucket_of[member[done]]
            done += 1
            for row in range(max(home // columns - 1, 0), min(home // columns + 2, rows)):
                for column in range(max(home % columns - 1, 0), min(home % columns + 2, columns)):
                    bucket = row * columns + column
                    kinds = slice(first_kind[bucket], first_kind[bucket + 1])
                    if not _may_join(polygon[at], of_polygon[kinds], num_waiting[kinds], first_near, near):
                        continue
                    slot = first[bucket]
                    while slot < first[bucket] + left[bucket]:
                        other = live[waiting[slot]]
                        dx, dy = xy_m[other, 0] - xy_m[at, 0], xy_m[other, 1] - xy_m[at, 1]
                        if dx * dx + dy * dy > eps_m * eps_m or not _is_near(
                            polygon[at], polygon[other], first_near, near
                        ):
                            slot += 1
                            continue
                        member[reached] = waiting[slot]
                        num_waiting[kind[member[reached]]] -= 1
                        reached += 1
                        left[bucket] -= 1
                        waiting[slot] = waiting[first[bucket] + left[bucket]]
    first_member[num_clusters] = count
    for k in range(count):
        member[k] = live[member[k]]
    return member, first_member[: num_clusters + 1]


@inner
def _buckets(xy_m: FloatArray, live: IntArray, eps_m: float) -> tuple[IntArray, IntArray, IntArray, IntArray, int]:
    """Sorts live particles into squares at least `eps_m` wide, at most about four a particle.

    Returns:
        waiting: (L,) indices into `live`, bucket by bucket.
        bucket_of: (L,).
        first: (B,) where each bucket begins in `waiting`.
        left: (B,) how many wait in it.
        columns: Buckets in a row.
    """
    count = len(live)
    if count == 0:
        none = np.zeros(0, dtype=np.int64)
        return none, none, np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64), 1
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for i in live:
        low_x, high_x = min(low_x, xy_m[i, 0]), max(high_x, xy_m[i, 0])
        low_y, high_y = min(low_y, xy_m[i, 1]), max(high_y, xy_m[i, 1])
    side_m = max(eps_m, math.sqrt((high_x - low_x) * (high_y - low_y) / (4.0 * count)))
    side_m = max(side_m, (high_x - low_x) / (4.0 * count), (high_y - low_y) / (4.0 * count))
    columns = int((high_x - low_x) / side_m) + 1
    rows = int((high_y - low_y) / side_m) + 1
    bucket_of = np.empty(count, dtype=np.int64)
    left = np.zeros(rows * columns, dtype=np.int64)
    for k in range(count):
        i = live[k]
        bucket_of[k] = int((xy_m[i, 1] - low_y) / side_m) * columns + int((xy_m[i, 0] - low_x) / side_m)
        left[bucket_of[k]] += 1
    first, filled = np.zeros(len(left), dtype=np.int64), np.zeros(len(left), dtype=np.int64)
    for b in range(1, len(left)):
        first[b] = filled[b] = first[b - 1] + left[b - 1]
    waiting = np.empty(count, dtype=np.int64)
    for k in range(count):
        waiting[filled[bucket_of[k]]] = k
        filled[bucket_of[k]] += 1
    return waiting, bucket_of, first, left, columns


@inner
def _kinds(
    polygon: IntArray, live: IntArray, waiting: IntArray, first: IntArray, left: IntArray
) -> tuple[IntArray, IntArray, IntArray, IntArray]:
    """Sorts the particles of each bucket by polygon: those of a bucket and a polygon are of a kind.

    Returns:
        kind: (L,).
        first_kind: (B + 1,) bucket b has the kinds `first_kind[b]` to `first_kind[b + 1]`.
        of_polygon: (M,) int polygon of each kind.
        num_waiting: (M,) int particles of each kind.
    """
    count, num_buckets, num_kinds = len(live), len(left), 0
    kind, first_kind = np.empty(count, dtype=np.int64), np.zeros(num_buckets + 1, dtype=np.int64)
    of_polygon, num_waiting = np.empty(count, dtype=np.int64), np.zeros(count, dtype=np.int64)
    for bucket in range(num_buckets):
        for slot in range(first[bucket], first[bucket] + left[bucket]):
            k, own = waiting[slot], polygon[live[waiting[slot]]]
            found = first_kind[bucket]
            while found < num_kinds and of_polygon[found] != own:
                found += 1
            if found == num_kinds:
                of_polygon[found] = own
                num_kinds += 1
            kind[k] = found
            num_waiting[found] += 1
        first_kind[bucket + 1] = num_kinds
    return kind, first_kind, of_polygon[:num_kinds], num_waiting[:num_kinds]


@inner
def _may_join(own: int, of_polygon: IntArray, num_waiting: IntArray, first_near: IntArray, near: IntArray) -> bool:
    """True where some particle still waits on a polygon near the own; above and below other levels none does."""
    for k in range(len(of_polygon)):  # noqa: SIM110  Numba has no any() of a generator
        if num_waiting[k] > 0 and _is_near(own, of_polygon[k], first_near, near):
            return True
    return False


@inner
def _is_near(one: int, other: int, first_near: IntArray, near: IntArray) -> bool:
    """True where `other` stands in the list of `one`."""
    if one == other:
        return True
    low, high = first_near[one], first_near[one + 1]
    while low < high:
        middle = (low + high) // 2
        if near[middle] < other:
            low = middle + 1
        else:
            high = middle
    found: bool = low < first_near[one + 1] and near[low] == other
    return found


@inner
def _summarise(
    members: IntArray,
    xy_m: FloatArray,
    heading_rad: FloatArray,
    polygon: IntArray,
    weight: FloatArray,
    total: float,
    in_polygon: FloatArray,
    sums: FloatArray,
) -> None:
    """Writes the `sums` of a cluster, as in `_link`; `in_polygon` is zero before and after."""
    fraction, x_m, y_m, cos, sin = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in members:
        w = weight[i] / total
        fraction += w
        x_m += w * xy_m[i, 0]
        y_m += w * xy_m[i, 1]
        cos += w * math.cos(heading_rad[i])
        sin += w * math.sin(heading_rad[i])
        in_polygon[polygon[i]] += w
    x_m, y_m = x_m / fraction, y_m / fraction
    variance_m2, heaviest = 0.0, polygon[members[0]]
    for i in members:
        w = weight[i] / total / fraction
        variance_m2 += 0.5 * w * ((xy_m[i, 0] - x_m) ** 2 + (xy_m[i, 1] - y_m) ** 2)
        if in_polygon[polygon[i]] > in_polygon[heaviest]:
            heaviest = polygon[i]
    for i in members:
        in_polygon[polygon[i]] = 0.0
    sums[0], sums[1], sums[2], sums[3], sums[4] = fraction, x_m, y_m, math.atan2(sin, cos), math.sqrt(variance_m2)
    sums[5] = heaviest
