"""Walls as a smooth cost: the distance to the nearest wall, on a lattice, negative off the floor; and stairs."""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import distance_transform_edt

from pdrbench.building import Building
from pdrbench.building.polygons import WALL
from pdrbench.errors import MapError
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench_lab.factor_graph.chain import STATE, neighbours
from pdrbench_lab.factor_graph.graph import Factor, Loss, Terms
from pdrbench_lab.factor_graph.lattice import lattice_of

AROUND_M: Final = 10.0  # of the lattice around the floor; beyond it the cost does not rise
STAIRS_M: Final = 1.5  # so near to stairs is a second that leads to another level: its way, and half a metre
ALONG: Final = np.array([0.25, 0.5, 0.75, 1.0])  # of a second's way: a metre, so that no wall lies between two places


@dataclass(frozen=True, slots=True)
class Distances:
    """Signed distance to the nearest wall of a level.

    Attributes:
        low_m: (2,) building frame, middle of the first square.
        square_m: Side of a square.
        inside_m: (X, Y) distance of the middle of each square; negative off the floor.
    """

    low_m: FloatArray
    square_m: float
    inside_m: FloatArray

    def at(self, xy_m: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Bilinear distance (N,) and its gradient (N, 2) at places (N, 2)."""
        shape = np.array(self.inside_m.shape)
        place = (xy_m - self.low_m) / self.square_m
        is_inside = np.all((place >= 0) & (place <= shape - 1), axis=1, keepdims=True)
        place = np.clip(place, 0.0, shape - 1.001)
        square = place.astype(np.int64)
        u, v = (place - square).T
        flat = square[:, 0] * shape[1] + square[:, 1]
        a, b, c, d = (self.inside_m.ravel()[flat + k] for k in (0, shape[1], 1, shape[1] + 1))
        value = (1 - v) * ((1 - u) * a + u * b) + v * ((1 - u) * c + u * d)
        slope = np.column_stack([(1 - v) * (b - a) + v * (d - c), (1 - u) * (c - a) + u * (d - b)]) / self.square_m
        return value, np.where(is_inside, slope, 0.0)


@functools.lru_cache(maxsize=16)
def distances_of(building: Building, level: int, square_m: float) -> Distances:
    """Of a level; kept for the last few.

    Raises:
        MapError: There is no floor on that level.
    """
    lattice = lattice_of(building, level, square_m)
    if level not in lattice.levels:
        raise MapError(f"no floor on level {level}; the map has {lattice.levels.tolist()}")
    around = round(AROUND_M / square_m)
    floor = np.pad(lattice.cell[int(np.searchsorted(lattice.levels, level))] >= 0, around)
    low_m = lattice.convex.origin_xy_m + lattice.low_m + square_m * (0.5 - around)
    free = floor & ~_walls_on(building, level, low_m, square_m, floor.shape)
    out, within = distance_transform_edt(~floor), distance_transform_edt(free)
    return Distances(low_m, square_m, square_m * np.where(out > 0, 0.5 - out, np.maximum(within - 0.5, 0.0)))


def _walls_on(building: Building, level: int, low_m: FloatArray, square_m: float, shape: tuple[int, ...]) -> BoolArray:
    """(X, Y) which squares a wall of a level passes."""
    is_own = (building.edge_neighbour == WALL) & (building.level(building.edge_polygon) == level)
    return _passed(building, is_own, low_m, square_m, shape)


@functools.lru_cache(maxsize=16)
def stairs_of(building: Building, square_m: float) -> Mapping[tuple[int, int], Distances]:
    """By the levels before and after: `STAIRS_M` less the distance to the nearest edge that joins the two."""
    joined = np.flatnonzero(building.edge_neighbour != WALL)
    before, after = (building.level(polygon[joined]) for polygon in (building.edge_polygon, building.edge_neighbour))
    found = {}
    for pair in sorted(set(zip(before.tolist(), after.tolist(), strict=True))):
        if pair[0] != pair[1]:
            floor, is_own = distances_of(building, pair[0], square_m), np.zeros(len(building.edge_neighbour), np.bool_)
            is_own[joined[(before == pair[0]) & (after == pair[1])]] = True
            away = distance_transform_edt(~_passed(building, is_own, floor.low_m, square_m, floor.inside_m.shape))
            found[pair] = Distances(floor.low_m, square_m, STAIRS_M - square_m * away)
    return found


def _passed(
    building: Building, is_own: BoolArray, low_m: FloatArray, square_m: float, shape: tuple[int, ...]
) -> BoolArray:
    """(X, Y) which squares some edges (E,) of the plan pass."""
    start_m, end_m = building.edge_start_xy_m[is_own], building.edge_end_xy_m[is_own]
    count = np.ceil(2.0 * np.hypot(*(end_m - start_m).T) / square_m).astype(np.int64) + 1
    edge = np.repeat(np.arange(len(count)), count)
    done = (np.arange(len(edge)) - np.repeat(np.cumsum(count) - count, count)) / np.maximum(count[edge] - 1, 1)
    xy_m = start_m[edge] + done[:, None] * (end_m - start_m)[edge]
    square = np.clip(np.rint((xy_m - low_m) / square_m).astype(np.int64), 0, np.array(shape) - 1)
    passed = np.zeros(shape, dtype=np.bool_)
    passed[square[:, 0], square[:, 1]] = True
    return passed


def walls(
    floors: Mapping[int, Distances],
    stairs: Mapping[tuple[int, int], Distances],
    level: IntArray,
    *,
    margin_m: float,
    sigma_m: float,
    loss: Loss,
) -> Factor:
    """Keeps ways at `margin_m` from walls: along each, a hinge max(0, margin - distance) / sigma.

    Args:
        floors: Distances to walls by level.
        stairs: Distances by the levels before and after, for ways that lead to another level; else see `stairs_of`.
        level: (P, T) of every state of each chain; a way is on the level of its end.
        margin_m: Nearer to a wall a place costs.
        sigma_m: By which it costs 1/2.
        loss: Of a place.
    """
    num_parts, num_states = level.shape
    columns = neighbours(num_parts, num_states, np.arange(2))
    mix = np.stack([1.0 - ALONG, ALONG])  # (2, F)
    both = np.einsum("if,jf->fij", mix, mix)
    ways = []
    for before, after in itertools.product(*2 * [np.unique(level).tolist()]):
        own = (level[:, :-1] == before) & (level[:, 1:] == after)
        if own.any():
            ways.append((stairs.get((before, after), floors[after]), own))

    def factor(values: FloatArray) -> Terms:
        xy_m = values.reshape(num_parts, num_states, STATE)[:, :, :2]
        start_m, end_m = xy_m[:, :-1, None], xy_m[:, 1:, None]
        place_m = start_m + ALONG[:, None] * (end_m - start_m)
        inside_m, slope = np.empty(place_m.shape[:3]), np.empty(place_m.shape)
        for distances, own in ways:
            found, found_slope = distances.at(place_m[own].reshape(-1, 2))
            inside_m[own], slope[own] = found.reshape(inside_m[own].shape), found_slope.reshape(slope[own].shape)
        residual = np.maximum(margin_m - inside_m, 0.0) / sigma_m
        cost, weight = loss(residual**2)
        slope = np.where(residual[..., None] > 0, -slope / sigma_m, 0.0)
        pull = ((weight * residual)[..., None] * slope).reshape(-1, len(ALONG), 2)
        bend = (weight[..., None, None] * slope[..., :, None] * slope[..., None, :]).reshape(-1, len(ALONG), 2, 2)
        gradient = np.einsum("if,mfk->mik", mix, pull).reshape(-1, 4)
        curvature = np.einsum("fij,mfkl->mikjl", both, bend).reshape(-1, 4, 4)
        return Terms(columns, cost.reshape(-1, len(ALONG)).sum(axis=1), gradient, curvature)

    return factor
