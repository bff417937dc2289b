"""What localizers share whose displacements come from a network."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.inertial import WAYS
from pdrbench.localizer import Briefing
from pdrbench_baselines.learned.attitude_sources import PHONE
from pdrbench_baselines.learned.compiled import compiled_network
from pdrbench_baselines.learned.reckoning import Reckoner

BY_LIFT: Final = float(WAYS.index("lift"))
CARRY_S: Final = 1.2  # ours: between seconds the answer goes on at the last velocity, so long at most
WALKS_M: Final = 0.2  # ours: a shorter displacement of a second says nothing of the heading


class NetworkLocalizer:
    """Displacements of a network, second by second, and where the walker has got to since the last one.

    Args:
        weights: File of a training run, in place of the network that comes with pdrbench; None for that.
        carry_s: See `CARRY_S`.
    """

    def __init__(self, weights: str | None = None, carry_s: float = CARRY_S) -> None:
        self._carry_s = carry_s
        self._network = None if weights is None else compiled_network(weights)

    def _begin(self, briefing: Briefing, length_factor: float = 1.0) -> None:
        """Begins a walk; see `Reckoner`."""
        briefing.require(sensors=("accel", "gyro"), carrier=PHONE)  # before a network is compiled for nothing
        start = briefing.start
        self._heading_rad = None if start is None else start.heading_rad
        if self._heading_rad is None and not {"rotation", "mag"} & set(briefing.sensors):
            raise UnsuitableError("needs a rotation vector, a magnetometer or the heading of the start")
        self._network = self._network or compiled_network()
        self._reckoner = Reckoner(self._network, briefing, length_factor=length_factor)
        self._velocity_mps, self._end_s = np.zeros(2), -math.inf
        self._has_level_changes = "level_change" in briefing.sensors

    def _follow(self, move_m: FloatArray, end_s: float) -> None:
        """Takes the displacement (2,) of a second, which ended then."""
        self._velocity_mps, self._end_s = move_m, end_s
        if math.hypot(move_m[0], move_m[1]) > WALKS_M:
            self._heading_rad = math.atan2(move_m[1], move_m[0])

    def _extrapolated_m(self, now_s: float) -> FloatArray:
        """(2,) how far the walker has come since the last second with an output."""
        since_s = now_s - self._end_s
        carried: FloatArray = self._velocity_mps * min(since_s, self._carry_s)
        return carried if math.isfinite(since_s) else np.zeros(2)
