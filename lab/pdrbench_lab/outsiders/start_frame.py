"""From the frame of a foot into that of the building."""

from __future__ import annotations

import math

import numpy as np

from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray, path_heading_rad
from pdrbench.localizer import Briefing

ALIGNED_AFTER_M = 0.5  # as foot_ins: a stride or less
LEVEL_HEIGHT_M = 3.0  # as foot_ins: a rise that counts as a level


class StartFrame:
    """Places tracks that begin at 0, 0, 0 in a direction of their own at the start of a walk and along its heading.

    Args:
        briefing: With a start.
    """

    def __init__(self, briefing: Briefing) -> None:
        if briefing.start is None or briefing.start.heading_rad is None:
            raise UnsuitableError("needs a start with a heading; this environment gives none")
        self._start, self._heading_rad = briefing.start, briefing.start.heading_rad
        self._turn_rad: float | None = None

    def place(self, xyz_m: FloatArray, stood_m: FloatArray) -> FloatArray:
        """(n, 3) x, y, level of a track (n, 3).

        Args:
            xyz_m: (n, 3) in the frame of the foot.
            stood_m: (k, 3) where the foot stood; the first of them that is far enough away settles the direction.
        """
        turn_rad = self._turn_rad
        if turn_rad is None:
            leaves_rad = path_heading_rad(np.concatenate([np.zeros((1, 2)), stood_m[:, :2]]), ALIGNED_AFTER_M)
            if leaves_rad is not None:
                turn_rad = self._turn_rad = self._heading_rad - leaves_rad
            else:
                turn_rad = self._heading_rad - math.atan2(xyz_m[-1, 1], xyz_m[-1, 0])
        c, s = math.cos(turn_rad), math.sin(turn_rad)
        xy_m = self._start.xy_m + xyz_m[:, :2] @ np.array([[c, s], [-s, c]])
        return np.column_stack([xy_m, self._start.level + np.rint(xyz_m[:, 2] / LEVEL_HEIGHT_M)])
