"""The localizer that never moves: the upper bracket of every environment with a known start."""

from __future__ import annotations

import numpy as np

from pdrbench.errors import UnsuitableError
from pdrbench.localizer import Briefing, Estimate, Observation


class Stay:
    """Answers the briefed start, or the centre of the building where no start is given."""

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        start = briefing.start
        if start is None:
            if briefing.building is None:
                raise UnsuitableError("needs a known start or a building; this environment has neither")
            start = briefing.building.centre()
        self._estimate = Estimate(xy_m=start.xy_m, level=start.level)

    def step(self, observation: Observation) -> Estimate:
        return self._estimate
