"""Compiled smoother of the foot-mounted inertial filter, backwards over what `foot_kernels.advance` recorded."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from pdrbench.inertial.foot_kernels import NUM_UPDATES, correct


@njit(cache=True, error_model="numpy")
def _transpose_step(v: Any, dt: float, f: Any, c: Any) -> None:
    """v <- F^T v."""
    for i in range(3):
        v3, v6 = v[3 + i], v[6 + i]
        if len(v) == 15:
            for j in range(3):
                v[9 + j] -= dt * c[i, j] * v3
                v[12 + j] -= dt * c[i, j] * v6
    a0, a1, a2 = v[3], v[4], v[5]
    v[6] += dt * (f[1] * a2 - f[2] * a1)
    v[7] += dt * (f[2] * a0 - f[0] * a2)
    v[8] += dt * (f[0] * a1 - f[1] * a0)
    for i in range(3):
        v[3 + i] += dt * v[i]


@njit(cache=True, error_model="numpy", nogil=True)
def smooth(record: Any, adjoint: Any, information: Any, size: Any, out_x: Any, out_cov: Any) -> None:
    """Modified Bryson-Frazier smoother, backwards over n recorded samples.

    Equal to the Rauch-Tung-Striebel smoother of the error state, and needs no inverse of a covariance, which is next to
    singular here. Errors that the closed loop already took out of the nominal state are in the innovations.

    Args:
        record: `Record` of the forward pass.
        adjoint: (N,) carried from the samples after these, zero at the end of the walk; updated.
        information: (N, N) likewise.
        size: `NINE` or `FIFTEEN`.
        out_x: (n, 16) states of the forward pass; smoothed afterwards.
        out_cov: (n, 4, 4) their covariance of position and heading.
    """
    n_states = size
    error, spread, half, f = np.zeros(n_states), np.zeros(n_states), np.zeros((n_states, 4)), np.zeros(3)
    c, x = np.zeros((3, 3)), np.zeros(16)
    for k in range(len(out_x) - 1, -1, -1):
        cov = record.cov[k]
        for i in range(n_states):
            error[i] = 0.0
            for j in range(n_states):
                error[i] -= cov[i, j] * adjoint[j]
        for i in range(16):  # an assignment of arrays takes Numba seconds to compile
            x[i] = out_x[k, i]
        correct(x, error, size)
        for i in range(16):
            out_x[k, i] = x[i]
        for i in range(n_states):
            for b in range(4):
                half[i, b] = 0.0
                for j in range(n_states):
                    half[i, b] += information[i, j] * cov[j, b if b < 3 else 8]
        for a in range(4):
            row = a if a < 3 else 8
            for b in range(4):
                out_cov[k, a, b] = cov[row, b if b < 3 else 8]
                for i in range(n_states):
                    out_cov[k, a, b] -= cov[row, i] * half[i, b]
        for u in range(NUM_UPDATES - 1, -1, -1):
            h = record.which[k, u]
            if h < 0:
                continue
            gain, variance = record.gain[k, u], record.variance[k, u]
            along, weight = 0.0, 0.0
            for i in range(n_states):
                along += gain[i] * adjoint[i]
                spread[i] = 0.0
                for j in range(n_states):
                    spread[i] += information[i, j] * gain[j]
            for i in range(n_states):
                weight += gain[i] * spread[i]
            adjoint[h] -= along + record.innovation[k, u] / variance
            for i in range(n_states):
                information[h, i] -= spread[i]
            for i in range(n_states):
                information[i, h] -= spread[i]
            information[h, h] += weight + 1.0 / variance
        dt = record.step[k, 0]
        if dt > 0.0:
            for i in range(3):
                f[i] = record.step[k, 1 + i]
                for j in range(3):
                    c[i, j] = record.step[k, 4 + 3 * i + j]
            _transpose_step(adjoint, dt, f, c)
            for i in range(n_states):  # a column is copied, so that the step is compiled for one layout
                for j in range(n_states):
                    spread[j] = information[j, i]
                _transpose_step(spread, dt, f, c)
                for j in range(n_states):
                    information[j, i] = spread[j]
            for i in range(n_states):
                _transpose_step(information[i], dt, f, c)
            for i in range(n_states):
                for j in range(i):
                    information[i, j] = information[j, i]
