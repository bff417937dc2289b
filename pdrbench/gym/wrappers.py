"""Observations in other forms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final, cast

import gymnasium
import numpy as np
from gymnasium import spaces
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.gym.env import LocalizationEnv
from pdrbench.gym.spaces import count_key

UNHEARD_DBM: Final = -100.0  # below what a phone receives, and the usual filling value of fingerprint tables
WIFI: Final = "wifi"
DENSE_KEY: Final = "wifi_rssi_dbm"

LocalizationWrapped = gymnasium.Env[dict[str, Any], NDArray[Any]]


class DenseWifi(gymnasium.ObservationWrapper[dict[str, Any], NDArray[Any], dict[str, Any]], RecordConstructorArgs):
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
