"""Compiled smoother of the foot-mounted inertial filter, backwards over what `foot_kernels.advance` recorded."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

from pdrbench.inertial.foot_kernels import NUM_UPDATES, ROW, correct, helper


@helper
def _transpose_step(v: Any, r: int, dt: float, f: Any, c: Any, size: Any) -> None:
    """v <- F^T v for the 16 numbers of `v` from `r` on, of which those of the position are zero."""
    a0, a1, a2, b0, b1, b2 = v[r + 3], v[r + 4], v[r + 5], v[r + 6], v[r + 7], v[r + 8]
    for i in range(3 if size == 15 else 0):
        c0, c1, c2 = dt * c[0, i], dt * c[1, i], dt * c[2, i]
        v[r + 9 + i] -= c0 * a0 + c1 * a1 + c2 * a2
        v[r + 12 + i] -= c0 * b0 + c1 * b1 + c2 * b2
    v[r + 6] += dt * (f[1] * a2 - f[2] * a1)
    v[r + 7] += dt * (f[2] * a0 - f[0] * a2)
    v[r + 8] += dt * (f[0] * a1 - f[1] * a0)


@helper
def _transpose_rows(v: Any, dt: float, f: Any, c: Any, size: Any) -> None:
    """V <- F^T V of 16 rows of 16."""
    for i in range(3 if size == 15 else 0):
        c0, c1, c2 = dt * c[0, i], dt * c[1, i], dt * c[2, i]
        for j in range(ROW):
            v[(9 + i) * ROW + j] -= c0 * v[3 * ROW + j] + c1 * v[4 * ROW + j] + c2 * v[5 * ROW + j]
            v[(12 + i) * ROW + j] -= c0 * v[6 * ROW + j] + c1 * v[7 * ROW + j] + c2 * v[8 * ROW + j]
    f0, f1, f2 = dt * f[0], dt * f[1], dt * f[2]
    for j in range(ROW):
        a0, a1, a2 = v[3 * ROW + j], v[4 * ROW + j], v[5 * ROW + j]
        v[6 * ROW + j] += f1 * a2 - f2 * a1
        v[7 * ROW + j] += f2 * a0 - f0 * a2
        v[8 * ROW + j] += f0 * a1 - f1 * a0


@helper
def _product(out: Any, w: Any, rows: Any) -> None:
    """out (16,) <- w^T rows, with `rows` one after the other, over all errors but those of the position."""
    for j in range(ROW):  # in this order, and of a constant length, the compiler makes vectors of it
        total = 0.0
        for i in range(3, 15):
            total += w[i] * rows[i * ROW + j]
        out[j] = total


@helper
def _smooth(record: Any, adjoint: Any, information: Any, size: Any, out_x: Any, out_cov: Any, scratch: Any) -> None:
    """See `smooth`, which gives it arrays to work in."""
    vector, square, error, spread, shown, half, x, f, c = scratch
    for i in range(size):
        vector[i] = adjoint[i]
        for j in range(size):
            square[i * ROW + j] = information[i, j]
    for k in range(len(out_x) - 1, -1, -1):
        cov = record.cov[k]
        for i in range(16):
            x[i] = out_x[k, i]
        _product(error, vector, cov)
        for i in range(16):
            error[i] = -error[i]
        correct(x, error, size)
        for i in range(16):  # an assignment of arrays takes Numba seconds to compile
            out_x[k, i] = x[i]
        for b in range(4):
            for i in range(3, 15):
                shown[b, i] = cov[i * ROW + (b if b < 3 else 8)]
            _product(half[b], shown[b], square)
            for a in range(b + 1):
                less = 0.0
                for i in range(3, 15):
                    less += shown[a, i] * half[b, i]
                out_cov[k, a, b] -= less
                if a != b:
                    out_cov[k, b, a] -= less
        for which in range(NUM_UPDATES - 1, -1, -1):
            first = 3 if which == 0 else 12 if which == 1 else 8
            updates = record.updates[k, which]
            for u in range(2, -1, -1):
                h, scale, along, weight, gain = first + u, updates[51 + u], 0.0, 0.0, updates[u * ROW : u * ROW + ROW]
                if scale == 0.0:
                    continue
                _product(spread, gain, square)
                for i in range(3, 15):
                    along += gain[i] * vector[i]
                    weight += gain[i] * spread[i]
                row = square[h * ROW : h * ROW + ROW]
                vector[h] -= scale * (along + updates[48 + u])
                for i in range(3, 15):
                    row[i] -= scale * spread[i]
                    square[i * ROW + h] -= scale * spread[i]
                square[h * 17] += scale * scale * (weight + 1.0)
        dt = record.step[k, 0]
        if dt > 0.0:
            for i in range(3):
                f[i] = record.step[k, 1 + i]
                for j in range(3):
                    c[i, j] = record.step[k, 4 + 3 * i + j]
            _transpose_step(vector, 0, dt, f, c, size)
            _transpose_rows(square, dt, f, c, size)
            for r in range(6 * ROW, size * ROW, ROW):
                _transpose_step(square, r, dt, f, c, size)
            for i in range(6, size):
                for j in range(3, i):
                    if j < 6:
                        square[j * ROW + i] = square[i * ROW + j]
                    else:
                        square[i * ROW + j] = square[j * ROW + i]
    for i in range(size):
        adjoint[i] = vector[i]
        for j in range(size):
            information[i, j] = square[i * ROW + j]


@njit(cache=True, error_model="numpy", nogil=True)
def smooth(record: Any, adjoint: Any, information: Any, size: Any, out_x: Any, out_cov: Any) -> None:
    """Modified Bryson-Frazier smoother, backwards over n recorded samples.

    Equal to the Rauch-Tung-Striebel smoother of the error state, and needs no inverse of a covariance, which is next to
    singular here. Errors that the closed loop already took out of the nominal state are in the innovations. Positions
    are never measured, so that their adjoint and information are zero.

    Args:
        record: `Record` of the forward pass.
        adjoint: (N,) carried from the samples after these, zero at the end of the walk; updated.
        information: (N, N) likewise.
        size: `NINE` or `FIFTEEN`.
        out_x: (n, 16) states of the forward pass; smoothed afterwards.
        out_cov: (n, 4, 4) their covariance of position and heading.
    """
    vector, square, error, spread = np.zeros(16), np.zeros(256), np.zeros(16), np.zeros(16)
    shown, half, x, f, c = np.zeros((4, 16)), np.zeros((4, 16)), np.zeros(16), np.zeros(3), np.zeros((3, 3))
    scratch = vector, square, error, spread, shown, half, x, f, c
    _smooth(record, adjoint, information, size, out_x, out_cov, scratch)
