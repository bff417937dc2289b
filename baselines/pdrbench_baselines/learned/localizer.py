"""`learned`: dead reckoning by a network. `learned_map`: the same on a map."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench_baselines.backward import BackwardSampler, StoredCloud, Transition, gaussian
from pdrbench_baselines.learned.attitude_sources import PHONE
from pdrbench_baselines.learned.base import BY_LIFT, CARRY_S, NetworkLocalizer
from pdrbench_baselines.learned.map_filter import LearnedMapFilter, LearnedMapFilterParams
from pdrbench_baselines.learned.reckoning import EVERY_S, Move
from pdrbench_baselines.learned.signals import turned
from pdrbench_baselines.learned.wlan import ScanLocator, ScanPlaces

LEVEL_HEIGHT_M: Final = 3.0  # rise that counts as a level, as foot_ins


@dataclass(frozen=True, slots=True)
class ReckoningErrors:
    """By how much dead reckoning is off, for `sigma_m`; ours.

    Attributes:
        scale_sigma: Of lengths, for a whole walk, as a fraction.
        heading_sigma_rad: Of headings, for a whole walk.
        error_correlation: The variance of the sum of seconds is so many times the sum of their variances.
    """

    scale_sigma: float = 0.05
    heading_sigma_rad: float = math.radians(14.0)  # 11 degrees of the phone (sources.md 1.5), the rest ours
    error_correlation: float = 3.0  # on recorded mall walks 95 % discs hold 86 % (train) and 98 % (val)


# On 12 train and 8 val walks of simulated feet discs of 50, 90, 95 % hold 73, 93, 95 %; the errors of a person's length
# and of the heading were measured on training people (1 %, 2 to 5 degrees in 110 s).
FOOT_ERRORS: Final = ReckoningErrors(scale_sigma=0.012, heading_sigma_rad=math.radians(3.0), error_correlation=1.0)


@dataclass(frozen=True, slots=True)
class LearnedParams:
    """Settings of `Learned`; all ours.

    Attributes:
        weights: File of a training run; None for the networks that come with pdrbench.
        carry_s: Between seconds the answer goes on at the last velocity, so long at most.
        doubted_mps: Standard deviation of the speed where a network fully doubts its input, the same all along.
        start_sigma_m: Spread around a start, per axis, at least.
        companions: Packaged networks with whose displacements those of the network for phones that comes with pdrbench
            are averaged, see `Reckoner`.
        phone: Errors of a phone.
        foot: Errors of a unit on a foot.
    """

    weights: str | None = None
    carry_s: float = CARRY_S
    doubted_mps: float = 0.7  # of a trolley all that is known is that it goes at less than walkers do
    start_sigma_m: float = 0.5
    companions: tuple[str, ...] = ("phone_plain",)
    phone: ReckoningErrors = field(default_factory=ReckoningErrors)
    foot: ReckoningErrors = FOOT_ERRORS


@dataclass(frozen=True, slots=True)
class LearnedMapParams:
    """Settings of `LearnedMap`; all ours.

    Attributes:
        weights: File of a training run; None for the networks that come with pdrbench.
        carry_s: Between seconds the answer goes on at the last velocity, so long at most.
        one_place_m: Particles that spread less are in one place, for `converged` after an unknown start.
        sigma_factor: On the spread of particles, for `sigma_m`: what is wrong with a map, or with all of them alike,
            does not spread them. 95 % discs of recorded mall walks hold 85 (train) and 98 % (val).
        revised_sigma_factor: On the spread of lines through the past; on 40 train walks 95 % discs hold 92 % with 1.7.
        phone: Particles for a phone.
        foot: Particles for a unit on a foot.
    """

    weights: str | None = None
    carry_s: float = CARRY_S
    one_place_m: float = 2.0
    sigma_factor: float = 1.7
    revised_sigma_factor: float = 2.125
    phone: LearnedMapFilterParams = field(default_factory=LearnedMapFilterParams)
    foot: LearnedMapFilterParams = field(
        default_factory=lambda: LearnedMapFilterParams(
            scale_sigma=0.015, bias_sigma_rad=math.radians(4.0), bias_walk_rad=math.radians(0.5)
        )
    )


LEARNED: Final = LearnedParams()
LEARNED_MAP: Final = LearnedMapParams()


class Learned(NetworkLocalizer):
    """Adds up the displacements of the network, second by second, from a known start.

    Needs accelerometer and gyroscope of a phone at 20 Hz or more, with a rotation vector, a magnetometer or the heading
    of the start, or accelerometer and gyroscope of a unit on a foot at 80 Hz or more; each has a network of its own. On
    a foot the level follows the height that the error-state filter gives.

    Args:
        params: See `LearnedParams`.
    """

    def __init__(self, params: LearnedParams = LEARNED) -> None:
        super().__init__(params.weights, params.carry_s)
        self._params = params

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(start=True)
        assert briefing.start is not None
        p = self._params
        self._begin(briefing, companions=p.companions if briefing.carrier == PHONE and p.weights is None else ())
        self._errors = p.phone if briefing.carrier == PHONE else p.foot
        self._xy_m, self._level = np.array(briefing.start.xy_m), briefing.start.level
        self._start_m = self._xy_m.copy()
        self._doubted_m = 0.0
        self._spread_m2 = max(briefing.start.radius_m / 2, p.start_sigma_m) ** 2

    def step(self, observation: Observation) -> Estimate:
        errors = self._errors
        for move in self._reckoner.update(observation.rows):
            self._xy_m = self._xy_m + move.move_m
            self._spread_m2 += errors.error_correlation * float(np.trace(move.covariance_m2)) / 2
            self._doubted_m += self._params.doubted_mps * EVERY_S * move.doubt
            self._follow(move.move_m, move.end_s)
        if self._has_level_changes:
            self._level += int(observation["level_change"][:, 1].sum())
        away_m2 = float(np.sum((self._xy_m - self._start_m) ** 2))
        fraction2 = (errors.scale_sigma**2 + errors.heading_sigma_rad**2) / 2
        return Estimate(
            xy_m=self._xy_m + self._extrapolated_m(observation.now_s),
            level=self._level + round(self._reckoner.rise_m / LEVEL_HEIGHT_M),
            heading_rad=self._heading_rad,
            sigma_m=math.sqrt(self._spread_m2 + fraction2 * away_m2 + self._doubted_m**2),
        )


class LearnedMap(NetworkLocalizer):
    """Particles on the plan that follow the displacements of `learned` and their covariance.

    Where the level has a radio survey, scans choose between them. The start may be unknown then: the first scan
    gives one, and until it comes the answer is the middle of the survey.

    `revise` gives the past by lines through the clouds. Between two clouds a particle keeps its factor on lengths and
    its error of headings but for what renewal changes; on top of the covariance of the network a place may be off by
    the jitter of renewal.

    Args:
        params: See `LearnedMapParams`.
    """

    def __init__(self, params: LearnedMapParams = LEARNED_MAP) -> None:
        super().__init__(params.weights, params.carry_s)
        self._params = params
        self._survey: ScanLocator | None = None

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        if briefing.building is None:
            raise UnsuitableError("needs a map; this environment has none, learned goes without")
        self._begin(briefing)
        self._map_params = self._params.phone if briefing.carrier == PHONE else self._params.foot
        self._survey = self._surveyed(briefing)
        start, survey = briefing.start, self._survey
        if start is None and survey is None:
            raise UnsuitableError("needs a known start, or a radio map and the sensor 'wifi' to find one")
        self._building, self._rng, self._start_is_known = briefing.building, rng, start is not None
        is_surveyed = survey is not None and survey.radio_map.surveyed
        self._trust = self._map_params.scan_trust if is_surveyed else self._map_params.drawn_trust
        # a survey of interpolated places is off by more than a walk from a known start
        self._may_be_lost = start is None or is_surveyed
        self._filter: LearnedMapFilter | None = None
        self._past = BackwardSampler()
        self._now_s = 0.0
        if start is not None:
            self._filter = self._new_filter(start.level)
            self._filter.begin_near(np.array(start.xy_m), start.radius_m)
            if self._has_level_changes:
                self._filter.follow_levels(briefing.building, start.level)
            self._past.follow(stored(self._filter, 0.0), 0.0)
        elif survey is not None:
            middle = survey.middle()
            self._xy_m, self._level = middle.xy_m, middle.level

    def step(self, observation: Observation) -> Estimate:
        self._now_s = observation.now_s
        for move in self._reckoner.update(observation.rows):
            if self._filter is not None:
                self._walk(self._filter, move)
        if self._survey is not None:
            for places in self._survey.update(observation["wifi"]):
                self._receive(places)
        if self._has_level_changes and self._start_is_known and self._filter is not None:
            self._change_levels(self._filter, observation["level_change"])
        return self._past.answered(observation.now_s, self._estimate())

    def revise(self) -> FloatArray:
        """(K, 5) t_s, x_m, y_m, level, sigma_m at the times of the answers."""
        (rng,) = self._rng.spawn(1)
        return self._past.revised(rng, claim=self._params.revised_sigma_factor)

    def debug(self) -> dict[str, NDArray[Any]]:
        """Particles, how often all died, the mean factor on lengths and the mean error of headings."""
        return debug_of(self._filter)

    def _new_filter(self, level: int) -> LearnedMapFilter:
        """Particles for a walk that begins on a level."""
        return LearnedMapFilter(self._building, self._rng, self._map_params, level)

    def _surveyed(self, briefing: Briefing) -> ScanLocator | None:
        """The survey of a briefing; the one of the walk before where that is the same."""
        radio_map = briefing.radio_map
        if radio_map is None or not len(radio_map.age_s) or "wifi" not in briefing.sensors:
            return None
        if self._survey is None or self._survey.radio_map is not radio_map:
            return ScanLocator(radio_map, briefing.sensors["wifi"])
        self._survey.forget()
        return self._survey

    def _estimate(self) -> Estimate:
        cloud = self._filter
        if cloud is None:
            return Estimate(xy_m=self._xy_m, level=self._level, converged=False)
        return Estimate(
            xy_m=cloud.xy_m + self._extrapolated_m(self._now_s),
            level=cloud.level,
            heading_rad=self._heading_rad,
            sigma_m=self._params.sigma_factor * cloud.sigma_m,
            converged=None if self._start_is_known else cloud.sigma_m <= self._params.one_place_m,
        )

    def _walk(self, cloud: LearnedMapFilter, move: Move) -> None:
        if not move.stands:
            cloud.move(move.move_m, move.covariance_m2)
            motion = motion_of(move, self._map_params)
            self._past.follow(stored(cloud, move.end_s), move.end_s - EVERY_S, motion)
        self._follow(cloud.mean_scale * turned(move.move_m, cloud.mean_bias_rad), move.end_s)

    def _receive(self, places: ScanPlaces) -> None:
        """Begins where the first scan was received; later ones weigh particles, where their level is surveyed."""
        if self._filter is None:
            self._filter = self._new_filter(places.likeliest_level)
            self._filter.begin_among(places)
            self._past.follow(stored(self._filter, self._now_s), self._now_s)
            return
        if self._survey is not None and self._filter.level in self._survey.levels:
            self._filter.weigh(places, trust=self._trust, may_be_lost=self._may_be_lost)
        self._past.amend(stored(self._filter, self._now_s))

    def _change_levels(self, cloud: LearnedMapFilter, changes: FloatArray) -> None:
        for _, levels, _, way in changes.tolist():
            cloud.change_level(int(levels), by_lift=way == BY_LIFT)
        if len(changes):
            self._past.amend(stored(cloud, self._now_s))


def debug_of(cloud: LearnedMapFilter | None) -> dict[str, NDArray[Any]]:
    """What `debug` says of particles; None before there are any."""
    if cloud is None:
        return {"num_particles": np.array(0)}
    return {
        "particles_xy_m": cloud.particles_xy_m,
        "particles_level": cloud.particles_level,
        "num_particles": np.array(cloud.num_particles),
        "resets": np.array(cloud.resets),
        "scale": np.array(cloud.mean_scale),
        "bias_rad": np.array(cloud.mean_bias_rad),
    }


def stored(cloud: LearnedMapFilter, t_s: float) -> StoredCloud:
    """Particles as backward sampling takes them: place, logarithm of the factor on lengths, error of the heading."""
    state = np.column_stack([cloud.particles_xy_m, np.log(cloud.scale), cloud.bias_rad])
    weight = np.ones(len(state))
    return StoredCloud(t_s, state, cloud.particles_level, cloud.particles_cell, weight, cloud.line_check())


def motion_of(move: Move, params: LearnedMapFilterParams, turn_rad: float = 0.0) -> Transition:
    """The motion of particles in a second, with the jitter that renewal adds to their state.

    Errors of headings are less by `turn_rad` from that second on.
    """
    p = params
    covariance = np.diag(np.square([p.near_m, p.near_m, p.scale_sigma / 4, p.bias_walk_rad + p.bias_sigma_rad / 6]))
    covariance[:2, :2] += move.covariance_m2

    def expected(state: FloatArray) -> FloatArray:
        log_scale, bias_rad = state[:, 2], state[:, 3] - turn_rad
        cosine, sine = np.cos(bias_rad), np.sin(bias_rad)
        (x_m, y_m), scale = move.move_m, np.exp(log_scale)
        steps = np.column_stack([cosine * x_m - sine * y_m, sine * x_m + cosine * y_m]) * scale[:, None]
        return np.column_stack([state[:, :2] + steps, log_scale, bias_rad])

    return gaussian(expected, covariance)
