"""Whether the level is right, and how long a change of level goes unnoticed."""

from __future__ import annotations

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.metrics.hold import Held
from pdrbench.metrics.position import mean
from pdrbench.trajectory import Trajectory


def level_differences(held: Held, reference: Trajectory) -> FloatArray:
    """(n,) |dl| = |level_est - level_ref| at the surveyed rows."""
    return np.abs(held.level - reference.level)[reference.surveyed]


def level_hit_rate(held: Held, reference: Trajectory) -> float:
    """Fraction of surveyed positions on the right level: #{dl = 0} / n."""
    return mean((level_differences(held, reference) == 0).astype(np.float64))


def level_change_delays_s(held: Held, reference: Trajectory) -> tuple[FloatArray, FloatArray]:
    """How long after each change of level of the surveyed reference the estimate is on the new level.

    A change is the first surveyed row k on a new level; the stay there ends with the next change, the last one with
    the last surveyed row. delay = t_j - t_k with j the first surveyed row of the stay on which the levels agree; an
    estimate that never arrives has a delay of the whole stay. Changes whose stay is one last row long cannot be
    timed and are left out.

    Returns:
        delay_s: (C,).
        missed: (C,) 1.0 where the estimate was on the new level at no surveyed row of the stay, else 0.0.
    """
    scored = reference.scored()
    agrees = level_differences(held, reference) == 0
    change = np.flatnonzero(np.diff(scored.level)) + 1
    delays, missed = [], []
    for first, following in zip(change, np.append(change, len(scored))[1:], strict=True):
        leaves_s = scored.t_s[min(following, len(scored) - 1)]
        if leaves_s == scored.t_s[first]:
            continue
        stay = agrees[first:following]
        arrives_s = scored.t_s[first + int(stay.argmax())] if stay.any() else leaves_s
        delays.append(arrives_s - scored.t_s[first])
        missed.append(float(not stay.any()))
    return np.array(delays), np.array(missed)


def level_change_delay_s(held: Held, reference: Trajectory) -> float:
    """Mean delay in seconds of `level_change_delays_s`, missed changes with their whole stay; NaN without changes."""
    return mean(level_change_delays_s(held, reference)[0])


def level_changes_missed(held: Held, reference: Trajectory) -> float:
    """Fraction of the changes of level after which the estimate never was on the new level; NaN without changes."""
    return mean(level_change_delays_s(held, reference)[1])
