"""Displacements of a shoe, as those of a phone: second by second, by `foot_ins_robust`."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial import FootParams
from pdrbench.localizer import Briefing, Observation
from pdrbench.trajectory import Start
from pdrbench_baselines.foot_ins.localizer import FootInsParams, FootInsRobust
from pdrbench_baselines.learned.reckoning import EVERY_S, ROUNDING_S, Move

STANDS_M: Final = 0.1  # ours: a foot that is nearer to where it was a second ago stands, or shuffles
NOISE_M: Final = 0.05  # ours: standard deviation per axis of the displacement of a second
PARAMS: Final = FootInsParams(filter=FootParams(), revises=False)


class ShoeReckoner:
    """Takes what a unit on a foot measures and reports by how much the foot moves.

    Args:
        briefing: As `foot_ins_robust` needs it, but for the start: without its heading, displacements are in the frame
            of the filter, which is turned by any angle.
        rng: Is not used.
    """

    has_compass: Final = False

    def __init__(self, briefing: Briefing, rng: np.random.Generator) -> None:
        start = briefing.start or Start(xy_m=np.zeros(2), level=0)
        self._ins = FootInsRobust(PARAMS)
        self._ins.reset(replace(briefing, start=start), rng)
        self._from_m: FloatArray = np.array(start.xy_m)
        self._end_s = -math.inf
        self._level = start.level
        self.since_m: FloatArray = np.zeros(2)  # (2,) from the end of the last displacement to now
        self.level_changes: list[tuple[int, bool]] = []  # of the last observation: levels up, and whether by lift

    def update(self, observation: Observation) -> Iterator[Move]:
        """Takes an observation; gives a displacement where a second is over, or none.

        Raises:
            RecordingError: Other units than m/s2 and rad/s, or times that go back.
        """
        estimate = self._ins.step(observation)
        xy_m = estimate.xy_m
        self.since_m = xy_m - self._from_m
        self.level_changes = [(change.levels, change.way == "lift") for change in self._ins.level_changes]
        if not self.level_changes and estimate.level != self._level:
            self.level_changes = [(estimate.level - self._level, False)]
        self._level = estimate.level
        if observation.now_s < self._end_s + EVERY_S - ROUNDING_S:
            return
        self._end_s = observation.now_s
        stands = math.hypot(*self.since_m) < STANDS_M
        yield Move(observation.now_s, self.since_m, np.eye(2) * NOISE_M**2, stands, False)
        if not stands:
            self._from_m, self.since_m = xy_m, np.zeros(2)
