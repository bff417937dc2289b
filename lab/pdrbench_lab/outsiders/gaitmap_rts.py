"""gaitmap: error-state Kalman filter with zero-velocity updates and Rauch-Tung-Striebel smoothing, on a foot."""

from __future__ import annotations

from typing import Any

import numpy as np
import pandas as pd

from pdrbench.geometry import FloatArray
from pdrbench.inertial import SamplePairs
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench_lab.outsiders.packages import outside
from pdrbench_lab.outsiders.start_frame import StartFrame

COLUMNS = ("acc_x", "acc_y", "acc_z", "gyr_x", "gyr_y", "gyr_z")
EVERY_S = 0.2  # gaitmap works on whole recordings: online it is asked so often for the last seconds
WINDOW_S = 3.0
STANDS_S = 0.25  # at the start, from which the first attitude is taken


class GaitmapRts:
    """Navigates by a shoe with gaitmap's `RtsKalman` and its own settings; `revise` smooths the whole walk.

    Online it smooths a window that begins where the foot stood. Numba compiles gaitmap once per run.
    """

    def __init__(self) -> None:
        self._methods = outside("gaitmap.trajectory_reconstruction")
        self._rotations = outside("gaitmap.utils.rotations")
        self._navigate(np.tile([0.0, 0.0, 0.0, 9.81, 0.0, 0.0, 0.0], (100, 1)), 100.0, True)  # compiles

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("accel", "gyro"), start=True, carrier="foot", min_rate_hz=80.0)
        assert briefing.start is not None
        self._briefing, self._frame = briefing, StartFrame(briefing)
        self._pairs, self._rows = SamplePairs(), list[FloatArray]()
        self._rate_hz = briefing.sensors["accel"].rate_hz or 200.0
        self._is_flat = briefing.building is None or len(briefing.building.levels) == 1
        self._window, self._origin_m, self._attitude, self._next_s = np.zeros((0, 7)), np.zeros(3), None, EVERY_S
        self._estimate = Estimate(briefing.start.xy_m, briefing.start.level)

    def step(self, observation: Observation) -> Estimate:
        self._rows.append(self._pairs.update(observation["accel"], observation["gyro"]))
        self._window = np.concatenate([self._window, self._rows[-1]])
        if observation.now_s >= self._next_s and len(self._window) > STANDS_S * self._rate_hz:
            self._next_s = observation.now_s + EVERY_S
            self._look()
        return self._estimate

    def revise(self) -> FloatArray | None:
        rows = np.concatenate(self._rows)
        if len(rows) <= STANDS_S * self._rate_hz:
            return None
        kalman, xyz_m = self._navigate(rows, self._rate_hz, self._is_flat)
        placed = StartFrame(self._briefing).place(xyz_m, xyz_m[kalman.zupts_["start"]])
        return np.column_stack([rows[:, 0], placed])[:: max(1, round(self._rate_hz / 20))]

    def _look(self) -> None:
        """Smooths the window; a long one begins anew where the foot stood last in its first half."""
        kalman, xyz_m = self._navigate(self._window, self._rate_hz, self._is_flat, self._attitude)
        xyz_m = self._origin_m + xyz_m
        stood = kalman.zupts_["start"].to_numpy()
        placed = self._frame.place(xyz_m[-1:], xyz_m[stood])[0]
        self._estimate = Estimate(placed[:2], int(placed[2]))
        begins = stood[(stood > 0) & (stood < len(self._window) / 2)]
        if len(self._window) > WINDOW_S * self._rate_hz and len(begins):
            first = int(begins[-1])
            self._attitude, self._origin_m = kalman.orientation_object_[first], xyz_m[first - 1]
            self._window = self._window[first:]

    def _navigate(self, rows: FloatArray, rate_hz: float, flat: bool, attitude: Any = None) -> tuple[Any, FloatArray]:
        """The filter after (n, 7) time, specific force, rate, and the track (n, 3); None: the foot stands at first."""
        if attitude is None:
            stands = rows[:, 0] < rows[0, 0] + STANDS_S
            attitude = self._rotations.get_gravity_rotation(rows[stands, 1:4].mean(axis=0))
        table = pd.DataFrame(np.column_stack([rows[:, 1:4], np.rad2deg(rows[:, 4:7])]), columns=COLUMNS)
        kalman = self._methods.RtsKalman(initial_orientation=attitude, level_walking=flat)
        kalman.estimate(table, sampling_rate_hz=rate_hz)
        return kalman, kalman.position_.to_numpy()[1:]
