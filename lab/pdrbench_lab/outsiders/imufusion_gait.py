"""imufusion: attitude by x-io's Fusion, and its makers' way of gait tracking, on a foot."""

from __future__ import annotations

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial import SamplePairs
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench_lab.outsiders.packages import outside
from pdrbench_lab.outsiders.start_frame import StartFrame

G_MPS2 = 9.80665
MOVES_MPS2 = 3.0  # the next two: x-io's example of gait tracking
MARGIN_S = 0.1
GAIN, REJECTION_DEG, TIMEOUT_S = 0.5, 10.0, 5.0  # its settings of `Ahrs`
GYRO_RANGE_DPS = 2000.0


class ImufusionGait:
    """Navigates by a shoe: attitude by `imufusion.Ahrs`, acceleration integrated while the foot moves.

    The foot moves around each acceleration above 3 m/s2; the velocity that is left when it stops is taken away in
    proportion to time.
    """

    def __init__(self) -> None:
        self._fusion = outside("imufusion")

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("accel", "gyro"), start=True, carrier="foot", min_rate_hz=80.0)
        assert briefing.start is not None
        self._rate_hz = rate_hz = briefing.sensors["accel"].rate_hz or 200.0
        self._ahrs, self._bias = self._fusion.Ahrs(), self._fusion.Bias()
        settings = self._fusion.AhrsSettings()
        settings.sample_rate, settings.gain, settings.gyroscope_range = rate_hz, GAIN, GYRO_RANGE_DPS
        settings.acceleration_rejection, settings.rejection_timeout = REJECTION_DEG, TIMEOUT_S
        self._ahrs.set_settings(settings)
        of_bias = self._fusion.BiasSettings()
        of_bias.sample_rate = rate_hz
        self._bias.set_settings(of_bias)
        self._frame, self._pairs = StartFrame(briefing), SamplePairs()
        self._accel_mps2: FloatArray = np.zeros((0, 3))  # in the world, since the foot stood last
        self._stood_m: FloatArray = np.zeros((1, 3))
        self._estimate = Estimate(briefing.start.xy_m, briefing.start.level)

    def step(self, observation: Observation) -> Estimate:
        rows = self._pairs.update(observation["accel"], observation["gyro"])
        if len(rows):
            self._accel_mps2 = np.concatenate([self._accel_mps2, [self._in_world(row) for row in rows]])
            here_m = self._stood_m[-1:] + self._advance()
            x_m, y_m, level = self._frame.place(here_m, self._stood_m)[0]
            self._estimate = Estimate(np.array([x_m, y_m]), int(level))
        return self._estimate

    def _in_world(self, row: FloatArray) -> FloatArray:
        """(3,) acceleration without gravity of one sample (7,)."""
        self._ahrs.update_no_magnetometer(self._bias.update(np.rad2deg(row[4:7])), row[1:4] / G_MPS2)
        in_world: FloatArray = G_MPS2 * self._ahrs.get_earth_acceleration()
        return in_world

    def _advance(self) -> FloatArray:
        """Adds the swings that have ended; returns the way (3,) of the one that goes on."""
        margin = round(MARGIN_S * self._rate_hz)
        while True:
            is_loud = np.linalg.norm(self._accel_mps2, axis=1) > MOVES_MPS2
            moves = np.convolve(is_loud, np.ones(2 * margin + 1))[margin : margin + len(is_loud)] > 0.5
            begin = int(np.argmax(moves)) if moves.any() else len(moves)
            stops = np.flatnonzero(~moves[begin : len(moves) - margin])  # later ones may yet move
            gained_mps = np.cumsum(self._accel_mps2[begin:], axis=0) / self._rate_hz
            if not len(stops):
                if begin > 2 * margin:
                    self._accel_mps2 = self._accel_mps2[begin - 2 * margin :]
                return np.asarray(gained_mps.sum(axis=0) / self._rate_hz)
            velocity_mps = gained_mps[: stops[0]]
            velocity_mps = velocity_mps - np.linspace(0.0, 1.0, stops[0])[:, None] * velocity_mps[-1]
            self._stood_m = np.concatenate(
                [self._stood_m, self._stood_m[-1:] + velocity_mps.sum(axis=0) / self._rate_hz]
            )
            self._accel_mps2 = self._accel_mps2[begin + stops[0] :]
