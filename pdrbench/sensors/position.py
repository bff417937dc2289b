"""Where an inertial system believes to be, in the frame of the building, and how far it is off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np

from pdrbench.errors import RecordingError, unknown_name
from pdrbench.geometry import FloatArray
from pdrbench.recording import MAX_WALK_S, SensorSpec

Reading = Literal["iid", "drift"]  # of a "constantly growing variance" (K5)
MAX_COORDINATE_M: Final = 1e5

POSITION: Final = SensorSpec(
    name="position",
    columns=("t_s", "x_m", "y_m"),
    low=np.array([0.0, -MAX_COORDINATE_M, -MAX_COORDINATE_M]),
    high=np.array([MAX_WALK_S, MAX_COORDINATE_M, MAX_COORDINATE_M]),
    rate_hz=1.0,
    what=(
        "Where an inertial navigation system believes to be, in the frame of the building, aligned at the beginning of "
        "the walk; its error grows with the time since then. It knows nothing of levels."
    ),
)


@dataclass(frozen=True, slots=True)
class PositionErrors:
    """How far off such a system is: a variance per axis that grows evenly, sigma^2(t) = sigma0^2 + q t (K5).

    Attributes:
        sigma0_m: At the beginning.
        q_m2ps: Growth of the variance of an axis.
    """

    sigma0_m: float = 0.3  # K5; the paper gives none
    q_m2ps: float = 0.02  # likewise: 1.6 m per axis after two minutes

    def __post_init__(self) -> None:
        for name in ("sigma0_m", "q_m2ps"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0):
                raise RecordingError(f"{name} of a position is a number of at least 0; got {value}")

    def sigma_m(self, t_s: FloatArray) -> FloatArray:
        """(T,) standard deviation per axis at times (T,) since the beginning.

        >>> PositionErrors().sigma_m(np.array([0.0, 120.0])).round(2).tolist()
        [0.3, 1.58]
        """
        sigma: FloatArray = np.sqrt(self.sigma0_m**2 + self.q_m2ps * np.maximum(t_s, 0.0))
        return sigma


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
