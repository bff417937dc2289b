"""Chains over the last seconds of a walk, each in a minimum of its own; what is older is marginalised.

Least squares finds the minimum that it begins in, and walls make many. Where the way of a chain meets a wall, copies of
it whose last seconds are turned or stretched are relaxed, and kept where they end elsewhere. Where it comes to stairs a
copy goes on on the level on their other side. A chain counts by Laplace's approximation of its evidence:
minus its cost, minus half the log-determinant of its normal equations.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench_baselines.learned.signals import turned
from pdrbench_lab.factor_graph.chain import STATE, ChainParams, motion, prior, rolled_out
from pdrbench_lab.factor_graph.graph import Factor, Solution, geman_mcclure, huber, solve, squared, without
from pdrbench_lab.factor_graph.radio import Scan, ScanGrids, radio
from pdrbench_lab.factor_graph.walls import ALONG, STAIRS_M, Distances, walls


@dataclass(frozen=True, slots=True)
class WindowParams:
    """Defaults, ours; those of walls were chosen on 43 train walks of `MallPhone-v2`, one of each outing.

    Attributes:
        chain: Start, heading bias and length scale.
        lag: Seconds of walking that are kept; 0 for all.
        huber_sigmas: Displacements farther off count linearly; 0 for squares throughout.
        margin_m, wall_sigma_m: A place nearer to a wall than the first costs, 1/2 where it is nearer by the second.
        touch_sigma_m: A place nearer to a wall than `touch_m` costs as well, 1/2 where it is nearer by this; 0 for not.
        wall_cost: Most that a place costs of either kind, for four places a second: plans are wrong here and there.
        max_chains: The likeliest are kept.
        num_parents: So many of the likeliest are turned at walls.
        pivots_s: Before a wall so many seconds are turned.
        turns_rad: By so much, to both sides.
        stretches: Or their lengths changed by so much of a logarithm, up and down.
        rigidity: Copies are relaxed with walls that cost so many times as much first, so that these push them far.
        turn_every: Seconds of walking from one turning to the next, at least.
        touch_m: A way so near to a wall meets it.
        stairs_m: A way so near to stairs may lead to the level on their other side.
        num_iterations, num_branch_iterations: Of Levenberg-Marquardt, at most, after a second and after turning.
        near_m, near_rad: Chains whose last places and biases differ by less are one.
        unlikely: Chains less likely than the best by this, as a logarithm, are dropped.
    """

    chain: ChainParams = field(default_factory=ChainParams)
    lag: int = 30
    huber_sigmas: float = 0.0
    margin_m: float = 1.0
    wall_sigma_m: float = 2.0
    touch_sigma_m: float = 0.05
    wall_cost: float = 6.0
    max_chains: int = 16
    num_parents: int = 4
    pivots_s: tuple[int, ...] = (3, 8, 20)
    turns_rad: tuple[float, ...] = (0.25, 0.5)
    stretches: tuple[float, ...] = (0.15,)
    rigidity: float = 5.0
    turn_every: int = 1
    touch_m: float = 0.2
    stairs_m: float = 0.5
    num_iterations: int = 4
    num_branch_iterations: int = 8
    near_m: float = 0.3
    near_rad: float = 0.05
    unlikely: float = 20.0


class Chains(NamedTuple):
    """P chains of T states in the window, and of K that have left it.

    Attributes:
        state: (P, T, 4) place, heading bias, log length scale.
        level: (P, T) int.
        mean, information: (P, 4), (P, 4, 4) prior of the first state in the window.
        log_evidence: (P,) of what was marginalised.
        past: (P, K, 4) states when they left.
        past_level: (P, K).
    """

    state: FloatArray
    level: IntArray
    mean: FloatArray
    information: FloatArray
    log_evidence: FloatArray
    past: FloatArray
    past_level: IntArray

    def take(self, index: IntArray) -> Chains:
        """Some of them, in this order; one may be taken twice."""
        parts: Any = (part[index] for part in self)
        return Chains(*parts)


class Smoothed(NamedTuple):
    """A chain of all states: (T, 2), per-axis standard deviation (T,), level (T,), and its fraction of the evidence."""

    xy_m: FloatArray
    sigma_m: FloatArray
    level: IntArray
    fraction: float


class Window:
    """See the module.

    Args:
        params: See `WindowParams`.
        floors: Distances to walls by level; empty without a map.
        stairs: That chains may take, by the levels before and after.
        grids: Of a survey, or None.
        remembers: Keeps what `smoothed` needs.
    """

    def __init__(
        self,
        params: WindowParams,
        floors: Mapping[int, Distances],
        stairs: Mapping[tuple[int, int], Distances],
        grids: ScanGrids | None,
        *,
        remembers: bool,
    ) -> None:
        self._params, self._floors, self._stairs, self._grids = params, floors, stairs, grids
        self._remembers = remembers
        self._loss = huber(params.huber_sigmas) if params.huber_sigmas else squared
        self._moves_m, self._covariances_m2 = np.zeros((0, 2)), np.zeros((0, 2, 2))
        self._scans: list[tuple[int, Scan]] = []
        self._since_turned = 0
        self._first = 0  # number of the first state in the window, of those whose moves and scans are kept

    def begin(self, xy_m: FloatArray, level: int, sigma_m: float) -> None:
        """One chain, at a place (2,) known to so much per axis."""
        mean = np.array([[*xy_m, 0.0, 0.0]])
        self.chains = Chains(
            state=mean[:, None],
            level=np.full((1, 1), level),
            mean=mean,
            information=np.diag(self._params.chain.state_sigma(sigma_m) ** -2)[None],
            log_evidence=np.zeros(1),
            past=np.zeros((1, 0, STATE)),
            past_level=np.zeros((1, 0), dtype=np.int64),
        )
        self._start = mean, self.chains.information
        self._relax(1)

    def move(self, move_m: FloatArray, covariance_m2: FloatArray) -> None:
        """The next second of walking: extend, relax, take stairs, turn where a wall is met, marginalise."""
        p, last = self._params, self.chains
        state = rolled_out(last.state[:, -1], move_m[None])[:, 1:]
        self.chains = last._replace(
            state=np.concatenate([last.state, state], axis=1),
            level=np.concatenate([last.level, last.level[:, -1:]], axis=1),
        )
        self._moves_m = np.concatenate([self._moves_m, move_m[None]])
        self._covariances_m2 = np.concatenate([self._covariances_m2, covariance_m2[None]])
        self._relax(p.num_iterations)
        self._prune()
        self._take_stairs()
        self._since_turned += 1
        if p.max_chains > 1 and self._floors and self._since_turned >= p.turn_every:
            parents = np.argsort(-self.score, kind="stable")[: p.num_parents]
            parents = parents[self._meets_wall()[parents]]
            if len(parents):
                self._branch(parents)
                self._since_turned = 0
        if p.lag and self.chains.state.shape[1] > p.lag + 1:
            self._shrink()

    def receive(self, scan: Scan) -> None:
        """A scan at the last state."""
        self._scans.append((self._first + self.chains.state.shape[1] - 1, scan))
        self._relax(self._params.num_iterations)
        self._prune()

    def change_level(self, level: IntArray) -> None:
        """The last states are on these levels (P,)."""
        self.chains = self.chains._replace(level=np.column_stack([self.chains.level[:, :-1], level]))
        self._relax(self._params.num_iterations)
        self._prune()

    @property
    def fraction(self) -> FloatArray:
        """(P,) of each chain in the evidence."""
        weight = np.exp(self.score - self.score.max())
        return np.asarray(weight / weight.sum())

    @property
    def level(self) -> int:
        """That of most evidence."""
        levels, which = np.unique(self.chains.level[:, -1], return_inverse=True)
        return int(levels[np.argmax(np.bincount(which, self.fraction))])

    def last(self) -> tuple[FloatArray, float]:
        """The mean of the last state (4,) over the chains of the likeliest level, and the deviation per axis."""
        fraction = self.fraction * (self.chains.level[:, -1] == self.level)
        fraction = fraction / fraction.sum()
        state = self.chains.state[:, -1]
        mean = fraction @ state
        within_m2 = np.trace(self._solution.last_covariance(STATE)[:, :2, :2], axis1=1, axis2=2)
        between_m2 = np.square(state[:, :2] - mean[:2]).sum(axis=1)
        return mean, math.sqrt(float(fraction @ (within_m2 + between_m2)) / 2.0)

    def smoothed(self, num_iterations: int) -> list[Smoothed]:
        """Every chain over the whole walk, relaxed with nothing marginalised."""
        now = self.chains
        whole = now._replace(
            state=np.concatenate([now.past, now.state], axis=1),
            level=np.concatenate([now.past_level, now.level], axis=1),
        )
        mean, information = (np.repeat(part, len(now.state), axis=0) for part in self._start)
        solution = solve(
            self._factors(whole.level, mean, information, 0, whole.level.shape[1]),
            whole.state.ravel(),
            num_parts=len(whole.state),
            num_iterations=num_iterations,
        )
        score = -solution.cost - 0.5 * solution.log_determinant
        weight = np.exp(score - score.max())
        state = solution.values.reshape(whole.state.shape)
        variance_m2 = np.trace(solution.covariances(STATE)[..., :2, :2], axis1=2, axis2=3) / 2.0
        return [
            Smoothed(state[k, :, :2], np.sqrt(variance_m2[k]), whole.level[k], float(weight[k] / weight.sum()))
            for k in range(len(state))
        ]

    # Parts.

    def _factors(
        self,
        level: IntArray,
        mean: FloatArray,
        information: FloatArray,
        first: int,
        num_scanned: int,
        rigidity: float = 1.0,
    ) -> list[Factor]:
        """Of chains with levels (P, T), from state `first` of those kept on; scans of `num_scanned` states count.

        Walls cost `rigidity` times as much at most.
        """
        p, (count, num_states) = self._params, level.shape
        factors = [prior(mean, information, num_states)]
        if num_states > 1:
            own = slice(first, first + num_states - 1)
            factors.append(motion(self._moves_m[own], self._covariances_m2[own], p.chain, count, self._loss))
            if self._floors:
                loss = geman_mcclure(rigidity * p.wall_cost)
                for margin_m, sigma_m in ((p.margin_m, p.wall_sigma_m), (p.touch_m, p.touch_sigma_m)):
                    if sigma_m > 0:
                        factors.append(
                            walls(self._floors, self._stairs, level, margin_m=margin_m, sigma_m=sigma_m, loss=loss)
                        )
        scans = [(at - first, scan) for at, scan in self._scans if first <= at < first + num_scanned]
        if scans and self._grids is not None:
            factors.append(radio(self._grids, scans, level))
        return factors

    def _relax(self, num_iterations: int) -> None:
        """Towards the minimum of each chain."""
        now = self.chains
        self._solution = self._solved(now, num_iterations)
        self.chains = now._replace(state=self._solution.values.reshape(now.state.shape))
        self.score = now.log_evidence - self._solution.cost - 0.5 * self._solution.log_determinant

    def _solved(self, chains: Chains, num_iterations: int, rigidity: float = 1.0) -> Solution:
        num_states = chains.level.shape[1]
        factors = self._factors(chains.level, chains.mean, chains.information, self._first, num_states, rigidity)
        return solve(factors, chains.state.ravel(), num_parts=len(chains.state), num_iterations=num_iterations)

    def _prune(self) -> None:
        """Leaves one chain in each minimum, and drops unlikely ones."""
        p, last, level = self._params, self.chains.state[:, -1], self.chains.level[:, -1]
        kept: list[int] = []
        for one in np.argsort(-self.score, kind="stable").tolist():
            if len(kept) == p.max_chains or self.score[one] < self.score.max() - p.unlikely:
                break
            is_same = level[kept] == level[one]
            is_same &= np.hypot(*(last[kept, :2] - last[one, :2]).T) <= p.near_m
            is_same &= np.abs(last[kept, 2] - last[one, 2]) <= p.near_rad
            if not is_same.any():
                kept.append(one)
        if len(kept) < len(last):
            index = np.array(kept)
            self.chains, self.score = self.chains.take(index), self.score[index]
            self._solution = self._solution.take(index)

    def _last_way_m(self) -> FloatArray:
        """(P, F, 2) places that the last second leads each chain along, from where it was with its bias and scale."""
        now = self.chains
        before = np.concatenate([now.state[:, -2, :2], now.state[:, -1, 2:]], axis=1)
        reached = rolled_out(before, self._moves_m[-1:])
        way_m: FloatArray = reached[:, :1, :2] + ALONG[:, None] * (reached[:, 1:, :2] - reached[:, :1, :2])
        return way_m

    def _meets_wall(self) -> BoolArray:
        """(P,) whether the last second leads a chain nearly to a wall."""
        ways_m = zip(self.chains.level[:, -1].tolist(), self._last_way_m(), strict=True)
        inside_m = [self._floors[level].at(way_m)[0].min() for level, way_m in ways_m]
        return np.array(inside_m) < self._params.touch_m

    def _take_stairs(self) -> None:
        """Copies of the chains that the last second leads to stairs join, on the level that those lead to."""
        level, way_m = self.chains.level[:, -1], self._last_way_m()
        who: list[int] = []
        to: list[int] = []
        for (before, after), stairs in self._stairs.items():
            for one in np.flatnonzero(level == before).tolist():
                if stairs.at(way_m[one])[0].max() > STAIRS_M - self._params.stairs_m:
                    who.append(one)
                    to.append(after)
        if who:
            copies = self.chains.take(np.array(who))
            self._join(copies._replace(level=np.column_stack([copies.level[:, :-1], to])))
            self._relax(self._params.num_branch_iterations)
            self._prune()

    def _branch(self, parents: IntArray) -> None:
        """Copies of some chains join, their last seconds turned or stretched."""
        p, num_states = self._params, self.chains.state.shape[1]
        pivots = sorted({min(pivot, num_states - 1) for pivot in p.pivots_s})
        changes = [(sign * turn, 0.0) for turn in p.turns_rad for sign in (1.0, -1.0)]
        changes += [(0.0, sign * stretch) for stretch in p.stretches for sign in (1.0, -1.0)]
        ways = list(itertools.product(pivots, changes))
        copies = self.chains.take(np.repeat(parents, len(ways)))
        state = copies.state.copy()
        for one, (pivot, (turn, stretch)) in zip(state, len(parents) * ways, strict=True):
            middle_m = one[-1 - pivot, :2].copy()
            one[-pivot:, :2] = middle_m + math.exp(stretch) * turned(one[-pivot:, :2] - middle_m, turn)
            one[-pivot:, 2:] += turn, stretch
        if p.rigidity > 1.0:
            solution = self._solved(copies._replace(state=state), p.num_branch_iterations, p.rigidity)
            state = solution.values.reshape(state.shape)
        self._join(copies._replace(state=state))
        self._relax(p.num_branch_iterations)
        self._prune()

    def _join(self, others: Chains) -> None:
        parts: Any = zip(self.chains, others, strict=True)
        self.chains = Chains(*(np.concatenate(part) for part in parts))

    def _shrink(self) -> None:
        """Marginalises the first state."""
        now, two = self.chains, self.chains.state[:, :2]
        factors = self._factors(now.level[:, :2], now.mean, now.information, self._first, 1)
        keeps = np.arange(2 * STATE) >= STATE
        gone = without([factor(two.ravel()) for factor in factors], keeps, two.ravel(), len(two))
        self.chains = now._replace(
            state=now.state[:, 1:],
            level=now.level[:, 1:],
            mean=gone.mean,
            information=gone.information,
            log_evidence=now.log_evidence + gone.log_evidence,
        )
        if self._remembers:
            past = np.concatenate([now.past, two[:, :1]], axis=1)
            past_level = np.concatenate([now.past_level, now.level[:, :1]], axis=1)
            self.chains = self.chains._replace(past=past, past_level=past_level)
            self._first += 1
        else:
            self._moves_m, self._covariances_m2 = self._moves_m[1:], self._covariances_m2[1:]
            self._scans = [(at - 1, scan) for at, scan in self._scans if at > 0]
        self._relax(1)
