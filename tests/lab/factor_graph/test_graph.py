"""The solver against closed forms: least squares, the Kalman filter and smoother, finite differences."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.geometry import FloatArray
from pdrbench.radio import survey_of_readings
from pdrbench_baselines.fusion.radio import RadioEvidence
from pdrbench_baselines.gp_wifi.localizer import GpWifiParams
from pdrbench_lab.factor_graph.chain import STATE, ChainParams, motion, prior
from pdrbench_lab.factor_graph.graph import (
    Factor,
    Loss,
    Terms,
    geman_mcclure,
    huber,
    least_squares,
    solve,
    squared,
    without,
)
from pdrbench_lab.factor_graph.radio import ScanGrids, radio
from pdrbench_lab.factor_graph.walls import Distances, distances_of, walls

NUM_MOVES = 6
RING = np.array([(0.0, 0.0), (20.0, 0.0), (20.0, 8.0), (0.0, 8.0)])
HALL = Building("hall", (FloorPolygon("hall", RING, np.full(4, WALL), 0.0, 0),))


def walk_between(rng: np.random.Generator, num_parts: int = 1) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Displacements and covariances, mean and information of a start."""
    factor = 0.2 * np.tril(rng.standard_normal((NUM_MOVES, 2, 2))) + 0.3 * np.eye(2)
    information = np.tile(np.diag(ChainParams().state_sigma(0.5) ** -2), (num_parts, 1, 1))
    return (
        rng.standard_normal((NUM_MOVES, 2)),
        factor @ np.swapaxes(factor, 1, 2),
        np.zeros((num_parts, 4)),
        information,
    )


def linear_chain(rng: np.random.Generator, num_parts: int = 1) -> tuple[Factor, FloatArray, FloatArray]:
    """Scalars that wander, each measured: a factor with the matrix A and the right-hand side b of |A x - b|^2."""
    size = 5
    rows, right = [], []
    for number in range(size):
        rows.append(np.eye(size)[number] * 2.0)
        right.append(rng.standard_normal())
        if number:
            rows.append((np.eye(size)[number] - np.eye(size)[number - 1]) * 3.0)
            right.append(0.3 * rng.standard_normal())
    matrix, target = np.array(rows), np.array(right)
    columns = np.concatenate([size * part + np.tile(np.arange(size), (len(rows), 1)) for part in range(num_parts)])
    jacobian = np.tile(matrix[:, None, :], (num_parts, 1, 1))

    def factor(values: FloatArray) -> Terms:
        residual = (jacobian[:, 0] * values[columns]).sum(axis=1) - np.tile(target, num_parts)
        return least_squares(columns, residual[:, None], jacobian)

    return factor, matrix, target


def test_a_linear_graph_is_solved_as_batch_least_squares() -> None:
    factor, matrix, target = linear_chain(np.random.default_rng(1), num_parts=2)
    solution = solve([factor], np.zeros(10), num_parts=2)
    expected = np.linalg.lstsq(matrix, target, rcond=None)[0]
    covariance = np.linalg.inv(matrix.T @ matrix)
    assert solution.values == pytest.approx(np.tile(expected, 2), abs=1e-6)
    assert solution.last_covariance(5)[1] == pytest.approx(covariance)
    assert solution.log_determinant == pytest.approx(2 * [-np.linalg.slogdet(covariance)[1]])


def test_a_chain_without_turns_is_the_kalman_filter() -> None:
    """With bias and scale held to 0 a state is the sum of displacements, and covariances add up."""
    rng = np.random.default_rng(2)
    move_m, covariance_m2, mean, information = walk_between(rng)
    information[0, 2:, 2:] = 1e12 * np.eye(2)
    params = ChainParams(bias_walk_rad=1e-6, scale_walk=1e-6)
    factors = [prior(mean, information, NUM_MOVES + 1), motion(move_m, covariance_m2, params, 1)]
    solution = solve(factors, np.zeros(STATE * (NUM_MOVES + 1)))
    place_m = solution.values.reshape(-1, STATE)[:, :2]
    assert place_m[1:] == pytest.approx(np.cumsum(move_m, axis=0), abs=1e-4)
    filtered_m2 = 0.25 * np.eye(2) + np.cumsum(covariance_m2, axis=0)
    assert solution.covariances(STATE)[0, 1:, :2, :2] == pytest.approx(filtered_m2, abs=1e-4)


def test_marginal_covariances_are_blocks_of_the_inverse() -> None:
    rng = np.random.default_rng(3)
    move_m, covariance_m2, mean, information = walk_between(rng)
    factors = [prior(mean, information, NUM_MOVES + 1), motion(move_m, covariance_m2, ChainParams(), 1)]
    solution = solve(factors, 0.1 * rng.standard_normal(STATE * (NUM_MOVES + 1)))
    size = STATE * (NUM_MOVES + 1)
    dense = np.zeros((size, size))
    for factor in factors:
        terms = factor(solution.values)
        for columns, curvature in zip(terms.columns, terms.curvature, strict=True):
            dense[np.ix_(columns, columns)] += curvature
    inverse = np.linalg.inv(dense).reshape(NUM_MOVES + 1, STATE, NUM_MOVES + 1, STATE)
    expected = np.stack([inverse[k, :, k] for k in range(NUM_MOVES + 1)])
    assert solution.covariances(STATE)[0] == pytest.approx(expected, rel=1e-6, abs=1e-9)
    assert solution.last_covariance(STATE)[0] == pytest.approx(expected[-1], rel=1e-6, abs=1e-9)


