"""Survivors of a Viterbi search on a map: places, each with a factor on lengths and an error of headings.

A state is a square of the floor, one of some factors and one of some errors. Of all paths that lead to a state the
likeliest survives, with the exact place where it ends, so that squares do not round displacements. Beside the
likelihood of that path a survivor carries the sum over all paths that were merged into it: the estimate at a time is
the mean over survivors by that sum, the revised past follows the survivors of the end back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdrbench.building import Building
from pdrbench.filters import MapFilter
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench_baselines.learned.wlan import ScanPlaces
from pdrbench_baselines.viterbi_map.lattice import lattice_of

NODES: Final = (-1.4, 0.0, 1.4)  # standard deviations of a displacement along each of its axes
START_NODES: Final = (-1.6, -0.8, 0.0, 0.8, 1.6)  # of a start
RESTART_M: Final = 1.0  # spread of the first restart in a row


@dataclass(frozen=True, slots=True)
class TrellisParams:
    """Defaults, ours.

    Attributes:
        square_m: Side of a square of the floor.
        start_sigma_m: Spread around a start, per axis.
        scale_sigma, num_scales: Spread of the factors on lengths, and how many there are.
        bias_sigma_rad, num_biases: The same of heading errors.
        bias_walk_rad: By which a heading error wanders in a second.
        wall_probability: Of a walker who goes through a wall of the plan: plans are wrong here and there.
        beam: Survivors less likely than the best by this, as a logarithm, are dropped.
        max_survivors: The likeliest are kept.
        lost_fraction: How often, at a scan, all survivors are in the wrong place.
    """

    square_m: float = 0.8
    start_sigma_m: float = 0.5
    scale_sigma: float = 0.06
    num_scales: int = 5
    bias_sigma_rad: float = math.radians(9.0)
    num_biases: int = 9
    bias_walk_rad: float = math.radians(2.0)
    wall_probability: float = 0.003
    beam: float = 12.0
    max_survivors: int = 2000
    lost_fraction: float = 0.002


class Survivors(NamedTuple):
    """N states that are reached, and the likeliest path to each.

    Attributes:
        local_m: (N, 2) where it ends, in coordinates of the map.
        cell: (N,) of the map.
        scale, bias: (N,) indices of the factor on lengths and of the heading error.
        log_weight: (N,) sum over the paths to it.
        log_path: (N,) of the likeliest one.
        parent: (N,) the survivor of the time before whose path it goes on; -1 where all begin.
    """

    local_m: FloatArray
    cell: NDArray[np.int32]
    scale: NDArray[Any]
    bias: NDArray[Any]
    log_weight: FloatArray
    log_path: FloatArray
    parent: NDArray[Any]

    def take(self, index: IntArray) -> Survivors:
        """Some of them, in this order."""
        parts: Any = (part[index] for part in self)
        return Survivors(*parts)

    def joined(self, others: Survivors) -> Survivors:
        """These and others."""
        pairs: Any = zip(self, others, strict=True)
        return Survivors(*(np.concatenate(pair) for pair in pairs))

    def heavier(self, log: FloatArray) -> Survivors:
        """The same with weights and paths times some factors, given as logarithms (N,)."""
        return self._replace(log_weight=self.log_weight + log, log_path=self.log_path + log)


class _Stage(NamedTuple):
    """Survivors at a time: whose path each goes on, and where it is."""

    t_s: float
    parent: NDArray[np.int32]
    xy_m: NDArray[np.float32]
    level: NDArray[np.int16]


class Trellis(MapFilter):
    """See the module; `begin_near` or `begin_among` comes first.

    Args:
        building: The map.
        rng: Places survivors around stairs and lifts; nothing else is drawn.
        params: See `TrellisParams`.
        level: Where the walk begins.
        lag_s: What is older is final, and its survivors are forgotten; what is kept for `path` takes at most 18 bytes a
            survivor and second.
    """

    def __init__(
        self,
        building: Building,
        rng: np.random.Generator,
        params: TrellisParams,
        level: int,
        *,
        lag_s: float = math.inf,
    ) -> None:
        super().__init__()
        p = self._params = params
        self._building, self._rng, self._lag_s = building, rng, lag_s
        self._lattice = lattice_of(building, level, p.square_m)
        self._enter(self._lattice.convex, self._lattice.convex.origin_xy_m, level)
        scale_z, bias_z = _evenly(p.num_scales), _evenly(p.num_biases)
        self._scales, self._biases_rad = np.exp(p.scale_sigma * scale_z), p.bias_sigma_rad * bias_z
        self._log_prior = _log_normal(scale_z)[:, None] + _log_normal(bias_z)[None, :]
        step_rad = float(self._biases_rad[1] - self._biases_rad[0]) if p.num_biases > 1 else math.inf
        # A heading error moves on to its neighbour so rarely that its variance grows by bias_walk_rad^2 a second.
        self._shifts_every = max(1, round(0.2 * min(step_rad / max(p.bias_walk_rad, 1e-9), 1e3) ** 2))
        shift = min(0.5 * self._shifts_every * (p.bias_walk_rad / step_rad) ** 2, 1 / 3)
        self._log_shift = np.log(np.maximum([shift, 1.0 - 2.0 * shift, shift], 1e-12))
        self._now_s, self._num_moves = 0.0, 0
        self._stages: list[_Stage] = []
        self._final: list[FloatArray] = []
        self._survivors: Survivors | None = None

    @property
    def mean_scale(self) -> float:
        """Factor on lengths."""
        return float(self.fraction @ self._scales[self._reached.scale])

    @property
    def mean_bias_rad(self) -> float:
        """Error of headings."""
        return float(self.fraction @ self._biases_rad[self._reached.bias])

    @property
    def fraction(self) -> FloatArray:
        """(N,) of each survivor in the weight of all; their sum is 1."""
        log_weight = self._reached.log_weight
        fraction: FloatArray = np.exp(log_weight - _log_sum(log_weight))
        return fraction

    def begin_near(self, xy_m: FloatArray, radius_m: float = 0.0) -> None:
        """Around a place (2,), known to lie in a disc; off the floor it is taken to the nearest floor of its level."""
        self._begin_around(np.asarray(xy_m, dtype=np.float64), max(self._params.start_sigma_m, radius_m / 2))

    def begin_among(self, places: ScanPlaces) -> None:
        """Where a scan may have been received."""
        self._settle(self._among(places))

    def weigh(self, places: ScanPlaces, *, trust: float, may_be_lost: bool) -> None:
        """Weighs survivors by the density of a scan at their places; see `LearnedMapFilter.weigh`."""
        log_density = trust * np.log(places.density_per_m2(self.particles_xy_m, self.particles_level))
        weighed = self._going_on().heavier(log_density)
        if may_be_lost and np.isin(places.level, self._lattice.convex.level).any():
            # Who is lost is where the scan was received, and took a path as likely as the best one.
            lost = math.log(self._params.lost_fraction) - trust * math.log(places.area_m2)
            fresh = self._among(places)
            fresh = fresh.heavier(np.full(len(fresh.cell), lost - _log_sum(fresh.log_weight)))
            log_weight = fresh.log_weight + _log_sum(weighed.log_weight)
            log_path = fresh.log_path + float(weighed.log_path.max())
            parent = np.full(len(fresh.cell), int(np.argmax(weighed.log_weight)))
            fresh = fresh._replace(log_weight=log_weight, log_path=log_path, parent=parent)
            weighed = weighed.joined(fresh)
        self._settle(weighed)

    def change_level(self, levels: int, *, by_lift: bool) -> None:
        """So many levels up, by a change of pressure."""
        before = self._going_on()
        self._survivors = None
        chosen = self._change_level(levels, by_lift=by_lift, rng=self._rng)
        if self._is_one_level and self.level in self._building.levels:
            self._lattice = lattice_of(self._building, self.level, self._params.square_m)
        if chosen is None:  # all begin anew, each with its factor and its error
            zero = np.zeros(len(before.cell))
            after = before._replace(log_weight=zero, log_path=zero)
        else:
            after = before.take(chosen)
        self._settle(after._replace(local_m=self._local_m, cell=self._cell))

    def move(self, move_m: FloatArray, covariance_m2: FloatArray, end_s: float) -> None:
        """One displacement (2,) and its covariance (2, 2), of the second that ended: extend, stop at walls, merge."""
        self._now_s, self._num_moves = end_s, self._num_moves + 1
        reached, to_m = self._extended(move_m, covariance_m2)
        cell = reached.cell.copy()
        free = self._walk(reached.local_m, to_m, cell)
        arrived = reached._replace(local_m=to_m, cell=cell)
        ended = arrived.take(np.flatnonzero(free)).joined(self._through_walls(reached, to_m, free))
        if not len(ended.cell):
            self._begin_around(self.xy_m + move_m, self._restart_sigma_m(RESTART_M))
            return
        self._resets_in_a_row = 0
        self._settle(ended)

    def stay(self, end_s: float) -> None:
        """A second without a step has ended."""
        self._now_s = end_s
        if self._stages:
            same = np.arange(self.num_particles, dtype=np.int32)
            self._remember(self._stages[-1]._replace(t_s=end_s, parent=same))

    def path(self, *, takes_likeliest: bool) -> FloatArray:
        """(K, 5) t_s, x_m, y_m, level, sigma_m of the walk, seen from its end; empty where nothing was kept.

        Args:
            takes_likeliest: The likeliest path (Viterbi); else the mean over the paths of all survivors by weight. Of
                what was final before it is the mean.
        """
        if not self._stages:
            return np.zeros((0, 5))
        rows = self._path(takes_likeliest=takes_likeliest)
        return np.concatenate([*self._final, rows]) if self._final else rows

    # Parts.

    def _path(self, *, takes_likeliest: bool) -> FloatArray:
        """The same of what is not final yet."""
        fraction = self.fraction
        if takes_likeliest:
            fraction = np.zeros(self.num_particles)
            fraction[int(np.argmax(self._reached.log_path))] = 1.0
        rows: list[tuple[float, ...]] = []
        for number, stage in reversed(list(enumerate(self._stages))):
            lowest = int(stage.level.min())
            level = lowest + int(np.argmax(np.bincount(stage.level - lowest, fraction)))
            here = fraction * (stage.level == level)
            here = here / here.sum()
            xy_m = here @ stage.xy_m.astype(np.float64)
            spread_m2 = here @ np.sum((stage.xy_m - xy_m) ** 2, axis=1)
            if not rows or stage.t_s < rows[-1][0]:  # of several at a time the last one has seen everything
                rows.append((stage.t_s, *xy_m, level, math.sqrt(spread_m2 / 2)))
            if number == 0 or stage.parent[0] < 0:
                break
            count = len(self._stages[number - 1].parent)
            fraction = np.asarray(np.bincount(stage.parent, fraction, minlength=count), dtype=np.float64)
        return np.array(rows[::-1])

    def _remember(self, stage: _Stage) -> None:
        """Keeps a stage, and makes final what is older than the lag."""
        self._stages.append(stage)
        while self._stages[0].t_s < stage.t_s - self._lag_s:
            self._final.append(self._path(takes_likeliest=False)[:1])
            self._stages = [later for later in self._stages if later.t_s > self._final[-1][0, 0]]

    @property
    def _reached(self) -> Survivors:
        assert self._survivors is not None
        return self._survivors

    def _going_on(self) -> Survivors:
        """The survivors as their own parents."""
        return self._reached._replace(parent=np.arange(self.num_particles))

    def _extended(self, move_m: FloatArray, covariance_m2: FloatArray) -> tuple[Survivors, FloatArray]:
        """Every survivor with every displacement and every change of its heading error, but for the unlikely ones.

        Returns:
            reached: Still at their places, with the weights of where they go.
            to_m: (N, 2) where they go.
        """
        p, now = self._params, self._going_on()
        z = _pairs(np.array(NODES))
        moves_m = move_m + z @ np.linalg.cholesky(covariance_m2).T
        log_move = _log_normal(z).sum(axis=1)
        log_move = log_move - _log_sum(log_move)
        shifts: IntArray = np.zeros(1, dtype=np.int64)
        log_shift: FloatArray = np.zeros(1)
        if self._num_moves % self._shifts_every == 0 and p.num_biases > 1:
            shifts, log_shift = np.arange(-1, 2), self._log_shift
        who, which, shift = _product(len(now.cell), len(z), len(shifts))
        bias = now.bias[who] + shifts[shift]
        log = log_move[which] + log_shift[shift]
        log_weight = now.log_weight[who] + log
        kept = np.flatnonzero((log_weight > log_weight.max() - p.beam) & (bias >= 0) & (bias < p.num_biases))
        reached = now.take(who[kept]).heavier(log[kept])._replace(bias=bias[kept])
        cosine, sine = np.cos(self._biases_rad)[reached.bias], np.sin(self._biases_rad)[reached.bias]
        x_m, y_m = moves_m[which[kept]].T * self._scales[reached.scale]
        return reached, reached.local_m + np.column_stack([cosine * x_m - sine * y_m, sine * x_m + cosine * y_m])

    def _through_walls(self, reached: Survivors, to_m: FloatArray, free: BoolArray) -> Survivors:
        """Those before a wall that are likely enough on its other side, there."""
        p = self._params
        stopped = np.flatnonzero(~free)
        if p.wall_probability == 0 or not len(stopped):
            return reached.take(stopped[:0])
        price = math.log(p.wall_probability)
        best = max(float(reached.log_weight[free].max(initial=-math.inf)), float(reached.log_weight.max()) + price)
        stopped = stopped[reached.log_weight[stopped] + price > best - p.beam]
        local_m, cell = self._lattice.put(to_m[stopped], reached.cell[stopped])
        behind = reached.take(stopped)._replace(local_m=local_m, cell=cell).take(np.flatnonzero(cell >= 0))
        return behind.heavier(np.full(len(behind.cell), price))

    def _settle(self, reached: Survivors) -> None:
        """Merges survivors of one state, drops unlikely ones, locates, and remembers."""
        p = self._params
        if self._stages and math.isfinite(self._lag_s) and (reached.parent < 0).all():  # none goes on
            self._final.append(self._path(takes_likeliest=False))
            self._stages = []
        key = self._lattice.key(reached.local_m, reached.cell)
        key = (key * p.num_scales + reached.scale) * p.num_biases + reached.bias
        order = np.lexsort((-reached.log_path, key))
        first = np.flatnonzero(np.diff(key[order], prepend=-1) != 0)
        top = float(reached.log_weight.max())
        total = np.add.reduceat(np.exp(reached.log_weight[order] - top), first)
        kept = np.flatnonzero(total > math.exp(-p.beam) * total.max())
        if len(kept) > p.max_survivors:
            kept = np.sort(np.argsort(-total, kind="stable")[: p.max_survivors])
        left = reached.take(order[first[kept]])
        self._survivors = left = left._replace(log_weight=np.log(total[kept]), log_path=left.log_path - top)
        self._local_m, self._cell = left.local_m, left.cell
        self._locate(on_level=True)
        xy_m, level = self.particles_xy_m.astype(np.float32), self.particles_level.astype(np.int16)
        self._remember(_Stage(self._now_s, left.parent.astype(np.int32), xy_m, level))

    def _locate(self, *, on_level: bool = False) -> None:
        """The estimate: the level of most weight; mean and spread there."""
        if self._survivors is None:  # the base places survivors around stairs
            super()._locate(on_level=on_level)
            return
        fraction, level = self.fraction, self.particles_level
        levels, which = np.unique(level, return_inverse=True)
        self.level = int(levels[np.argmax(np.bincount(which, fraction))])
        fraction = fraction * (level == self.level)
        fraction = fraction / fraction.sum()
        middle_m = fraction @ self._local_m
        self.sigma_m = math.sqrt(float(fraction @ np.sum((self._local_m - middle_m) ** 2, axis=1)) / 2)
        self.xy_m = self._origin_m + middle_m

    def _begin_around(self, xy_m: FloatArray, sigma_m: float) -> None:
        place_m, cell = self._lattice.convex.nearest(xy_m, self.level)
        self._settle(self._spread_out(place_m[None] - self._origin_m, np.array([cell]), np.zeros(1), sigma_m))

    def _among(self, places: ScanPlaces) -> Survivors:
        """Survivors around the places of a scan on this map."""
        convex = self._lattice.convex
        own = np.flatnonzero(np.isin(places.level, convex.level))
        found = [convex.nearest(places.xy_m[k], int(places.level[k])) for k in own]
        local_m = np.array([place_m for place_m, _ in found]) - self._origin_m
        log_weight = np.log(places.weight[own])
        return self._spread_out(local_m, np.array([cell for _, cell in found]), log_weight, places.spread_m)

    def _spread_out(self, near_m: FloatArray, cell: IntArray, log_weight: FloatArray, sigma_m: float) -> Survivors:
        """Around places (K, 2) with weights (K,): every offset that no wall is before, every factor, every error."""
        z = _pairs(np.array(START_NODES))
        place, node = _product(len(near_m), len(z))
        to_m, ended = near_m[place] + sigma_m * z[node], cell[place].astype(np.int32)
        free = np.flatnonzero(self._walk(near_m[place], to_m, ended) | ~z[node].any(axis=1))
        who, scale, bias = _product(len(free), *self._log_prior.shape)
        who = free[who]
        log = log_weight[place[who]] + _log_normal(z[node[who]]).sum(axis=1) + self._log_prior[scale, bias]
        return Survivors(to_m[who], ended[who], scale, bias, log, log, np.full(len(who), -1))


def _evenly(count: int) -> FloatArray:
    """(count,) standard deviations, from -2 to 2 of five and more, nearer to 0 of fewer."""
    wide = min(2.0, 0.5 * (count - 1))
    return np.linspace(-wide, wide, count)


def _product(*counts: int) -> tuple[IntArray, ...]:
    """Indices of every combination."""
    return tuple(part.ravel() for part in np.indices(counts))


def _pairs(nodes: FloatArray) -> FloatArray:
    """(K * K, 2) every pair of K nodes."""
    x, y = _product(len(nodes), len(nodes))
    return np.column_stack([nodes[x], nodes[y]])


def _log_normal(z: FloatArray) -> FloatArray:
    """Logarithm of a normal density, but for a constant."""
    density: FloatArray = -0.5 * np.square(z)
    return density


def _log_sum(log_weight: FloatArray) -> float:
    top = float(log_weight.max())
    return top + math.log(float(np.exp(log_weight - top).sum()))
