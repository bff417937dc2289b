"""Times of samples whose stamps come in bursts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit


@njit(cache=True, error_model="numpy", nogil=True)
def even_clock(t_s: Any, state: Any) -> Any:
    """(n,) times of samples whose stamps come in bursts, on an even clock; other stamps stay as they are.

    A unit samples evenly; a logger that stamps what arrives gives several samples one time. Once 2 % of the last few
    hundred intervals are below 0.3 of their mean, a clock runs on by the mean interval with every sample and follows
    the stamps over 100 samples. Stamps that are eight intervals ahead of it are a gap.

    Args:
        t_s: (n,) stamps in seconds, not decreasing.
        state: (6,) stamp and clock of the sample before, NaN at first; number and mean of the intervals, share of the
            short ones, 1 once the clock runs; updated.
    """
    clock = np.empty(len(t_s))
    for k in range(len(t_s)):
        step = t_s[k] - state[0]
        if math.isnan(step):
            state[1] = t_s[k]
        elif state[2] < 20 or step <= 8.0 * state[3]:
            state[4] += 0.005 * ((1.0 if step < 0.3 * state[3] else 0.0) - state[4])
            state[2] += 1.0
            state[3] += max(1.0 / state[2], 0.005) * (step - state[3])
        if state[4] > 0.02:
            state[5] = 1.0
        off = t_s[k] - state[1] - state[3]
        is_even = state[5] > 0.0 and off < 8.0 * state[3] and not math.isnan(step)
        state[1] = state[1] + max(state[3] + 0.01 * off, 0.0) if is_even else max(t_s[k], state[1])
        state[0] = t_s[k]
        clock[k] = state[1]
    return clock
