"""Observations and actions in other forms, for policies that learn. They can be combined in any order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final, SupportsFloat, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from pdrbench.errors import PdrbenchError, UnsuitableError, unknown_name
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.gym.env import LocalizationEnv
from pdrbench.gym.spaces import LEVEL_BOUND, POSITION_BOUND_M, count_key
from pdrbench.localizer import Briefing

UNHEARD_DBM: Final = -100.0  # below what a phone receives, and the usual filling value of fingerprint tables
WIFI: Final = "wifi"
DENSE_KEY: Final = "wifi_rssi_dbm"
START_KEY: Final = "start"
FRAMES: Final = ("building", "heading")

LocalizationWrapped = gymnasium.Env[dict[str, Any], NDArray[Any]]
LocalizationWrapper = gymnasium.Wrapper[dict[str, Any], NDArray[Any], dict[str, Any], NDArray[Any]]
ObservationWrapper = gymnasium.ObservationWrapper[dict[str, Any], NDArray[Any], dict[str, Any]]
Stepped = tuple[dict[str, Any], SupportsFloat, bool, bool, dict[str, Any]]


class DenseWifi(ObservationWrapper, RecordConstructorArgs):
    """Puts `wifi_rssi_dbm` (A,), one value per access point, in the place of the rows of `wifi`.

    An access point that this observation did not bring has -100 dBm; one that it brought more than once has its last
    value. Access points that are not among the A are left out.
    """

    def __init__(self, env: LocalizationWrapped, access_points: Sequence[int] | None = None) -> None:
        """Wraps an environment that offers `wifi`.

        Args:
            env: A `LocalizationEnv`, possibly wrapped.
            access_points: Identifiers in any order; the vector has them in ascending order. None: those in the radio
                maps of all walks of the split, for which each of its recordings is loaded once.
        """
        RecordConstructorArgs.__init__(self, access_points=access_points)
        gymnasium.ObservationWrapper.__init__(self, env)
        inner = env.observation_space
        if not isinstance(inner, spaces.Dict) or WIFI not in inner.spaces:
            raise UnsuitableError("DenseWifi needs the sensor 'wifi', which this environment does not offer")
        known = _surveyed(cast(LocalizationEnv, env.unwrapped)) if access_points is None else access_points
        self.access_points: IntArray = np.unique(np.asarray(known, dtype=np.int64))
        if not len(self.access_points):
            raise UnsuitableError(
                "DenseWifi needs access_points: this environment has no radio survey to take them from"
            )
        kept = {key: box for key, box in inner.spaces.items() if key not in (WIFI, count_key(WIFI))}
        spec = next(spec for spec in cast(LocalizationEnv, env.unwrapped).task.sensors if spec.name == WIFI)
        self._access_point, self._rssi = spec.index("access_point"), spec.index("rssi_dbm")
        low, high = min(UNHEARD_DBM, spec.low[self._rssi]), spec.high[self._rssi]
        kept[DENSE_KEY] = spaces.Box(low, high, (len(self.access_points),), np.float64)
        self.observation_space = spaces.Dict({key: kept[key] for key in sorted(kept)})
        self._kept = tuple(key for key in self.observation_space.spaces if key != DENSE_KEY)

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        """The same, with the vector in the place of the rows."""
        rows: FloatArray = observation[WIFI][: int(observation[count_key(WIFI)][0])]
        dense = np.full(len(self.access_points), UNHEARD_DBM)
        place = np.searchsorted(self.access_points, rows[:, self._access_point]).clip(max=len(dense) - 1)
        known = self.access_points[place] == rows[:, self._access_point]
        dense[place[known]] = rows[known, self._rssi]
        return {DENSE_KEY: dense, **{key: observation[key] for key in self._kept}}


def _surveyed(env: LocalizationEnv) -> IntArray:
    """Access points in the radio maps of the walks of the environment's split."""
    maps = (env.task.radio_map(env.task.load(walk)) for walk in env.task.split(env.split))
    found = [radio_map.access_point for radio_map in maps if radio_map is not None]
    return np.unique(np.concatenate([*found, np.zeros(0, dtype=np.int64)]))


