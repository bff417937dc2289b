"""What Köping et al. 2012 leave for the future: heading and speed in every particle (K11)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.sensors.position import PositionErrors
from pdrbench_baselines.koeping2012.localizer import DEBUG_PARTICLES, Clock, building_of, normalised
from pdrbench_baselines.koeping2012.movement_kernels import draw_sorted

WIDENINGS: Final = 8  # of the disc around an observation in which no floor is found
TRIES: Final = 8  # places drawn for each particle of a new cloud
MIN_ON_FLOOR: Final = 20  # of them on the floor, else the disc is widened


@dataclass(frozen=True, slots=True)
class KoepingHeadingParams:
    """The settings; those of the motion were chosen on the train and val walks of `BuildingSiteDrift-v1`.

    Attributes:
        num_particles: As many as the paper finds enough.
        sigma0_m: Offset of the observed position per axis, at the beginning.
        q_m2ps: Growth of its variance; what an observed displacement errs by.
        keeps_fraction: Of the seconds in which the walker keeps heading and speed.
        keeps_mps: By how much the velocity changes in one of those, per axis.
        anew_mps: Velocity per axis in the others: stopping, starting and turning, any heading.
    """

    num_particles: int = 2000  # [P] Fig. 2; ten times as many are no better
    sigma0_m: float = 0.3  # K5
    q_m2ps: float = 0.02  # K5
    keeps_fraction: float = 0.8  # ours; 0.6 to 0.95 are as good
    keeps_mps: float = 0.5  # ours; 0.3 to 0.8 are as good
    anew_mps: float = 1.0  # ours: walking speed in any direction

    def __post_init__(self) -> None:
        for name in ("num_particles", "sigma0_m", "q_m2ps", "keeps_mps", "anew_mps"):
            if not getattr(self, name) > 0:
                raise PdrbenchError(f"koeping2012_heading: {name} must be positive; got {getattr(self, name):g}")
        if not 0 <= self.keeps_fraction < 1:
            raise PdrbenchError(
                f"koeping2012_heading: keeps_fraction is 0 to 1, without 1; got {self.keeps_fraction:g}"
            )


KOEPING_HEADING: Final = KoepingHeadingParams()


class Koeping2012Heading:
    """Particles on a plan with heading and speed; walls end them, as in Woodman & Harle 2008.

    An inertial system that drifts has a wrong place but nearly right displacements: z_k - z_(k-1) is the displacement
    of the walker plus N(0, q dt) per axis, exactly so where its offset walks at random. That is a measurement of the
    velocity. The velocity of a particle goes on or is drawn anew,

        v_k ~ keeps_fraction N(v_(k-1), keeps^2) + (1 - keeps_fraction) N(0, anew^2),

    and since all is Gaussian, v_k is drawn from what prior and measurement say together and the particle weighed by
    how probable the measurement was (the optimal proposal). Particles that walk through a wall are dropped: offsets
    that lead through walls die out, which corrects the drift.

    The first observation is where the particles begin, within its error. A cloud without a survivor is drawn again
    around the observation, as wide as its error has grown, and `debug` counts that. Over a gap of more than one and a
    half updates walls between are not tested, since a walk is not that straight; particles have to end on the floor.
    Where an observation is so far from the floor that no place is found, the cloud begins on the whole floor. Levels
    are those of the floor reached; the sensor knows none.

    Args:
        params: See `KoepingHeadingParams`.
    """

    def __init__(self, params: KoepingHeadingParams = KOEPING_HEADING) -> None:
        self._params = params
        self._errors = PositionErrors(self._params.sigma0_m, self._params.q_m2ps)

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self._building, self._rng = building_of(briefing), rng
        rate_hz = briefing.sensors["position"].rate_hz
        self._clock = Clock(1.0 / rate_hz if rate_hz else briefing.period_s)
        self._seen: tuple[float, FloatArray] | None = None
        self._clouds = 0
        self._polygon: IntArray = np.zeros(0, dtype=np.int64)
        self._xy_m = self._mps = np.zeros((0, 2))
        centre = self._building.centre()
        self._estimate = Estimate(centre.xy_m, centre.level, sigma_m=centre.radius_m / 2)
        # Compiles, so that no observation waits for it.
        self._building.move(self._polygon, self._xy_m, self._xy_m)
        draw_sorted(np.ones(1), np.ones(2))

    def step(self, observation: Observation) -> Estimate:
        for t_s, x_m, y_m in self._clock.rows(observation["position"]):
            seen_m = np.array([x_m, y_m])
            weight = None if self._seen is None else self._walk(t_s - self._seen[0], seen_m - self._seen[1])
            if weight is None:
                weight = self._begin(seen_m, float(self._errors.sigma_m(np.array(t_s))))
            self._seen = t_s, seen_m
            self._estimate = self._locate(weight)
            drawn = draw_sorted(weight, self._rng.standard_exponential(len(weight) + 1))
            self._polygon, self._xy_m, self._mps = self._polygon[drawn], self._xy_m[drawn], self._mps[drawn]
        return self._estimate

    def debug(self) -> dict[str, NDArray[Any]]:
        """The particles after the draw, at most `DEBUG_PARTICLES`, and how often the cloud was drawn again."""
        shown = slice(None, None, max(-(-len(self._polygon) // DEBUG_PARTICLES), 1))
        count = len(self._polygon[shown])
        return {
            "particles_xy_m": self._xy_m[shown],
            "particles_level": self._building.level(self._polygon[shown]),
            "particles_polygon": self._polygon[shown],
            "particles_heading_rad": np.arctan2(self._mps[shown, 1], self._mps[shown, 0]),
            "particles_weight": np.full(count, 1.0 / max(count, 1)),
            "num_particles": np.array(len(self._polygon)),
            "deaths": np.array(max(self._clouds - 1, 0)),
        }

    def _begin(self, seen_m: FloatArray, sigma_m: float) -> FloatArray:
        """Draws a cloud around an observation, standing; equal weights."""
        count, self._clouds = self._params.num_particles, self._clouds + 1
        levels = np.array(self._building.levels)
        for widening in range(WIDENINGS):
            xy_m = seen_m + sigma_m * 2.0**widening * self._rng.standard_normal((TRIES * count, 2))
            polygon = self._building.locate(xy_m, self._rng.choice(levels, len(xy_m)))
            found = np.flatnonzero(polygon >= 0)
            if len(found) >= min(MIN_ON_FLOOR, count):
                drawn = self._rng.choice(found, count)
                self._polygon, self._xy_m = polygon[drawn], xy_m[drawn]
                break
        else:
            self._polygon, self._xy_m = self._building.sample_uniform(self._rng, count)
        self._mps = np.zeros((count, 2))
        return np.full(count, 1.0 / count)

    def _walk(self, dt_s: float, seen_m: FloatArray) -> FloatArray | None:
        """Moves every particle by its velocity and the displacement seen; weights, or None where none survives."""
        self._mps, log_weight = self._velocities(seen_m / dt_s, self._params.q_m2ps / dt_s)
        reached_m = self._xy_m + dt_s * self._mps
        if dt_s <= 1.5 * self._clock.update_s:
            polygon, alive = self._building.move(self._polygon, self._xy_m, reached_m)
        else:
            polygon = self._building.locate(reached_m, self._building.level(self._polygon))
            alive = polygon >= 0
        if not alive.any():
            return None
        self._polygon, self._xy_m = np.where(alive, polygon, self._polygon), reached_m
        return normalised(np.where(alive, log_weight, -np.inf))

    def _velocities(self, seen_mps: FloatArray, noise: float) -> tuple[FloatArray, FloatArray]:
        """(N, 2) velocities given one that was measured with that variance, and (N,) log-densities of measuring it."""
        p = self._params
        keeps_variance, anew_variance = p.keeps_mps**2, p.anew_mps**2
        with np.errstate(divide="ignore"):
            log_fraction = np.log([p.keeps_fraction, 1 - p.keeps_fraction])
        log_keeps = log_fraction[0] + _log_normal(seen_mps - self._mps, keeps_variance + noise)
        log_anew = log_fraction[1] + _log_normal(seen_mps[None], anew_variance + noise)
        log_weight = np.logaddexp(log_keeps, log_anew)
        keeps = np.log(self._rng.random(len(log_keeps))) < log_keeps - log_weight
        spread = np.where(keeps, keeps_variance, anew_variance)[:, None]
        before_mps = np.where(keeps[:, None], self._mps, 0.0)
        mean_mps = before_mps + spread / (spread + noise) * (seen_mps - before_mps)
        sigma_mps = np.sqrt(spread * noise / (spread + noise))
        return mean_mps + sigma_mps * self._rng.standard_normal(self._mps.shape), log_weight

    def _locate(self, weight: FloatArray) -> Estimate:
        """Weighted mean place and heading on the level that holds most weight."""
        of_level = self._building.level(self._polygon)
        levels, which = np.unique(of_level, return_inverse=True)
        level = int(levels[np.argmax(np.bincount(which, weights=weight))])
        on_level = np.where(of_level == level, weight, 0.0)
        on_level /= on_level.sum()
        mean_m = on_level @ self._xy_m
        sigma_m = float(np.sqrt(on_level @ ((self._xy_m - mean_m) ** 2).sum(axis=1) / 2))
        vx_mps, vy_mps = on_level @ self._mps
        heading_rad = float(np.arctan2(vy_mps, vx_mps)) if vx_mps or vy_mps else None
        return Estimate(mean_m, level, heading_rad=heading_rad, sigma_m=max(sigma_m, 1e-3))


def _log_normal(difference: FloatArray, variance: float) -> FloatArray:
    """(N,) log-density of (N, 2) differences, up to a common constant."""
    found: FloatArray = -0.5 * (difference**2).sum(axis=1) / variance - np.log(variance)
    return found
