"""A walk as a chain of states x, y, heading bias, log length scale, one after every second of walking."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pdrbench.geometry import FloatArray, IntArray
from pdrbench_lab.factor_graph.graph import Factor, Loss, Terms, least_squares, squared

STATE = 4  # x_m, y_m, bias_rad, log of the scale


@dataclass(frozen=True, slots=True)
class ChainParams:
    """Defaults as `LearnedMapFilterParams` unless a line says otherwise.

    Attributes:
        start_sigma_m: Around a start, per axis.
        bias_sigma_rad: Of the error of headings at first.
        bias_walk_rad: By which it wanders in a second.
        scale_sigma: Of the logarithm of the factor on lengths at first.
        scale_walk: By which that wanders in a second.
    """

    start_sigma_m: float = 0.5
    bias_sigma_rad: float = math.radians(9.0)
    bias_walk_rad: float = math.radians(2.0)
    scale_sigma: float = 0.1
    scale_walk: float = 0.02  # ours: steps on stairs are shorter

    def state_sigma(self, place_sigma_m: float) -> FloatArray:
        """(4,) of a state at a start that is known to so much per axis."""
        return np.array([place_sigma_m, place_sigma_m, self.bias_sigma_rad, self.scale_sigma])


def motion(
    move_m: FloatArray, covariance_m2: FloatArray, params: ChainParams, num_parts: int, loss: Loss = squared
) -> Factor:
    """Joins states: a displacement is the network's, turned by the bias and scaled; bias and scale wander.

    The residual is W (R(-b) (x' - x) - exp(s) m) of a displacement m with the covariance (W^T W)^-1, both in the frame
    of the device, so that the covariance turns with the bias; b and s are those after the second.

    Args:
        move_m: (T, 2).
        covariance_m2: (T, 2, 2).
        params: How bias and scale wander.
        num_parts: Chains of T + 1 states that walk the same displacements.
        loss: Of each second.
    """
    whiten = np.linalg.inv(np.linalg.cholesky(covariance_m2))
    num_moves = len(move_m)
    columns = neighbours(num_parts, num_moves + 1, np.arange(STATE))
    wander = np.array([1.0 / params.bias_walk_rad, 1.0 / params.scale_walk])
    fixed = np.zeros((num_parts, num_moves, STATE, 2 * STATE))
    fixed[:, :, [2, 3], [6, 7]], fixed[:, :, [2, 3], [2, 3]] = wander, -wander

    def factor(values: FloatArray) -> Terms:
        state = values.reshape(num_parts, num_moves + 1, STATE)
        step_m, bias, scale = np.diff(state[:, :, :2], axis=1), state[:, 1:, 2], np.exp(state[:, 1:, 3])
        cosine, sine = np.cos(bias), np.sin(bias)
        back = np.stack([np.stack([cosine, sine], axis=-1), np.stack([-sine, cosine], axis=-1)], axis=-2)
        turned_m = (back @ step_m[..., None])[..., 0]
        scaled_m = scale[..., None] * move_m
        slope = whiten @ back
        jacobian = fixed.copy()
        jacobian[:, :, :2, 4:6], jacobian[:, :, :2, :2] = slope, -slope
        aside_m = np.stack([turned_m[..., 1], -turned_m[..., 0]], axis=-1)
        jacobian[:, :, :2, 6] = (whiten @ aside_m[..., None])[..., 0]
        jacobian[:, :, :2, 7] = -(whiten @ scaled_m[..., None])[..., 0]
        residual = np.concatenate(
            [(whiten @ (turned_m - scaled_m)[..., None])[..., 0], wander * np.diff(state[:, :, 2:], axis=1)], axis=-1
        )
        return least_squares(columns, residual.reshape(-1, STATE), jacobian.reshape(-1, STATE, 2 * STATE), loss=loss)

    return factor


def prior(mean: FloatArray, information: FloatArray, num_states: int) -> Factor:
    """Holds the first state of each chain to a mean (P, 4) with an information matrix (P, 4, 4)."""
    columns = STATE * num_states * np.arange(len(mean))[:, None] + np.arange(STATE)

    def factor(values: FloatArray) -> Terms:
        away = values[columns] - mean
        gradient = (information @ away[..., None])[..., 0]
        return Terms(columns, 0.5 * np.einsum("pk,pk->p", away, gradient), gradient, information)

    return factor


def neighbours(num_parts: int, num_states: int, kept: IntArray) -> IntArray:
    """(P * (T - 1), 2 K) columns of K components of every state and of the next."""
    state = np.arange(num_parts * num_states).reshape(num_parts, num_states)
    first = (STATE * state[:, :-1].reshape(-1, 1) + kept).astype(np.int64)
    found: IntArray = np.concatenate([first, first + STATE], axis=1)
    return found


def rolled_out(state: FloatArray, move_m: FloatArray) -> FloatArray:
    """(P, T + 1, 4) where displacements (T, 2) lead from states (P, 4) whose bias and scale do not change."""
    cosine, sine, scale = np.cos(state[:, 2]), np.sin(state[:, 2]), np.exp(state[:, 3])
    turn = scale[:, None, None] * np.stack(
        [np.stack([cosine, -sine], axis=-1), np.stack([sine, cosine], axis=-1)], axis=-2
    )
    path = np.repeat(state[:, None, :], len(move_m) + 1, axis=1)
    path[:, 1:, :2] += np.cumsum(np.einsum("pij,tj->pti", turn, move_m), axis=1)
    return path
