"""Compiled: what readings say of the places of their fields, densities of scans, how long scans of a survey lasted."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from pdrbench.compiled import compiled
from pdrbench.geometry import FloatArray

TABLE_LOW, TABLE_HIGH, PER_ONE = -30.0, 20.0, 256.0  # of log(1 + exp(a)), which lines between give to 5e-7
FAR = 36.0  # half a squared deviation: 2e-16 of what is near
MAX_SQUARE = 25.0  # half of a squared deviation; rarer readings are as good as unexpected: e^-25 of 5e4 times as likely


def warm_up() -> None:
    """Compiles it, or loads it from the cache."""
    one = np.ones(1, dtype=np.float32)
    at = np.zeros(1, dtype=np.int32), np.array([0, 1])
    add_readings(np.zeros((1, 1)), *at, one, one, np.ones((1, 3)), np.zeros(1), 25.0, log1p_exp_table())
    zero, two = np.zeros(1, dtype=np.int64), np.ones((1, 1), dtype=np.float32)
    equations(one > 0, one, one, zero, two, two)
    times_between(at[1], zero, np.ones(1), np.ones(1), np.zeros(1, dtype=np.bool_), 1)
    place = np.zeros((1, 2))
    squares_at(place, zero, zero, np.zeros((1, 1, 1), dtype=np.int64), np.ones((1, 1, 1), np.bool_), place, 1.0, True)
    mixture(place, zero, place, zero, np.ones(1), 1.0, 1.0)
    mixtures(np.zeros((1, 1)), zero, place, zero, np.ones(1), np.ones(1))


@compiled
def add_readings(
    found: Any, at: Any, first: Any, mean_dbm: Any, variance_db2: Any, readings: Any, offset_db: Any, noise_db2: float,
    table: Any,
) -> None:  # fmt: skip
    """Adds trust * log(1 + odds * density of a reading) to `found` (N, K), as `GpWifiParams` does.

    Args:
        found: (N, K).
        at: (E,) places of the fields of R readings, one field after the other.
        first: (R + 1,) where each field begins.
        mean_dbm: (E,).
        variance_db2: (E,).
        readings: (R, 3) dBm, odds and trust.
        offset_db: (K,).
        noise_db2: Of a reading.
        table: `log1p_exp_table`.
    """
    for r in range(len(readings)):
        dbm, odds, trust = readings[r]
        log_odds = math.log(odds) - 0.5 * math.log(math.pi) if odds > 0.0 else -np.inf
        for e in range(first[r], first[r + 1]):
            half = 0.5 / (variance_db2[e] + noise_db2)
            peak, row, off_db = log_odds + 0.5 * math.log(half), found[at[e]], dbm - mean_dbm[e]
            max_square = min(MAX_SQUARE, peak - TABLE_LOW)
            for k in range(len(offset_db)):
                square = (off_db - offset_db[k]) ** 2 * half
                if square < max_square:
                    row[k] += trust * _log1p_exp(table, peak - square)


@compiled
def equations(is_seen: Any, left_db: Any, noise_db2: Any, near: Any, prior: Any, cross: Any) -> Any:
    """What the field of an access point solves in the c of C cells that say something of it, at K of N places.

    Takes them (C,) of the cells, numbers (K,) of the places, and covariances (C, C) and (C, N). Returns the covariance
    (c, c), a triangle of it, and (c, 1 + K): what is left in the cells, and their covariances with the places.
    """
    cells = np.flatnonzero(is_seen)
    covariance, right = (
        np.empty((len(cells), len(cells)), np.float32),
        np.empty((len(cells), 1 + len(near)), np.float32),
    )
    for i in range(len(cells)):
        cell, own_row, right_row = cells[i], covariance[i], right[i]
        prior_row, cross_row = prior[cell], cross[cell]
        for j in range(i + 1):
            own_row[j] = prior_row[cells[j]]
        own_row[i] += noise_db2[cell]
        right_row[0] = left_db[cell]
        for n in range(len(near)):
            right_row[1 + n] = cross_row[near[n]]
    return covariance, right


def log1p_exp_table() -> FloatArray:
    """(T,) log(1 + exp(a)) between `TABLE_LOW` and `TABLE_HIGH`."""
    a = TABLE_LOW + np.arange(int((TABLE_HIGH - TABLE_LOW) * PER_ONE) + 2) / PER_ONE
    return np.asarray(np.log1p(np.exp(a)))


@compiled
def _log1p_exp(table: Any, a: Any) -> Any:
    if a >= TABLE_HIGH:
        return a
    at = (a - TABLE_LOW) * PER_ONE
    low = int(at)
    return table[low] + (at - low) * (table[low + 1] - table[low])


@compiled
def squares_at(
    xy_m: Any, level: Any, levels: Any, nearest: Any, is_beside: Any, corner_m: Any, side_m: float, is_any: bool
) -> Any:
    """(M,) what squares (L, X, Y) of levels (L,) with corners (L, 2) say at places (M, 2) on levels (M,); -1 of another
    level, and, unless any place will do, of one that no square is beside."""
    found = np.empty(len(xy_m), np.int64)
    _, rows, columns = nearest.shape
    for n in range(len(xy_m)):
        found[n] = -1
        for k in range(len(levels)):
            if levels[k] == level[n]:
                x = math.floor((xy_m[n, 0] - corner_m[k, 0]) / side_m)
                y = math.floor((xy_m[n, 1] - corner_m[k, 1]) / side_m)
                is_inside = 0 <= x < rows and 0 <= y < columns
                x, y = min(max(x, 0), rows - 1), min(max(y, 0), columns - 1)
                if is_any or (is_inside and is_beside[k, x, y]):
                    found[n] = nearest[k, x, y]
    return found


@compiled
def times_between(first: Any, column: Any, rssi_dbm: Any, age_s: Any, goes_on: Any, least: int) -> Any:
    """(S,) median of how much readings aged that a scan has from the one before; NaN of fewer than `least`.

    Scan s owns the readings `first[s]:first[s + 1]`, the first one of an access point `column` (R,) counts; `goes_on`
    (S,) says whether the scan before is of the same walk.
    """
    seen_at = np.empty(column.max() + 1 if len(column) else 0, np.int64)
    for c in range(len(seen_at)):
        seen_at[c] = -1
    lasted_s, aged_s = np.empty(len(goes_on)), np.empty(len(column))
    for s in range(len(goes_on)):
        count, low = 0, first[s - 1] if s > 0 and goes_on[s] else first[s]
        for r in range(first[s], first[s + 1]):
            before = seen_at[column[r]]
            if before >= first[s]:
                continue
            seen_at[column[r]] = r
            if before >= low and rssi_dbm[before] == rssi_dbm[r] and age_s[r] > age_s[before]:
                aged, at = age_s[r] - age_s[before], count
                while at > 0 and aged_s[at - 1] > aged:
                    aged_s[at] = aged_s[at - 1]
                    at -= 1
                aged_s[at] = aged
                count += 1
        lasted_s[s] = (aged_s[(count - 1) // 2] + aged_s[count // 2]) / 2 if count >= max(least, 1) else np.nan
    return lasted_s


@compiled
def mixture(xy_m: Any, level: Any, at_m: Any, at_level: Any, weight: Any, spread_m: float, everywhere: float) -> Any:
    """(N,) what is everywhere, and on their levels K normal densities (K, 2) by weight (K,), without their factor."""
    density, half = np.empty(len(xy_m)), 0.5 / spread_m**2
    for n in range(len(xy_m)):
        x, y, here, total = xy_m[n, 0], xy_m[n, 1], level[n], everywhere
        for k in range(len(weight)):
            off = ((x - at_m[k, 0]) ** 2 + (y - at_m[k, 1]) ** 2) * half
            if off < FAR and at_level[k] == here:
                total += weight[k] * math.exp(-off)
        density[n] = total
    return density


@compiled
def mixtures(distance: Any, asked: Any, xy_m: Any, level: Any, softness: Any, spread_m: Any) -> Any:
    """(A, B, Q) the same at the places of Q scans `asked` of all S, which count by their distances (Q, S) from these.

    A distance loses 1 / e over softness (A,); infinite ones do not count. The densities spread by (B,).
    """
    found = np.zeros((len(softness), len(spread_m), len(asked)))
    soft, near = np.empty(len(softness)), np.empty(len(spread_m))
    total = np.empty(len(softness))
    for q in range(len(asked)):
        nearest, own = distance[q].min(), asked[q]
        for a in range(len(soft)):
            total[a] = 0.0
        for s in range(len(xy_m)):
            if distance[q, s] == np.inf:
                continue
            for a in range(len(soft)):
                off = (distance[q, s] - nearest) / softness[a]
                soft[a] = math.exp(-off) if off < FAR else 0.0
                total[a] += soft[a]
            if level[s] != level[own]:
                continue
            away_m2 = (xy_m[s, 0] - xy_m[own, 0]) ** 2 + (xy_m[s, 1] - xy_m[own, 1]) ** 2
            for b in range(len(near)):
                off = 0.5 * away_m2 / spread_m[b] ** 2
                near[b] = math.exp(-off) if off < FAR else 0.0
            for a in range(len(soft)):
                for b in range(len(near) if soft[a] > 0.0 else 0):
                    found[a, b, q] += soft[a] * near[b]
        for a in range(len(soft)):
            for b in range(len(near)):
                found[a, b, q] /= total[a]
    return found
