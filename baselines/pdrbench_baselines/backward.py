"""Forward filtering, backward sampling: what a particle filter says of its past once a walk is over.

S. J. Godsill, A. Doucet, M. West, "Monte Carlo smoothing for nonlinear time series", JASA 99, 2004. A filter keeps its
clouds, thinned; at the end a line is drawn from the last of them, and in each cloud before it a particle with the
weight times the density of the motion to what was drawn after it. A particle that a wall parts from its successor is
not drawn where others can be. Memory is bounded: where clouds become many, all are thinned, at last the oldest go.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.localizer import Estimate

NUM_LINES: Final = 64
NUM_KEPT: Final = 256  # of the particles of a cloud
MIN_KEPT: Final = 32
MAX_STORED: Final = 2**20  # particles of all clouds together
BETWEEN_M: Final = 0.3  # kept particles are so far apart, about: lines through the same ones say no more than that
TRIES: Final = 8  # for a predecessor without a wall between

# Log-density (M, N), up to a constant, of states (M, S) after states (N, S).
Transition = Callable[[FloatArray, FloatArray], FloatArray]
# Whether no wall is between places (n, 2) in cells (n,) and places (n, 2).
LineCheck = Callable[[FloatArray, IntArray, FloatArray], BoolArray]


def gaussian(expected: Callable[[FloatArray], FloatArray], covariance: FloatArray) -> Transition:
    """The motion that takes states (N, S) to `expected` of them, with a covariance (S, S)."""
    whiten = np.linalg.inv(np.linalg.cholesky(covariance)).T

    def log_density(before: FloatArray, after: FloatArray) -> FloatArray:
        to, reached = expected(before) @ whiten, after @ whiten
        squares = np.zeros((len(after), len(before)))
        for own, other in zip(reached.T, to.T, strict=True):
            off = own[:, None] - other
            squares += np.multiply(off, off, out=off)
        return np.multiply(squares, -0.5, out=squares)

    return log_density


def mean_of(places_m: FloatArray) -> FloatArray:
    """(2,) mean of places (M, 2)."""
    mean_m: FloatArray = places_m.mean(axis=0)
    return mean_m


@dataclass(frozen=True, slots=True, eq=False)
class StoredCloud:
    """Particles of one time.

    Attributes:
        t_s: The time.
        state: (N, S), x and y first, then whatever a particle keeps.
        level: (N,) int.
        cell: (N,) int of the map that `is_free` walks on.
        weight: (N,), at least one above 0.
        is_free: None where no wall stops a particle.
    """

    t_s: float
    state: FloatArray
    level: IntArray
    cell: IntArray
    weight: FloatArray
    is_free: LineCheck | None = None

    def thinned(self, most: int) -> StoredCloud:
        """Every so many-th particle, at most `most` of them, in half the memory."""
        alive = np.flatnonzero(self.weight > 0)
        kept = alive[:: max(1, -(-len(alive) // most))]
        arrays: dict[str, NDArray[np.generic]] = {
            "state": self.state[kept].astype(np.float32),
            "level": self.level[kept].astype(np.int16),
            "cell": self.cell[kept].astype(np.int32),
            "weight": self.weight[kept].astype(np.float32),
        }
        return replace(self, **arrays)  # type: ignore[arg-type]


@dataclass(frozen=True, slots=True, eq=False)
class _Stored:
    """A cloud, since when it moved, and how; the first one of a walk did not move."""

    cloud: StoredCloud
    begin_s: float
    transition: Transition | None


class BackwardSampler:
    """Keeps the clouds of a filter and draws lines through them.

    Args:
        num_kept: Particles of a cloud that are kept, until clouds become many.
        max_stored: Particles of all clouds together.
    """

    def __init__(self, num_kept: int = NUM_KEPT, max_stored: int = MAX_STORED) -> None:
        self._num_kept, self._max_stored = num_kept, max_stored
        self._past: list[_Stored] = []
        self._num_stored = 0
        self._answers: list[FloatArray] = []

    def __len__(self) -> int:
        return len(self._past)

    @property
    def num_kept(self) -> int:
        """Particles of a cloud that are kept now, at most."""
        return self._num_kept

    @property
    def answers(self) -> FloatArray:
        """(K, 5) t_s, x_m, y_m, level, sigma_m (NaN where not claimed) that were given on the way."""
        return np.array(self._answers, dtype=np.float64).reshape(-1, 5)

    @property
    def begin_s(self) -> float:
        """Time of the first cloud that is kept; infinite before it comes."""
        return self._past[0].cloud.t_s if self._past else np.inf

    def answered(self, now_s: float, estimate: Estimate) -> Estimate:
        """Keeps an answer that was given on the way, and returns it."""
        sigma_m = np.nan if estimate.sigma_m is None else estimate.sigma_m
        self._answers.append(np.array([now_s, *estimate.xy_m, estimate.level, sigma_m]))
        return estimate

    def follow(self, cloud: StoredCloud, begin_s: float, transition: Transition | None = None) -> None:
        """The next cloud, and the motion that led to it from the one before, which began at `begin_s`.

        Without a transition it is the first of the walk: those before are forgotten.
        """
        if transition is None:
            self._past, self._num_stored = [], 0
        self._append(_Stored(cloud.thinned(self._num_kept), begin_s, transition))
        while self._num_stored > self._max_stored:
            if self._num_kept > MIN_KEPT:
                self._num_kept //= 2
                past, self._past, self._num_stored = self._past, [], 0
                for stored in past:
                    self._append(replace(stored, cloud=stored.cloud.thinned(self._num_kept)))
            else:
                self._num_stored -= len(self._past.pop(0).cloud.weight)

    def amend(self, cloud: StoredCloud) -> None:
        """What became of the last cloud by evidence: it takes its place."""
        last = self._past.pop()
        self._num_stored -= len(last.cloud.weight)
        self._append(replace(last, cloud=replace(cloud, t_s=last.cloud.t_s).thinned(self._num_kept)))

    def lines(self, rng: np.random.Generator, num_lines: int = NUM_LINES) -> tuple[FloatArray, IntArray]:
        """Draws lines through all clouds.

        Returns:
            xy_m: (T, M, 2) in each of the T clouds.
            level: (T, M).
        """
        xy_m = np.empty((len(self._past), num_lines, 2))
        level = np.empty((len(self._past), num_lines), dtype=np.int64)
        after: FloatArray | None = None
        transition: Transition | None = None
        for number in range(len(self._past) - 1, -1, -1):
            cloud = self._past[number].cloud
            state = cloud.state.astype(np.float64)
            weight = np.tile(cloud.weight.astype(np.float64), (num_lines, 1))
            if after is not None and transition is not None:
                log_density = transition(state, after)
                weight *= np.exp(log_density - log_density.max(axis=1, keepdims=True))
                weight[weight.sum(axis=1) == 0] = 1.0
            chosen = _drawn(weight, rng.random((num_lines, TRIES)))
            index = chosen[:, 0]
            if after is not None and cloud.is_free is not None:
                tried = chosen.ravel()
                ends_m = np.repeat(after[:, :2], TRIES, axis=0)
                free = cloud.is_free(state[tried, :2], cloud.cell[tried], ends_m).reshape(chosen.shape)
                index = chosen[np.arange(num_lines), np.argmax(free, axis=1)]  # the first, where none is free
            after, transition = state[index], self._past[number].transition
            xy_m[number], level[number] = after[:, :2], cloud.level[index]
        return xy_m, level

    def revised(
        self,
        rng: np.random.Generator,
        *,
        claim: float = 1.0,
        answers: FloatArray | None = None,
        num_lines: int = NUM_LINES,
        middle: Callable[[FloatArray], FloatArray] = mean_of,
    ) -> FloatArray:
        """The answers that were given on the way, those between the first and the last cloud by the lines.

        Args:
            rng: Draws the lines.
            claim: Factor on the spread of the lines, for sigma.
            answers: (K, 5) as returned; None for those that `answered` has kept.
            num_lines: That are drawn.
            middle: Place (2,) for the places (M, 2) of lines at a time.

        Returns:
            (K, 5) t_s, x_m, y_m, level, sigma_m (NaN where not claimed) in the order of time.
        """
        made = (self.answers if answers is None else answers).copy()
        if not self._past:
            return made
        xy_m, level = self.lines(rng, num_lines)
        mean_m, sigma_m, own = np.empty((len(xy_m), 2)), np.empty(len(xy_m)), np.empty(len(xy_m), dtype=np.int64)
        for k, (places_m, levels) in enumerate(zip(xy_m, level, strict=True)):
            found, count = np.unique(levels, return_counts=True)
            own[k] = found[np.argmax(count)]
            here_m = places_m[levels == own[k]]
            mean_m[k] = middle(here_m)
            sigma_m[k] = np.sqrt(((here_m - mean_m[k]) ** 2).sum(axis=1).mean() / 2 + BETWEEN_M**2)
        ends_s = np.array([stored.cloud.t_s for stored in self._past])
        begins_s = np.maximum([stored.begin_s for stored in self._past], np.concatenate([ends_s[:1], ends_s[:-1]]))
        within = np.flatnonzero((made[:, 0] >= ends_s[0]) & (made[:, 0] <= ends_s[-1]))
        t_s = made[within, 0]
        before = np.searchsorted(ends_s, t_s, side="right") - 1
        after = np.minimum(before + 1, len(ends_s) - 1)
        lasts_s = np.maximum(ends_s[after] - begins_s[after], 1e-9)
        done = np.where(own[after] == own[before], np.clip((t_s - begins_s[after]) / lasts_s, 0.0, 1.0), 0.0)
        made[within, 1:3] = mean_m[before] + done[:, None] * (mean_m[after] - mean_m[before])
        made[within, 3] = own[before]
        made[within, 4] = claim * (sigma_m[before] + done * (sigma_m[after] - sigma_m[before]))
        return made

    def _append(self, stored: _Stored) -> None:
        self._past.append(stored)
        self._num_stored += len(stored.cloud.weight)


def _drawn(weight: FloatArray, draw: FloatArray) -> IntArray:
    """(M, n) columns of weights (M, N), one for each of `draw` (M, n), uniform in [0, 1)."""
    cumulative = np.cumsum(weight, axis=1)
    cumulative /= cumulative[:, -1:]
    rows = np.arange(len(weight))[:, None]
    flat = np.searchsorted((cumulative + rows).ravel(), (draw + rows).ravel(), side="right").reshape(draw.shape)
    chosen: IntArray = np.clip(flat - rows * weight.shape[1], 0, weight.shape[1] - 1)
    return chosen
