"""`footslam`: strides and no plan; what was walked before is the map.

P. Robertson, M. Angermann, B. Krach, UbiComp 2009; see `pdrbench_lab.footslam.cloud`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench_lab.footslam.cloud import ADAPTIVE_FILTER, OdometryNoise, SlamCloud, SlamParams
from pdrbench_lab.footslam.odometry import StrideSensor, level_heights, odometry_of
from pdrbench_lab.footslam.warm import warm_up


@dataclass(frozen=True, slots=True)
class FootSlamParams:
    """Settings of `FootSlam`; see the records in it for their sources.

    Attributes:
        cloud: Particles and map.
        stride: Noise of the strides of the sensor `stride`.
        unit: Noise of the strides that the adaptive inertial filter makes of a unit on the foot.
        level_height_m: Rise that counts as a level where the briefing has no building.
        sigma_factor: By which the spread of the particles is multiplied for `sigma_m`.
        least_sigma_m: Of `sigma_m`.
        revises: Whether ways are kept, from which `revise` gives the past.
    """

    cloud: SlamParams = field(default_factory=SlamParams)
    stride: OdometryNoise = field(default_factory=OdometryNoise)
    unit: OdometryNoise = ADAPTIVE_FILTER
    level_height_m: float = 3.0  # as dead_reckoning
    sigma_factor: float = 0.9  # ours: walks through synthetic offices
    least_sigma_m: float = 0.05  # ours
    revises: bool = True


FOOTSLAM: Final = FootSlamParams()


class FootSlam:
    """Localises by strides and by a map of its own ways. Answers the mean of its particles.

    It reads no plan but for the heights of its levels, and those only for the number of the level, as
    `dead_reckoning` does. Levels have maps of their own: the level is the one whose height is nearest to that of all
    strides together, and a stride between two levels counts on the one where it ends.

    Without a heading of the start (a unit on the foot only) the frame is that of the first stride, and only aligned
    scores mean something.

    Args:
        params: See `FootSlamParams`; with `cloud.uses_map` false it is the odometry alone.
    """

    def __init__(self, params: FootSlamParams = FOOTSLAM) -> None:
        self._params = params

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self._odometry = odometry_of(briefing)
        warm_up()
        assert briefing.start is not None
        start, p = briefing.start, self._params
        noise = p.stride if isinstance(self._odometry, StrideSensor) else p.unit
        self._cloud = SlamCloud(start.xy_m, start.heading_rad or 0.0, noise, p.cloud, rng, remembers=p.revises)
        self._levels, self._height_m = level_heights(briefing, p.level_height_m)
        self._rise_m, self._num_strides = 0.0, 0
        self._mean = self._cloud.mean()
        self._answers: list[tuple[float, int, int, FloatArray]] = []

    def step(self, observation: Observation) -> Estimate:
        advance = self._odometry.update(observation)
        for _, length_m, height_m, turn_rad in advance.strides.tolist():
            self._rise_m += height_m
            self._cloud.stride(length_m, turn_rad, self._level)
            self._num_strides += 1
        if len(advance.strides):
            self._mean = self._cloud.mean()
        if self._params.revises:
            self._answers.append((observation.now_s, self._num_strides, self._level, advance.since_m))
        xy_m, heading_rad, sigma_m = self._placed(self._mean, advance.since_m)
        return Estimate(xy_m=xy_m, level=self._level, heading_rad=heading_rad, sigma_m=sigma_m)

    def revise(self) -> FloatArray | None:
        """(K, 5) t_s, x_m, y_m, level, sigma_m at the times of the answers; None where ways were not kept.

        The mean over the ways that led to the particles which are left, each with the weight that it has at the end.
        """
        if not self._params.revises:
            return None
        path = self._cloud.path()
        missing = self._num_strides + 1 - len(path)
        rows = []
        for t_s, stride, level, since_m in self._answers:
            if stride >= missing:
                xy_m, _, sigma_m = self._placed(path[stride - missing], since_m)
                rows.append([t_s, *xy_m, level, sigma_m])
        return np.array(rows, dtype=np.float64).reshape(-1, 5)

    def debug(self) -> dict[str, NDArray[Any]]:
        """The particles, and the map of the heaviest: hexagons (H, 3) q, r, level and counts (H, 6) by edge."""
        hexagon, counts = self._cloud.maps.known(self._cloud.best)
        return {
            "particles_xy_m": self._cloud.state[:, :2].copy(),
            "particles_level": np.full(len(self._cloud.state), self._level),
            "particles_weight": self._cloud.weight,
            "num_particles": np.array(len(self._cloud.state)),
            "hexagon": hexagon,
            "hexagon_counts": counts,
        }

    @property
    def _level(self) -> int:
        return int(self._levels[np.argmin(np.abs(self._height_m - self._rise_m))])

    def _placed(self, mean: tuple[FloatArray, float, float], since_m: FloatArray) -> tuple[FloatArray, float, float]:
        """Place of the foot now, heading and sigma, from those at the end of a stride."""
        xy_m, heading_rad, sigma_m = mean
        c, s = math.cos(heading_rad), math.sin(heading_rad)
        placed_m: FloatArray = xy_m + since_m @ np.array([[c, s], [-s, c]])
        p = self._params
        return placed_m, heading_rad, math.hypot(p.sigma_factor * sigma_m, p.least_sigma_m)
