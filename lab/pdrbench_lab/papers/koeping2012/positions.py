"""What an inertial system reports of its position, in both readings of K5."""

from __future__ import annotations

from typing import Literal, get_args

import numpy as np

from pdrbench.errors import RecordingError, unknown_name
from pdrbench.geometry import FloatArray
from pdrbench.sensors.position import PositionErrors

Reading = Literal["iid", "drift"]  # of a "constantly growing variance" (K5)


def measure(
    t_s: FloatArray, xy_m: FloatArray, rng: np.random.Generator, reading: Reading, errors: PositionErrors | None = None
) -> FloatArray:
    """What such a system reports.

    Both readings of K5 have the same variance at every time. "iid", to the letter: the error of a row has nothing to do
    with the one before. "drift", as inertial systems err: an offset that begins at N(0, sigma0^2) and walks at random,
    by N(0, q dt) per axis from row to row.

    Args:
        t_s: (T,) since the beginning of the walk, increasing.
        xy_m: (T, 2) where it is.
        rng: Draws the offset of the beginning from one child, what comes later from another.
        reading: See above.
        errors: None for the defaults.

    Returns:
        (T, 3) columns of `POSITION`.
    """
    if reading not in get_args(Reading):
        raise unknown_name("reading of the error of a position", reading, get_args(Reading))
    t_s, xy_m = np.asarray(t_s, dtype=np.float64), np.asarray(xy_m, dtype=np.float64)
    if t_s.ndim != 1 or xy_m.shape != (len(t_s), 2):
        raise RecordingError(f"a position needs t_s (T,) and xy_m (T, 2); got {t_s.shape} and {xy_m.shape}")
    if (np.diff(t_s) <= 0).any() or (t_s[:1] < 0).any():
        raise RecordingError("times of positions begin at 0 or later and increase; sort them and drop duplicates")
    errors = errors or PositionErrors()
    first, later = rng.spawn(2)
    white = later.standard_normal((len(t_s), 2))
    if reading == "iid":
        return np.column_stack([t_s, xy_m + errors.sigma_m(t_s)[:, None] * white])
    steps_m = np.sqrt(errors.q_m2ps * np.diff(t_s, prepend=0.0))[:, None] * white
    offset_m = errors.sigma0_m * first.standard_normal(2) + np.cumsum(steps_m, axis=0)
    return np.column_stack([t_s, xy_m + offset_m])
