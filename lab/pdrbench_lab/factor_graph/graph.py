"""Nonlinear least squares on a sparse graph whose variables are in order of time.

A factor is a term of the cost on a few variables. Each gives its cost, gradient and curvature (Gauss-Newton: J^T J of
its residual), and the normal equations are their sum. Variables that are in order of time and factors that join
neighbours make that matrix a band, and so is its Cholesky factor: solving, marginal covariances and marginalisation
take time in proportion to the length of the walk (Dellaert & Kaess 2017, "Factor graphs for robot perception",
sections 2 and 3). Several graphs of one shape are solved at once as the diagonal blocks of one.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg import cho_solve_banded, cholesky_banded

from pdrbench.geometry import BoolArray, FloatArray, IntArray

MIN_DAMPING: Final = 1e-9
MAX_DAMPING: Final = 1e6
FIRST_DAMPING: Final = 1e-4


class Terms(NamedTuple):
    """M factors at some values.

    Attributes:
        columns: (M, C) int, the variables of each.
        cost: (M,) negative log-density, up to a constant.
        gradient: (M, C) of the cost.
        curvature: (M, C, C) positive semidefinite.
    """

    columns: IntArray
    cost: FloatArray
    gradient: FloatArray
    curvature: FloatArray


# What factors say at values (n,).
Factor = Callable[[FloatArray], Terms]
# Cost and weight of squared residuals (M,).
Loss = Callable[[FloatArray], tuple[FloatArray, FloatArray]]


def squared(square: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Of a normal error: r^2 / 2."""
    return 0.5 * square, np.ones_like(square)


def huber(width: float) -> Loss:
    """Quadratic up to `width`, linear beyond (Huber 1964)."""

    def loss(square: FloatArray) -> tuple[FloatArray, FloatArray]:
        size = np.sqrt(square)
        is_near = size <= width
        cost = np.where(is_near, 0.5 * square, width * (size - 0.5 * width))
        return cost, np.where(is_near, 1.0, width / np.maximum(size, width))

    return loss


def geman_mcclure(most: float) -> Loss:
    """r^2 / 2 at first, `most` at last: m q / (m + q) of q = r^2 / 2; a switch with a price gives the same.

    Agarwal et al. 2013, "Robust map optimization using dynamic covariance scaling", section III.
    """

    def loss(square: FloatArray) -> tuple[FloatArray, FloatArray]:
        half = 0.5 * square
        return most * half / (most + half), (most / (most + half)) ** 2

    return loss


def least_squares(columns: IntArray, residual: FloatArray, jacobian: FloatArray, loss: Loss = squared) -> Terms:
    """Factors of whitened residuals (M, R) with Jacobians (M, R, C), reweighted by their loss."""
    cost, weight = loss(np.einsum("mr,mr->m", residual, residual))
    weighed = weight[:, None, None] * jacobian
    gradient = np.einsum("mrc,mr->mc", weighed, residual)
    return Terms(columns, cost, gradient, np.swapaxes(weighed, 1, 2) @ jacobian)