class RelativeAction(LocalizationWrapper, RecordConstructorArgs):
    """Actions (3,) from -1 to 1 that move the last answer on, in the place of `x_m, y_m, level`.

    In the frame "building" the first two are dx and dy, 1 for `max_move_m`. In the frame "heading" they are the way
    ahead, 1 for `max_move_m`, and the turn to the left before it, 1 for `max_turn_rad`; the wrapper adds the turns up.
    The third goes a level up from 0.5 on, and one down from -0.5 on. What is beyond -1 and 1 counts as that. An action
    that is not finite is no answer and moves nothing.

    Attributes:
        heading_rad: Of travel, counter-clockwise from +x; 0 at first where the start has none.
    """

    def __init__(
        self, env: LocalizationWrapped, frame: str = "building", max_move_m: float = 2.0, max_turn_rad: float = math.pi
    ) -> None:
        """Wraps an environment without claims."""
        RecordConstructorArgs.__init__(self, frame=frame, max_move_m=max_move_m, max_turn_rad=max_turn_rad)
        gymnasium.Wrapper.__init__(self, env)
        if frame not in FRAMES:
            raise unknown_name("frame of actions", frame, FRAMES)
        if not (0 < max_move_m < math.inf and 0 < max_turn_rad < math.inf):
            raise PdrbenchError(f"max_move_m and max_turn_rad are positive; got {max_move_m} and {max_turn_rad}")
        if cast(LocalizationEnv, env.unwrapped).claims:
            raise UnsuitableError("RelativeAction answers positions only: make the environment without claims")
        self.action_space = spaces.Box(-1.0, 1.0, (3,), np.float32)
        self.heading_rad = 0.0
        self._turns = frame == "heading"
        self._scale = np.array([max_move_m, max_turn_rad if self._turns else max_move_m])
        self._at = (0.0, 0.0, 0)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begins a walk where its first answer stands."""
        observation, info = self.env.reset(seed=seed, options=options)
        briefing: Briefing = info["briefing"]
        self.heading_rad = 0.0 if briefing.start is None else briefing.start.heading_rad or 0.0
        self._at = cast(LocalizationEnv, self.env.unwrapped).position
        return observation, info

    def step(self, action: NDArray[Any]) -> Stepped:
        """Moves the last answer on and answers that."""
        moved = np.clip(np.asarray(action, dtype=np.float64), -1.0, 1.0)
        if moved.shape != (3,):
            raise PdrbenchError(f"a relative action has shape (3,); got {moved.shape}")
        if not np.isfinite(moved).all():
            return self.env.step(np.full(3, np.nan))
        first, second = (moved[:2] * self._scale).tolist()
        if self._turns:
            self.heading_rad += second
            first, second = first * math.cos(self.heading_rad), first * math.sin(self.heading_rad)
        x_m, y_m, level = self._at
        self._at = x_m + first, y_m + second, level + int(moved[2] >= 0.5) - int(moved[2] <= -0.5)
        return self.env.step(np.array(self._at))


class StartInObservation(
    gymnasium.ObservationWrapper[dict[str, Any], NDArray[Any], dict[str, Any]], RecordConstructorArgs
):
    """Adds `start` (6,): x_m, y_m, level, cosine and sine of the heading (0, 0 where it is not known), radius_m.

    Where no start is given, it is the centre of the building, with a radius that covers the building; where there is
    no building either, the middle of the radio survey, with a radius that covers the survey.
    """

    def __init__(self, env: LocalizationWrapped) -> None:
        RecordConstructorArgs.__init__(self)
        gymnasium.ObservationWrapper.__init__(self, env)
        high = np.array([POSITION_BOUND_M, POSITION_BOUND_M, LEVEL_BOUND, 1.0, 1.0, 2 * POSITION_BOUND_M])
        low = np.append(-high[:5], 0.0)
        self.observation_space = _with_key(env, START_KEY, spaces.Box(low, high, dtype=np.float64))
        self._start = np.zeros(6)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begins a walk."""
        observation, info = self.env.reset(seed=seed, options=options)
        briefing: Briefing = info["briefing"]
        x_m, y_m, level = cast(LocalizationEnv, self.env.unwrapped).position
        heading_rad = None if briefing.start is None else briefing.start.heading_rad
        ahead = (0.0, 0.0) if heading_rad is None else (math.cos(heading_rad), math.sin(heading_rad))
        radius_m = 0.0
        if briefing.start is not None:
            radius_m = briefing.start.radius_m
        elif briefing.building is not None:
            x0_m, y0_m, x1_m, y1_m = briefing.building.bounds_m()
            radius_m = math.hypot(x1_m - x0_m, y1_m - y0_m)
        elif briefing.radio_map:
            radius_m = float(np.hypot(*np.ptp(briefing.radio_map.xy_m, axis=0)))
        self._start = np.array([x_m, y_m, level, *ahead, radius_m])
        return self.observation(observation), info

    def observation(self, observation: dict[str, Any]) -> dict[str, Any]:
        """The same with the start."""
        return _in_order({**observation, START_KEY: self._start.copy()})


def _with_key(env: LocalizationWrapped, key: str, box: spaces.Box) -> spaces.Dict:
    """The observation space with one more key."""
    inner = env.observation_space
    if not isinstance(inner, spaces.Dict):
        raise UnsuitableError(f"observations are not a dict that {key!r} could be added to: wrap before flattening")
    return spaces.Dict(_in_order({**inner.spaces, key: box}))


def _in_order(entries: dict[str, Any]) -> dict[str, Any]:
    return {key: entries[key] for key in sorted(entries)}