def test_what_is_marginalised_leaves_the_answer_and_the_evidence_as_they_were() -> None:
    """A linear chain without its first variable has the same minimum, covariance and evidence."""
    factor, matrix, target = linear_chain(np.random.default_rng(4))
    gone = without([factor(np.zeros(5))], np.array([False, True, True, True, True]), np.zeros(5), 1)
    expected = np.linalg.lstsq(matrix, target, rcond=None)[0]
    assert gone.mean[0] == pytest.approx(expected[1:])
    assert np.linalg.inv(gone.information[0]) == pytest.approx(np.linalg.inv(matrix.T @ matrix)[1:, 1:])
    cost = 0.5 * float(np.square(matrix @ expected - target).sum())
    whole = -cost - 0.5 * np.linalg.slogdet(matrix.T @ matrix)[1]
    assert gone.log_evidence[0] - 0.5 * np.linalg.slogdet(gone.information[0])[1] == pytest.approx(whole)


@pytest.mark.parametrize("loss", [squared, huber(1.0), geman_mcclure(2.0)])
def test_the_weight_of_a_loss_is_its_slope(loss: Loss) -> None:
    square = np.array([0.1, 0.6, 2.0, 9.0])
    slope = (loss(square + 1e-6)[0] - loss(square - 1e-6)[0]) / 2e-6
    assert loss(square)[1] == pytest.approx(2.0 * slope, rel=1e-5)


def valley() -> Distances:
    """Distances that are quadratic in places but for interpolation."""
    x, y = np.meshgrid(np.arange(40), np.arange(40), indexing="ij")
    return Distances(np.array([-5.0, -5.0]), 0.25, 0.02 * (x - 20.0) ** 2 * 0.1 + 0.03 * y - 0.6)


@pytest.fixture(scope="module")
def grids() -> tuple[ScanGrids, FloatArray]:
    """A survey of a hall with one access point, and log-likelihoods of some scan on its lattice."""
    xy_m = np.array([[x, y] for y in (2.0, 6.0) for x in np.arange(1.0, 20.0, 2.0)])
    rows = np.column_stack([np.ones(len(xy_m)), -40.0 - 2.0 * xy_m[:, 0], np.zeros(len(xy_m))])
    level = np.zeros(len(xy_m), dtype=np.int64)
    survey = survey_of_readings(xy_m, level, level, [1] * len(xy_m), rows, surveyed=True)
    evidence = RadioEvidence(survey, HALL, GpWifiParams(), 2.0)
    away_m2 = np.square(evidence.xy_m - [6.0, 3.0]).sum(axis=1)
    return ScanGrids(evidence), np.tile(-away_m2[:, None] / 8.0, (1, len(evidence.prior)))


def make_factors(grids: tuple[ScanGrids, FloatArray]) -> dict[str, Factor]:
    move_m, covariance_m2, mean, information = walk_between(np.random.default_rng(5), 2)
    level = np.zeros((2, NUM_MOVES + 1), dtype=np.int64)
    loss = geman_mcclure(6.0)
    scan = grids[0].scan(grids[1])
    return {
        "prior": prior(mean, information, NUM_MOVES + 1),
        "motion": motion(move_m, covariance_m2, ChainParams(), 2),
        "robust motion": motion(move_m, covariance_m2, ChainParams(), 2, huber(1.5)),
        "walls": walls({0: valley()}, {}, level, margin_m=0.8, sigma_m=0.4, loss=loss),
        "radio": radio(grids[0], [(0, scan), (3, scan)], level),
    }


@pytest.mark.parametrize("name", ["prior", "motion", "robust motion", "walls", "radio"])
def test_gradients_are_those_of_finite_differences(name: str, grids: tuple[ScanGrids, FloatArray]) -> None:
    factor = make_factors(grids)[name]
    values = 0.4 * np.random.default_rng(6).standard_normal((2, NUM_MOVES + 1, STATE))
    values[:, :, :2] += 2.5 if name == "radio" else 0.0
    values = values.ravel()
    terms = factor(values)
    gradient = np.bincount(terms.columns.ravel(), terms.gradient.ravel(), minlength=len(values))
    total: Callable[[FloatArray], float] = lambda at: float(factor(at).cost.sum())  # noqa: E731
    small = 1e-6
    differences = [(total(values + small * e) - total(values - small * e)) / (2 * small) for e in np.eye(len(values))]
    # the kernel of a scan ends at three standard deviations, where it is 1 % of its middle
    tolerance = 0.02 if name == "radio" else 1e-4
    assert gradient == pytest.approx(np.array(differences), rel=1e-3, abs=tolerance)
    assert np.abs(gradient).max() > 10 * tolerance
    assert (np.linalg.eigvalsh(terms.curvature) >= -1e-9 * np.abs(terms.curvature).max()).all()


def test_distances_are_those_to_the_walls() -> None:
    distances = distances_of(HALL, 0, 0.25)
    inside_m, slope = distances.at(np.array([[10.0, 1.0], [3.0, 6.0], [10.0, -2.0]]))
    assert inside_m == pytest.approx([1.0, 2.0, -2.0], abs=0.25)
    assert slope[0] == pytest.approx([0.0, 1.0], abs=1e-6)
    assert slope[2] == pytest.approx([0.0, 1.0], abs=1e-6)
    assert math.isfinite(float(distances.at(np.array([[1e4, -1e4]]))[0][0]))
