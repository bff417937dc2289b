"""Spaces of an environment, and the way between its arrays and the records of a localizer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from gymnasium import spaces

from pdrbench.episode import read_estimate
from pdrbench.errors import EstimateError, unknown_name
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Observation
from pdrbench.recording import SensorSpec
from pdrbench.task import Task
from pdrbench.trajectory import ESTIMATE_COLUMNS

NOW: Final = "now_s"
ANSWER_COLUMNS: Final = {"heading": 3, "sigma": 4, "converged": 5}  # where a claim stands in a row of `read_estimate`
POSITION_BOUND_M: Final = 1e5  # generous: a building frame has its origin in or near the building
LEVEL_BOUND: Final = 200.0  # the tallest building has 163 levels
CLAIM_BOUNDS: Final = {"heading": (-2 * np.pi, 2 * np.pi), "sigma": (0.0, POSITION_BOUND_M), "converged": (0.0, 1.0)}
MIN_CONVERGED: Final = 0.5  # an action that claims this much or more claims to have converged
NOW_BOUND_S: Final = 1e6  # eleven days


def count_key(sensor: str) -> str:
    """Key under which the number of rows of a sensor stands.

    >>> count_key("wifi")
    'wifi_count'
    """
    return f"{sensor}_count"


def make_observation_space(task: Task) -> spaces.Dict:
    """Per sensor a zero-padded box (capacity, C) and its number of rows (1,); beside them `now_s` (1,)."""
    boxes: dict[str, spaces.Space[FloatArray]] = {NOW: spaces.Box(0.0, NOW_BOUND_S, (1,), np.float64)}
    for spec in task.sensors:
        capacity = task.capacity[spec.name]
        shape = (capacity, len(spec.columns))
        boxes[spec.name] = spaces.Box(
            np.broadcast_to(spec.low, shape).copy(), np.broadcast_to(spec.high, shape).copy(), dtype=np.float64
        )
        boxes[count_key(spec.name)] = spaces.Box(0.0, float(capacity), (1,), np.float64)
    return spaces.Dict({key: boxes[key] for key in sorted(boxes)})


def make_action_space(claims: Sequence[str]) -> spaces.Box:
    """`x_m, y_m, level`, then one value per claim."""
    if isinstance(claims, str):
        raise EstimateError(f"claims is a tuple of names, as ('heading',); got the text {claims!r}")
    for claim in claims:
        if claim not in CLAIM_BOUNDS:
            raise unknown_name("claim", claim, CLAIM_BOUNDS)
    if len(set(claims)) != len(claims):
        raise EstimateError(f"a claim is made once; got {tuple(claims)}")
    position = [(-POSITION_BOUND_M, POSITION_BOUND_M)] * 2 + [(-LEVEL_BOUND, LEVEL_BOUND)]
    low, high = np.array(position + [CLAIM_BOUNDS[claim] for claim in claims]).T
    return spaces.Box(low.copy(), high.copy(), dtype=np.float64)


def to_observation(arrays: Mapping[str, FloatArray], sensors: Mapping[str, SensorSpec]) -> Observation:
    """What a localizer is given, from an element of the observation space; `sensors` as in the briefing."""
    rows = {name: arrays[name][: int(arrays[count_key(name)][0])].copy() for name in sensors}
    return Observation(now_s=float(arrays[NOW][0]), rows=rows)


def to_action(estimate: object, claims: Sequence[str] = ()) -> FloatArray:
    """The action (3 + claims,) for what a localizer answered, NaN where it counts as missing.

    >>> from pdrbench.localizer import Estimate
    >>> to_action(Estimate(xy_m=[1.0, 2.0], level=-1, sigma_m=0.5), claims=("heading", "sigma"))
    array([ 1. ,  2. , -1. ,  nan,  0.5])
    """
    try:
        answer = read_estimate(estimate)
    except EstimateError:
        return np.full(3 + len(claims), np.nan)
    return np.array([*answer[:3], *(answer[ANSWER_COLUMNS[claim]] for claim in claims)])


def to_rows(actions: FloatArray, claims: Sequence[str]) -> FloatArray:
    """(N, 6) rows as `Episode.submit_rows` takes them, from actions (N, 3 + claims)."""
    rows = np.full((len(actions), len(ESTIMATE_COLUMNS)), np.nan)
    rows[:, :2] = actions[:, :2]
    rows[:, 2] = np.rint(actions[:, 2])
    rows[:, [ANSWER_COLUMNS[claim] for claim in claims]] = actions[:, 3:]
    converged = rows[:, ANSWER_COLUMNS["converged"]]
    converged[:] = np.where(np.isnan(converged), np.nan, converged >= MIN_CONVERGED)
    return rows
