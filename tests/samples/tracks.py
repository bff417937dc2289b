"""Answers and references of a few rows, as tests of scores write them."""

from __future__ import annotations

import math

import numpy as np

from pdrbench.trajectory import Estimates, Trajectory


def make_answers(t_s: object, xy_m: object, level: object = 0.0, **claims: object) -> Estimates:
    """Answers at times (T,) that claim nothing but what is given; every column may be one value for all rows."""
    t_s = np.asarray(t_s, dtype=float)
    count = len(t_s)
    columns = {"heading_rad": math.nan, "sigma_m": math.nan, "converged": math.nan} | claims
    return Estimates(
        t_s=t_s,
        xy_m=np.broadcast_to(np.asarray(xy_m, dtype=float), (count, 2)),
        level=np.broadcast_to(level, count).astype(float),
        **{name: np.broadcast_to(column, count).astype(float) for name, column in columns.items()},
    )


def make_reference(xy_m: object, level: object = 0, surveyed: object = True, **more: object) -> Trajectory:
    """A reference at places (T, 2), a row a second unless `more` has times (T,)."""
    xy_m = np.asarray(xy_m, dtype=float)
    count = len(xy_m)
    return Trajectory(
        xy_m=xy_m,
        level=np.broadcast_to(level, count).astype(int),
        surveyed=np.broadcast_to(surveyed, count).astype(bool),
        **{"t_s": np.arange(count, dtype=float)} | more,
    )
