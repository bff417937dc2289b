"""What particle filters on a map have in common: the map, places, spreading, restarting, and the estimate."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.building import Building
from pdrbench.building.convex import ConvexMap
from pdrbench.building.level_map import level_map
from pdrbench.compiled import compiled
from pdrbench.errors import PdrbenchError
from pdrbench.filters.map_walk import walk
from pdrbench.geometry import BoolArray, FloatArray, IntArray

MAX_RESTART_M: Final = 16.0  # a cloud that is spread wider says nothing
MIN_ARRIVED: Final = 0.01  # fraction of particles that have taken the stairs by themselves, to go on with these alone
MIN_ON_WAY: Final = 0.5  # ours: the same of those that are still on stairs
ARRIVAL_M: Final = 1.0  # spread around stairs or a lift, per axis, where too few have
ARRIVAL_TRIES: Final = 8
SHAFT_M: Final = 0.5  # by which what is drawn of one shaft may be off from level to level


class FilterError(PdrbenchError):
    """A filter was asked for what it cannot do; says what and what to do instead."""


class MapFilter:
    """Particles on a map: base of filters, which add their state, their motion and their weights.

    Attributes:
        resets: How often every particle had hit a wall and all were spread again.
        level: Of the estimate.
        xy_m: (2,) the estimate.
        sigma_m: Standard deviation of the particles per axis.
    """

    def __init__(self) -> None:
        self.resets, self._resets_in_a_row = 0, 0
        self._local_m: FloatArray = np.zeros((0, 2))
        self._cell: NDArray[np.int32] = np.zeros(0, dtype=np.int32)
        self._building_followed: Building | None = None
        self.level = 0

    def follow_levels(self, building: Building | None, level: int) -> None:
        """From now on the level is what `_change_level` says: no particle gets to the floor of another one.

        Stairs stay open: a change becomes known some treads late.
        """
        self._followed_level, self._building_followed = level, building
        if building is not None and self._map is not None and not self._is_one_level:
            kind = np.array([polygon.kind for polygon in building.polygons])[self._map.polygon]
            self._is_floor: BoolArray = kind == "floor"
            self._is_lift: BoolArray = kind == "lift"

    def _change_level(self, levels: int, *, by_lift: bool, rng: np.random.Generator) -> IntArray | None:
        """Puts all particles onto the level so many above.

        Those that have come there by stairs, are on stairs, or in a lift that stops there, draw the others to them;
        where these are too few, all begin anew at the stairs, or the lift, nearest to the estimate.

        Returns:
            (N,) the particle whose place each has taken; None where all began anew.
        """
        building = self._building_followed
        if building is None or self._map is None:
            self.level += levels
            return None
        own = building.levels.index(self._followed_level)
        self.level = self._followed_level = building.levels[min(max(own + levels, 0), len(building.levels) - 1)]
        if self._is_one_level:
            convex = level_map(building, self.level)
            self._enter(convex, convex.origin_xy_m, self.level)
            self._spread(self.num_particles, self.xy_m, ARRIVAL_M, rng, tries=ARRIVAL_TRIES)
            self._locate(on_level=True)
            return None
        on_way = (not by_lift) & ~(self._is_floor | self._is_lift)[self._cell]
        arrived = (not by_lift) & (self.particles_level == self.level) | self._carried_by_lift()
        came = np.flatnonzero(arrived | on_way)
        if arrived.mean() < MIN_ARRIVED and on_way.mean() < MIN_ON_WAY:
            place_m = _arrival(building, self.xy_m, self.level, ("lift",) if by_lift else ("stairs", "ramp"))
            self._spread(self.num_particles, place_m, ARRIVAL_M, rng, tries=ARRIVAL_TRIES)
            self._locate(on_level=True)
            return None
        chosen = came[rng.integers(len(came), size=self.num_particles)]
        chosen[came] = came
        self._local_m, self._cell = self._local_m[chosen], self._cell[chosen]
        self._locate(on_level=True)
        return chosen

    def _carried_by_lift(self) -> BoolArray:
        """(N,) which particles are in a lift that stops at the level of now, onto which these are put."""
        assert self._map is not None
        carried = self._is_lift[self._cell]
        rides = np.flatnonzero(carried & (self._map.level[self._cell] != self.level))
        if len(rides):
            to_m, cell = self._map.nearest(self.particles_xy_m[rides], self.level)
            stops = self._is_lift[cell] & (np.hypot(*(to_m - self.particles_xy_m[rides]).T) < SHAFT_M)
            self._local_m[rides[stops]], self._cell[rides[stops]] = to_m[stops] - self._origin_m, cell[stops]
            carried[rides[~stops]] = False
        return carried

    def _enter(self, convex: ConvexMap | None, origin_xy_m: FloatArray, level: int) -> None:
        """Takes a map, or none: then no wall stops a particle, and `origin_xy_m` is where local coordinates are 0."""
        self._map = convex
        self._origin_m = origin_xy_m if convex is None else convex.origin_xy_m
        self._levels, self._storey = np.unique([level] if convex is None else convex.level, return_inverse=True)
        self._is_one_level = len(self._levels) == 1
        self.level = level

    @property
    def num_particles(self) -> int:
        return len(self._cell)

    @property
    def particles_xy_m(self) -> FloatArray:
        """(N, 2)."""
        xy_m: FloatArray = self._local_m + self._origin_m
        return xy_m

    @property
    def particles_level(self) -> IntArray:
        """(N,)."""
        level: IntArray = np.full(self.num_particles, self.level) if self._map is None else self._map.level[self._cell]
        return level

    @property
    def particles_cell(self) -> IntArray:
        """(N,) of the map that is walked on now."""
        return self._cell.astype(np.int64)

    def line_check(self) -> Callable[[FloatArray, IntArray, FloatArray], BoolArray] | None:
        """Tells of lines from places (n, 2) in cells (n,) to places (n, 2) whether no wall is between; None: no map."""
        convex, origin_m = self._map, self._origin_m
        if convex is None:
            return None

        def is_free(from_xy_m: FloatArray, cell: IntArray, to_xy_m: FloatArray) -> BoolArray:
            return walk(convex, from_xy_m - origin_m, to_xy_m - origin_m, cell.astype(np.int32))

        return is_free

    def _walk(self, from_m: FloatArray, to_m: FloatArray, cell: NDArray[np.int32]) -> BoolArray:
        """(n,) whether no wall is between places (n, 2); `cell` becomes where each particle ends."""
        if self._map is None:
            return np.ones(len(to_m), dtype=np.bool_)
        free = walk(self._map, from_m, to_m, cell)
        if self._building_followed is not None and not self._is_one_level:
            free &= ~(self._is_floor[cell] & (self._map.level[cell] != self._followed_level))
        return free

    def _place(
        self, which: IntArray, near_m: FloatArray, cell: NDArray[np.int32], sigma_m: float, rng: np.random.Generator
    ) -> BoolArray:
        """Puts particles (n,) around places (n, 2); where a wall is between (False), at the place itself."""
        ended = cell.copy()
        to_m = near_m + sigma_m * rng.standard_normal((len(which), 2))
        free = self._walk(near_m, to_m, ended)
        self._local_m[which] = np.where(free[:, None], to_m, near_m)
        self._cell[which] = np.where(free, ended, cell)
        return free

    def _scatter(
        self,
        which: IntArray,
        near_m: FloatArray,
        cell: NDArray[np.int32],
        sigma_m: float,
        rng: np.random.Generator,
        *,
        tries: int,
        shrink: float = 1.0,
    ) -> None:
        """The same in some tries for those that a wall is before, each with a spread `shrink` times the last."""
        left = np.arange(len(which))
        for _ in range(tries):
            if not len(left):
                break
            free = self._place(which[left], near_m[left], cell[left], sigma_m, rng)
            left, sigma_m = left[~free], shrink * sigma_m

    def _spread(
        self, count: int, xy_m: FloatArray, sigma_m: float, rng: np.random.Generator, *, tries: int, shrink: float = 1.0
    ) -> None:
        """All particles around a place (2,) or the floor nearest to it, each where a straight line leads to."""
        cell = 0
        if self._map is not None:
            (xy_m,), (cell,) = self._map.nearest(xy_m[None], self.level)
        self._local_m, self._cell = np.tile(xy_m - self._origin_m, (count, 1)), np.full(count, cell, dtype=np.int32)
        self._scatter(
            np.arange(count), self._local_m.copy(), self._cell.copy(), sigma_m, rng, tries=tries, shrink=shrink
        )

    def _restart_sigma_m(self, first_m: float) -> float:
        """Counts a reset: every particle has hit a wall. The spread doubles with each in a row."""
        sigma_m = min(first_m * 2.0**self._resets_in_a_row, MAX_RESTART_M)
        self.resets, self._resets_in_a_row = self.resets + 1, self._resets_in_a_row + 1
        return sigma_m

    def _locate(self, *, on_level: bool = False) -> None:
        """The estimate: the level with most particles; mean and spread of all particles, or of those on that level."""
        here = self._local_m
        if not self._is_one_level:
            storey = self._storey[self._cell]
            number = np.bincount(storey)
            most = int(number.argmax())
            self.level = int(self._levels[most])
            here = here[storey == most] if on_level and number[most] < len(here) else here
        x_m, y_m, self.sigma_m = centre(here)
        self.xy_m: FloatArray = self._origin_m + np.array([x_m, y_m])


def _arrival(building: Building, xy_m: FloatArray, level: int, kinds: tuple[str, ...]) -> FloatArray:
    """(2,) middle of the nearest polygon of these kinds on a level; the place itself where there is none."""
    ways = [p.outline_xy_m.mean(axis=0) for p in building.polygons if p.level == level and p.kind in kinds]
    if not ways:
        return xy_m
    nearest: FloatArray = min(ways, key=lambda way_m: float(np.hypot(*(way_m - xy_m))))
    return nearest


@compiled
def centre(xy: NDArray[np.float64]) -> tuple[float, float, float]:
    """Mean x and y of places (N, 2), and the standard deviation per axis."""
    x, y = 0.0, 0.0
    for i in range(len(xy)):
        x += xy[i, 0]
        y += xy[i, 1]
    x, y = x / len(xy), y / len(xy)
    squares = 0.0
    for i in range(len(xy)):
        squares += (xy[i, 0] - x) ** 2 + (xy[i, 1] - y) ** 2
    return x, y, math.sqrt(squares / (2 * len(xy)))