@dataclass(frozen=True, slots=True)
class Solution:
    """Of P graphs, each with n / P variables that follow one another.

    Attributes:
        values: (n,).
        cost: (P,).
        factor: (B, n) lower band of the Cholesky factor of the normal equations there.
        num_iterations: Linear systems that were solved.
    """

    values: FloatArray
    cost: FloatArray
    factor: FloatArray
    num_iterations: int

    def take(self, parts: IntArray) -> Solution:
        """Of some of the graphs, in this order."""
        shape = len(self.cost), -1
        factor = self.factor.reshape(len(self.factor), *shape)[:, parts].reshape(len(self.factor), -1)
        return replace(self, values=self.values.reshape(shape)[parts].ravel(), cost=self.cost[parts], factor=factor)

    @property
    def log_determinant(self) -> FloatArray:
        """(P,) of the normal equations of each graph."""
        found: FloatArray = 2.0 * np.log(self.factor[0]).reshape(len(self.cost), -1).sum(axis=1)
        return found

    def last_covariance(self, count: int) -> FloatArray:
        """(P, count, count) marginal covariance of the last variables of each graph."""
        size = len(self.values) // len(self.cost)
        corner = np.zeros((len(self.cost), count, count))
        for row, column in zip(*_lower(count), strict=True):
            corner[:, row, column] = self.factor[row - column, size - count + column :: size]
        inverse = np.linalg.inv(corner)
        covariance: FloatArray = np.swapaxes(inverse, 1, 2) @ inverse
        return covariance

    def covariances(self, count: int) -> FloatArray:
        """(P, T, count, count) marginal covariance of all blocks of `count` variables, each joined to the next only.

        From the last block back (Takahashi, Fagan & Chin 1973): with blocks L of the Cholesky factor,
        S_t = L_tt^-T (I + L_t+1,t^T S_t+1 L_t+1,t) L_tt^-1.
        """
        own, below = self._blocks(count)
        inverse = np.linalg.inv(own)
        found: FloatArray = np.swapaxes(inverse, 2, 3) @ inverse
        through = below @ inverse[:, :-1]
        for block in range(found.shape[1] - 2, -1, -1):
            step = through[:, block]
            found[:, block] += np.swapaxes(step, 1, 2) @ found[:, block + 1] @ step
        return found

    def _blocks(self, count: int) -> tuple[FloatArray, FloatArray]:
        """(P, T, count, count) of the Cholesky factor on its diagonal, and (P, T - 1, count, count) below."""
        width, size = self.factor.shape
        if width > 2 * count or size % (count * len(self.cost)):
            raise ValueError(
                f"a band of {width} over {size} variables has no blocks of {count} joined to the next only"
            )
        row, column = np.indices((2 * count, count))
        at = column + count * np.arange(size // count)[:, None, None]
        offset = np.broadcast_to(row - column, at.shape)
        is_stored = (offset >= 0) & (offset < width)
        band = np.where(is_stored, self.factor[np.clip(offset, 0, width - 1), at], 0.0)
        band = band.reshape(len(self.cost), -1, 2 * count, count)
        return band[:, :, :count], band[:, :-1, count:]


class _System(NamedTuple):
    """Normal equations: lower band (B, n), right-hand side (n,), and the cost of every graph (P,)."""

    band: FloatArray
    gradient: FloatArray
    cost: FloatArray


def solve(
    factors: Sequence[Factor],
    values: FloatArray,
    *,
    num_parts: int = 1,
    num_iterations: int = 20,
    tolerance: float = 1e-4,
) -> Solution:
    """Minimises the sum of the costs by Levenberg-Marquardt; each graph has a damping of its own.

    Args:
        factors: On all variables.
        values: (n,) to begin with.
        num_parts: Graphs, of n / P variables each, that no factor joins.
        num_iterations: At most.
        tolerance: A graph is solved once its cost falls by less.
    """
    size = len(values) // num_parts
    damping = np.full(num_parts, FIRST_DAMPING)
    is_done = np.zeros(num_parts, dtype=np.bool_)
    system = _assembled(factors, values, num_parts)
    count = 0
    while count < num_iterations and not is_done.all():
        count += 1
        band = system.band.copy()
        band[0] *= 1.0 + np.repeat(damping, size)
        factor = cholesky_banded(band, lower=True, overwrite_ab=True, check_finite=False)
        step = cho_solve_banded((factor, True), -system.gradient, check_finite=False)
        tried = values + np.where(np.repeat(is_done, size), 0.0, step)
        after = _assembled(factors, tried, num_parts)
        is_better = after.cost <= system.cost
        fell = system.cost - after.cost
        is_done |= (is_better & (fell < tolerance)) | (~is_better & (damping >= MAX_DAMPING))
        damping = np.clip(np.where(is_better, damping / 10.0, damping * 10.0), MIN_DAMPING, MAX_DAMPING)
        if is_better.all():
            values, system = tried, after
        elif is_better.any():
            values = np.where(np.repeat(is_better, size), tried, values)
            system = _assembled(factors, values, num_parts)
    factor = cholesky_banded(system.band, lower=True, check_finite=False)
    return Solution(values, system.cost, factor, count)


def _assembled(factors: Sequence[Factor], values: FloatArray, num_parts: int) -> _System:
    """The sum of all factors at some values."""
    terms = [factor(values) for factor in factors]
    count, size = len(values), len(values) // num_parts
    width = max(int(np.ptp(each.columns, axis=1).max(initial=0)) for each in terms) + 1
    band, gradient, cost = np.zeros(width * count), np.zeros(count), np.zeros(num_parts)
    for columns, each_cost, each_gradient, curvature in terms:
        gradient += np.bincount(columns.ravel(), each_gradient.ravel(), minlength=count)
        cost += np.bincount(columns[:, 0] // size, each_cost, minlength=num_parts)
        row, column = _lower(columns.shape[1])
        low = np.minimum(columns[:, row], columns[:, column])
        below = np.abs(columns[:, row] - columns[:, column])
        band += np.bincount((below * count + low).ravel(), curvature[:, row, column].ravel(), minlength=len(band))
    return _System(band.reshape(width, count), gradient, cost)


def _lower(count: int) -> tuple[IntArray, IntArray]:
    """Rows and columns of the lower triangle."""
    row, column = np.tril_indices(count)
    return row, column


@dataclass(frozen=True, slots=True)
class Marginal:
    """What factors say of the variables that stay once others are gone.

    Attributes:
        information: (P, K, K) of those that stay.
        mean: (P, K).
        log_evidence: (P,) logarithm of the integral over those that are gone, beyond that of a prior with this
            information and mean, by Laplace's approximation and up to a constant.
    """

    information: FloatArray
    mean: FloatArray
    log_evidence: FloatArray


def without(terms: Sequence[Terms], keeps: BoolArray, values: FloatArray, num_parts: int) -> Marginal:
    """Marginalises variables of small dense graphs by the Schur complement.

    Args:
        terms: Factors at `values`.
        keeps: (n / P,) which variables of each graph stay.
        values: (n,) where factors were linearised.
        num_parts: Graphs.
    """
    size = len(keeps)
    matrix, gradient, cost = np.zeros((num_parts, size, size)), np.zeros((num_parts, size)), np.zeros(num_parts)
    for columns, each_cost, each_gradient, curvature in terms:
        part, at = columns[:, 0] // size, columns % size
        np.add.at(cost, part, each_cost)
        np.add.at(gradient, (part[:, None], at), each_gradient)
        np.add.at(matrix, (part[:, None, None], at[:, :, None], at[:, None, :]), curvature)
    kept, gone = np.flatnonzero(keeps), np.flatnonzero(~keeps)
    inner, cross = matrix[:, gone[:, None], gone], matrix[:, kept[:, None], gone]
    through = np.linalg.solve(inner, np.concatenate([np.swapaxes(cross, 1, 2), gradient[:, gone, None]], axis=2))
    information = matrix[:, kept[:, None], kept] - cross @ through[:, :, :-1]
    information = 0.5 * (information + np.swapaxes(information, 1, 2))
    slope = gradient[:, kept] - (cross @ through[:, :, -1:])[:, :, 0]
    away = np.linalg.solve(information, slope[:, :, None])[:, :, 0]
    least = cost - 0.5 * (gradient[:, gone] * through[:, :, -1]).sum(axis=1) - 0.5 * (slope * away).sum(axis=1)
    mean = values.reshape(num_parts, size)[:, kept] - away
    return Marginal(information, mean, -least - 0.5 * np.linalg.slogdet(inner)[1])
