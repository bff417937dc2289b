"""Compiled kernels of the distance between a scan and histograms.

Indices that are read from memory are unsigned: numba then needs not ask whether they count from the end.
"""

from __future__ import annotations

import math
from typing import Any

from numba import njit


@njit(cache=True)
def add_received(
    distance_db: Any, column: Any, rssi_dbm: Any, missing_db: Any, unheard_dbm: float, queries: Any
) -> None:
    """Adds to `distance_db` (P,) what receiving an access point changes, for the histograms of each.

    E|x - X| comes in place of E|unheard - X| and, where points without it are penalised, of `missing_db`. Both are
    first taken as if the reading lay outside every histogram, where it is |x - mean|; then the excess over that is
    added for histograms that reach to both sides of it. Those of one slice are neighbours in memory.
    """
    first, point, mean_dbm, _, bottom_dbm, first_slice, first_part, part_of, part_point, excess_db, slope = queries
    for i in range(len(column)):
        a, x = column[i], rssi_dbm[i]
        low, high = first[a], first[a + 1]
        _add_outside(distance_db, x, missing_db[i], unheard_dbm, point[low:high], mean_dbm[low:high])
        for reading, sign in ((x, 1.0), (unheard_dbm, -1.0)):
            step = math.floor(reading) - bottom_dbm[a]
            if step < 0 or step >= first_slice[a + 1] - first_slice[a]:
                continue
            begin, end = first_part[first_slice[a] + step], first_part[first_slice[a] + step + 1]
            if reading == math.floor(reading):
                _add_at(distance_db, sign, part_point[begin:end], excess_db[begin:end])
            else:
                _add_between(
                    distance_db, reading, part_point[begin:end], excess_db[begin:end], slope[begin:end],
                    part_of[begin:end], mean_dbm,
                )  # fmt: skip


@njit(cache=True)
def _add_outside(distance_db: Any, x: float, missing_db: float, unheard_dbm: float, point: Any, mean_dbm: Any) -> None:
    """Adds |x - mean| less the distance of an access point that is not received."""
    if len(point) == len(distance_db):  # received everywhere: histogram h is of point h
        for h in range(len(distance_db)):
            distance_db[h] += abs(x - mean_dbm[h]) - abs(unheard_dbm - mean_dbm[h]) - missing_db
    else:
        for h in range(len(point)):
            distance_db[point[h]] += abs(x - mean_dbm[h]) - abs(unheard_dbm - mean_dbm[h]) - missing_db


@njit(cache=True)
def _add_at(distance_db: Any, sign: float, point: Any, excess_db: Any) -> None:
    """Adds the excess in the middle of a bin."""
    for part in range(len(point)):
        distance_db[point[part]] += sign * excess_db[part]


@njit(cache=True)
def _add_between(
    distance_db: Any, x: float, point: Any, excess_db: Any, slope: Any, part_of: Any, mean_dbm: Any
) -> None:
    """Adds the excess between the middles of two bins, where E|x - X| is linear and |x - mean| may have its kink."""
    whole = math.floor(x)
    for part in range(len(point)):
        mean = mean_dbm[part_of[part]]
        distance_db[point[part]] += excess_db[part] + abs(whole - mean) + (x - whole) * slope[part] - abs(x - mean)
