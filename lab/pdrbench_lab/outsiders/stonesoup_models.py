"""What Stone Soup's particle filter needs to be given of a walker in a building: how strides move, how to resample."""

from __future__ import annotations

from datetime import datetime
from typing import Any

import numpy as np

from pdrbench.building import Building
from pdrbench.localizer import Estimate
from pdrbench_lab.outsiders.packages import outside

LENGTH_SIGMA_M = 0.15  # as the next, Woodman & Harle 2008, eq. 7 and 8
HEADING_SIGMA_RAD = np.radians(0.6)
OUTSIDE = -1.0
NUM_STATES = 5  # x, y, heading, floor polygon, rise of the last stride
NUM_PARTICLES = 2000  # ours


def stride_model(building: Building, rng: np.random.Generator) -> Any:
    """A control model: strides of length and turn move particles through floor polygons; walls end them."""
    types, base_model = outside("stonesoup.types.array"), outside("stonesoup.models.control.base").ControlModel

    class StrideModel(base_model):  # type: ignore[misc,valid-type]
        """Changes of the state (5, N) by a stride: turn first, then walk."""

        ndim_ctrl = 2

        def function(self, control_input: Any, prior: Any = None, noise: bool = False, **_: Any) -> Any:
            length_m, turn_rad = np.asarray(control_input.state_vector, dtype=float).ravel()
            x, y, heading, polygon, _ = state = np.asarray(prior.state_vector, dtype=float)
            draw = rng.standard_normal((2, len(x))) if noise else np.zeros((2, len(x)))
            headed = heading + turn_rad + HEADING_SIGMA_RAD * draw[0]
            walked_m = length_m + LENGTH_SIGMA_M * draw[1]
            end = np.array([x + walked_m * np.cos(headed), y + walked_m * np.sin(headed)])
            reached, is_alive = building.move(polygon.astype(int), state[:2].T, end.T)
            rise_m = building.height(reached) - building.height(polygon.astype(int))
            after = np.array([*end, headed, np.where(is_alive, reached, OUTSIDE), rise_m])
            return types.StateVectors(after - state)

        def rvs(self, num_samples: int = 1, **_: Any) -> Any:
            raise NotImplementedError("the noise of a stride depends on its length")

        def pdf(self, state1: Any, state2: Any, **_: Any) -> Any:
            raise NotImplementedError("a particle filter draws strides, and does not weigh them")

    return StrideModel()


def cloud_around(
    building: Building, rng: np.random.Generator, centre: Estimate, half_m: float, half_rad: float, timestamp: datetime
) -> Any:
    """Particles on the floor near an estimate, with headings around its own."""
    state, array = outside("stonesoup.types.state"), outside("stonesoup.types.array")
    assert centre.heading_rad is not None
    xy_m = centre.xy_m + rng.uniform(-half_m, half_m, (20 * NUM_PARTICLES, 2))
    polygon = building.locate(xy_m, centre.level)
    inside = rng.choice(np.flatnonzero(polygon >= 0), NUM_PARTICLES)
    heading_rad = centre.heading_rad + rng.uniform(-half_rad, half_rad, NUM_PARTICLES)
    states = array.StateVectors([*xy_m[inside].T, heading_rad, polygon[inside], np.zeros(NUM_PARTICLES)])
    return state.ParticleState(states, weight=np.full(NUM_PARTICLES, 1.0 / NUM_PARTICLES), timestamp=timestamp)


def resampler(rng: np.random.Generator) -> Any:
    """A systematic draw by `rng`; Stone Soup's own takes global random numbers."""
    base = outside("stonesoup.resampler").Resampler

    class SeededResampler(base):  # type: ignore[misc,valid-type]
        """Systematic resampling."""

        def resample(self, particles: Any, nparts: int | None = None) -> Any:
            count = nparts or len(particles)
            sums = np.cumsum(np.exp(np.asarray(particles.log_weight, dtype=float)))
            offsets = (rng.random() + np.arange(count)) / count * sums[-1]
            drawn = particles[np.searchsorted(sums, offsets, side="right")]
            drawn.log_weight = np.full(count, -np.log(count))
            return drawn

    return SeededResampler()
