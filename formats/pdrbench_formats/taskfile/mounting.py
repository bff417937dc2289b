"""Whether a unit was worn on a shoe, from how it moved."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray

BLOCK_S: Final = 2.0  # holds a swing and a stance of every gait
MOVING_RADPS: Final = 1.5  # largest rate of a block that counts
SWING_RADPS: Final = 4.0  # a shoe swings at 6 to 10
STANCE_RADPS: Final = 0.5  # mean over `STANCE_S` while it stands
STANCE_S: Final = 0.1
IMPACT_MPS2: Final = 20.0  # of one sample in a hundred
MIN_BLOCKS: Final = 5
# Of moving blocks that hold a swing and a stance. The thresholds were chosen on ten recorded walks of shoes and 18 of
# phones. No recorded walk of a phone among 46 is taken for a shoe (MallPhone-v2, IpinPhone-v1); 23 of 26 walks of
# shoes are (FootWalks-v1, FootVicon-v1, FootLoops-v1, FootShort-v1).
MIN_FRACTION: Final = 0.7


def moves_as_shoe(rows: Mapping[str, FloatArray]) -> bool:
    """True where a recording swings and stands still in turns, all along, as only a shoe does.

    Args:
        rows: (T, 4) of `accel` and `gyro` by name, as in a log; without one of them the answer is False.
    """
    if not {"accel", "gyro"} <= rows.keys() or min(len(rows["accel"]), len(rows["gyro"])) < 2:
        return False
    t_s, rate_radps = rows["gyro"][:, 0], np.linalg.norm(rows["gyro"][:, 1:4], axis=1)
    if np.quantile(np.linalg.norm(rows["accel"][:, 1:4], axis=1), 0.99) < IMPACT_MPS2:
        return False
    gap_s = float(np.median(np.diff(t_s)))
    width = max(1, round(STANCE_S / gap_s)) if gap_s > 0 else 1
    calm_radps = np.convolve(rate_radps, np.full(width, 1.0 / width), mode="same")
    first = np.flatnonzero(np.diff((t_s - t_s[0]) // BLOCK_S, prepend=-1.0))
    swing_radps, stance_radps = np.maximum.reduceat(rate_radps, first), np.minimum.reduceat(calm_radps, first)
    moving = swing_radps > MOVING_RADPS
    strides = (swing_radps > SWING_RADPS) & (stance_radps < STANCE_RADPS)
    return int(moving.sum()) >= MIN_BLOCKS and bool(strides.sum() >= MIN_FRACTION * moving.sum())
