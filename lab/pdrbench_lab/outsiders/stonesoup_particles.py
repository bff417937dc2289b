"""Stone Soup: its particle filter on the strides of a foot and a plan."""

from __future__ import annotations

from datetime import datetime, timedelta

import numpy as np

from pdrbench.errors import UnsuitableError
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench_lab.outsiders.packages import outside
from pdrbench_lab.outsiders.stonesoup_models import NUM_STATES, OUTSIDE, cloud_around, resampler, stride_model

RISE_SIGMA_M = 0.1  # Woodman & Harle 2008, eq. 16
START_M, START_RAD = 0.5, np.radians(5.0)  # as woodman2008: half widths of the first cloud
RESTART_M, RESTART_RAD = 3.0, np.pi
EPOCH = datetime(2000, 1, 1)  # Stone Soup has times of day


class StonesoupParticles:
    """Particles of Stone Soup's predictor and updater: strides are the control input, the rise is the measurement.

    Where every particle has hit a wall, a new cloud begins around the last answer, with all headings.
    """

    def __init__(self) -> None:
        self._types = {
            name: outside(f"stonesoup.types.{name}") for name in ("array", "detection", "hypothesis", "state")
        }
        self._linear = outside("stonesoup.models.transition.linear")
        self._measurement = outside("stonesoup.models.measurement.linear")
        self._predictor, self._updater = outside("stonesoup.predictor.particle"), outside("stonesoup.updater.particle")

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("stride",), start=True)
        if briefing.building is None or briefing.start is None or briefing.start.heading_rad is None:
            raise UnsuitableError("needs a plan and the heading of the start; this environment lacks one of them")
        self._building, self._rng, start = briefing.building, rng, briefing.start
        still = self._linear.LinearGaussianTimeInvariantTransitionModel(
            transition_matrix=np.eye(NUM_STATES), covariance_matrix=np.zeros((NUM_STATES, NUM_STATES))
        )
        self._predict = self._predictor.ParticlePredictor(
            still, control_model=stride_model(self._building, rng)
        ).predict
        rise = self._measurement.LinearGaussian(NUM_STATES, mapping=[4], noise_covar=np.array([[RISE_SIGMA_M**2]]))
        self._update = self._updater.ParticleUpdater(
            rise, resampler=resampler(rng), constraint_func=lambda state: np.asarray(state.state_vector[3]) == OUTSIDE
        ).update
        self._estimate = Estimate(start.xy_m, start.level, start.heading_rad)
        self._cloud = cloud_around(self._building, rng, self._estimate, START_M, START_RAD, EPOCH)

    def step(self, observation: Observation) -> Estimate:
        for t_s, length_m, height_m, turn_rad in observation["stride"].tolist():
            self._walk(t_s, length_m, height_m, turn_rad)
        return self._estimate

    def _walk(self, t_s: float, length_m: float, height_m: float, turn_rad: float) -> None:
        state, array = self._types["state"], self._types["array"]
        when = EPOCH + timedelta(seconds=t_s)
        stride = state.State(array.StateVector([length_m, turn_rad]))
        cloud = self._predict(self._cloud, timestamp=when, control_input=stride)
        if (np.asarray(cloud.state_vector[3]) == OUTSIDE).all():
            self._cloud = cloud_around(self._building, self._rng, self._estimate, RESTART_M, RESTART_RAD, when)
            return
        seen = self._types["detection"].Detection(array.StateVector([height_m]), timestamp=when)
        self._cloud = self._update(self._types["hypothesis"].SingleHypothesis(cloud, seen))
        self._cloud.parent = self._cloud.hypothesis = None  # else every cloud of the walk is kept
        self._answer()

    def _answer(self) -> None:
        """The mean of the particles on the level of most; all weigh the same."""
        x_m, y_m, heading_rad, polygon, _ = np.asarray(self._cloud.state_vector, dtype=float)
        level = self._building.level(polygon.astype(int))
        most = int(np.argmax(np.bincount(level - level.min())) + level.min())
        on = level == most
        towards = float(np.angle(np.exp(1j * heading_rad[on]).sum()))
        self._estimate = Estimate(np.array([x_m[on].mean(), y_m[on].mean()]), most, towards)
