"""Where an inertial system believes to be, in the frame of the building, and how far it is off."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.recording import MAX_WALK_S, SensorSpec

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
