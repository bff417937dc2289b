"""`learned-v0` to `-v2`: dead reckoning by a network. `learned_map-v0` to `-v2`: the same on a map."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.inertial import WAYS
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.params import merged
from pdrbench_baselines.backward import BackwardSampler, StoredCloud, Transition, gaussian
from pdrbench_baselines.learned.attitude_sources import FOOT, PHONE, carrier_of
from pdrbench_baselines.learned.map_filter import LearnedMapFilter, LearnedMapFilterParams
from pdrbench_baselines.learned.reckoning import EVERY_S, Move, Reckoner, WindowNetwork
from pdrbench_baselines.learned.signals import turned
from pdrbench_baselines.learned.weight_files import PACKAGED
from pdrbench_baselines.learned.wlan import ScanLocator, ScanPlaces

if TYPE_CHECKING:
    from pdrbench_baselines.learned.model import Network

BY_LIFT = float(WAYS.index("lift"))
SMOOTHED_CLAIM = 1.25  # of lines, over that of clouds: on 40 train walks of MallPhone-v2 95 % discs hold 92 % with 1.0
LEVEL_HEIGHT_M = 3.0  # rise that counts as a level, as foot_ins-v0
INSTALL = "pip install 'pdrbench[learned]'"


@dataclass(frozen=True, slots=True)
class LearnedParams:
    """Defaults of both localizers; all ours. For a foot `ON_FOOT` says otherwise.

    Attributes:
        weights: Name of weights that come with pdrbench, or the file of a training run.
        stand_logit: Of the network, above which the walker is taken to stand.
        carry_s: Between seconds the answer goes on at the last velocity, so long at most.
        scale_sigma: Fraction of the way by which lengths are off for a whole walk, for the sigma of dead reckoning.
        heading_sigma_rad: By which headings are off for a whole walk, likewise.
        doubted_mps: Standard deviation of the speed where a network fully doubts its input, the same all along.
        error_correlation: The variance of the sum of seconds is so many times the sum of their variances, likewise.
        one_place_m: Particles that spread less are in one place, for `converged` after an unknown start.
        cloud_claim: By which the spread of particles is multiplied for the claim: what is wrong with a map, or with all
            of them alike, does not spread them.
        map: Of the particle filter.
    """

    weights: str = "learned-v0"
    stand_logit: float = 0.0
    carry_s: float = 1.2
    scale_sigma: float = 0.05
    heading_sigma_rad: float = math.radians(14.0)  # 11 degrees of the phone (sources.md 1.5), the rest ours
    doubted_mps: float = 0.7  # ours: of a trolley all that is known is that it goes at less than walkers do
    error_correlation: float = 3.0  # on MallPhone-v2 95 % discs hold 86 % (train) and 98 % (val)
    one_place_m: float = 2.0
    cloud_claim: float = 1.7  # 85 and 98 % there
    map: LearnedMapFilterParams = field(default_factory=LearnedMapFilterParams)


# On 12 train and 8 val walks of OfficeFoot-v2 discs of 50, 90, 95 % of learned-v0 hold 73, 93, 95 %; the errors of
# a person's length and of the heading were measured on training people (1 %, 2 to 5 degrees in 110 s).
ON_FOOT = LearnedParams(
    weights="learned_foot-v0",
    scale_sigma=0.012,
    heading_sigma_rad=math.radians(3.0),
    error_correlation=1.0,
    map=LearnedMapFilterParams(scale_sigma=0.015, bias_sigma_rad=math.radians(4.0), bias_walk_rad=math.radians(0.5)),
)
DEFAULTS = {PHONE: LearnedParams(), FOOT: ON_FOOT}
TRANSFERRED = {PHONE: LearnedParams(weights="learned-v2"), FOOT: ON_FOOT}
RETRAINED = {PHONE: LearnedParams(weights="learned-v1"), FOOT: ON_FOOT}


class Learned:
    """Adds up the displacements of the network, second by second, from a known start.

    Needs accelerometer, gyroscope and rotation vector of a phone at 20 Hz or more, or accelerometer and gyroscope of a
    unit on a foot at 80 Hz or more; each has a network of its own. From `learned-v2` on a magnetometer or the heading
    of the start does in place of the rotation vector. On a foot the level follows the height that the
    error-state filter gives. Where samples are missing for longer
    than a quarter of a second the last displacement goes on, halved with every second.

    Args:
        params: `LearnedParams` or some of its fields.
        defaults: What they change, for a phone and for a foot.
        load: Gives the network of a name or in a file; None for `load_network`, which needs torch.
    """

    def __init__(
        self,
        params: LearnedParams | Mapping[str, Any] | None = None,
        *,
        defaults: Mapping[str, LearnedParams] = DEFAULTS,
        load: Callable[[str], WindowNetwork] | None = None,
    ) -> None:
        self._params_of = {carried: merged(usual, params, "learned") for carried, usual in defaults.items()}
        self._networks: dict[str, WindowNetwork] = {}
        if load is None:
            _reader()  # imports torch now rather than on the first walk, or raises what is missing
        self._load = load or load_network
        for weights in {each.weights for each in self._params_of.values()} - set(PACKAGED):
            self._network(weights)

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(start=True)
        assert briefing.start is not None
        self._begin(briefing)
        self._xy_m, self._level = np.array(briefing.start.xy_m), briefing.start.level
        self._start_m = self._xy_m.copy()
        self._doubted_m = 0.0
        self._spread_m2 = max(briefing.start.radius_m / 2, self._params.map.start_sigma_m) ** 2

    def step(self, observation: Observation) -> Estimate:
        for move in self._reckoner.update(observation.rows):
            self._xy_m = self._xy_m + move.move_m
            self._spread_m2 += self._params.error_correlation * float(np.trace(move.covariance_m2)) / 2
            self._doubted_m += self._params.doubted_mps * EVERY_S * move.doubt
            self._follow(move.move_m, move.end_s)
        if self._has_level_changes:
            self._level += int(observation["level_change"][:, 1].sum())
        away_m2 = float(np.sum((self._xy_m - self._start_m) ** 2))
        share2 = (self._params.scale_sigma**2 + self._params.heading_sigma_rad**2) / 2
        return Estimate(
            xy_m=self._xy_m + self._extrapolated_m(observation.now_s),
            level=self._level + round(self._reckoner.rise_m / LEVEL_HEIGHT_M),
            heading_rad=self._heading_rad,
            sigma_m=math.sqrt(self._spread_m2 + share2 * away_m2 + self._doubted_m**2),
        )

    def _begin(self, briefing: Briefing) -> None:
        """What both localizers begin with."""
        self._params = self._params_of[carrier_of(briefing.mounting)]
        network = self._network(self._params.weights)
        has_heading = briefing.start is not None and briefing.start.heading_rad is not None
        if network.own_attitude and not has_heading and not {"rotation", "mag"} & set(briefing.sensors):
            raise UnsuitableError("needs a rotation vector, a magnetometer or the heading of the start")
        self._reckoner = self._new_reckoner(network, briefing)
        self._velocity_mps, self._end_s = np.zeros(2), -math.inf
        self._heading_rad = briefing.start.heading_rad if briefing.start is not None else None
        # A foot knows its own height.
        self._has_level_changes = "level_change" in briefing.sensors and carrier_of(briefing.mounting) == PHONE

    def _new_reckoner(self, network: WindowNetwork, briefing: Briefing) -> Reckoner:
        return Reckoner(network, briefing, self._params.stand_logit)

    def _network(self, weights: str) -> WindowNetwork:
        if weights not in self._networks:
            self._networks[weights] = self._load(weights)
        return self._networks[weights]

    def _follow(self, move_m: FloatArray, end_s: float) -> None:
        self._velocity_mps, self._end_s = move_m, end_s
        if np.hypot(*move_m) > 0.2:
            self._heading_rad = float(np.arctan2(move_m[1], move_m[0]))

    def _extrapolated_m(self, now_s: float) -> FloatArray:
        """(2,) how far the walker has come since the last second with an output."""
        since_s = now_s - self._end_s
        carried: FloatArray = self._velocity_mps * min(since_s, self._params.carry_s)
        return carried if math.isfinite(since_s) else np.zeros(2)


class LearnedMap(Learned):
    """The same on a map: its displacements and their covariance drive particles that walls kill.

    Where the level has a radio survey, scans choose between them. The start may be unknown then: the first scan
    gives one, and until it comes the answer is the middle of the survey.

    Args:
        params: `LearnedParams` or some of its fields.
    """

    def __init__(
        self,
        params: LearnedParams | Mapping[str, Any] | None = None,
        *,
        defaults: Mapping[str, LearnedParams] = DEFAULTS,
    ) -> None:
        super().__init__(params, defaults=defaults)
        self._survey: ScanLocator | None = None

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        if briefing.building is None:
            raise UnsuitableError("needs a map; this environment has none, learned-v0 goes without")
        self._begin(briefing)
        self._survey = self._surveyed(briefing)
        start, survey = briefing.start, self._survey
        if start is None and survey is None:
            raise UnsuitableError("needs a known start, or a radio map and the sensor 'wifi' to find one")
        self._building, self._rng, self._start_is_known = briefing.building, rng, start is not None
        is_surveyed = survey is not None and survey.radio_map.surveyed
        self._trust = self._params.map.scan_trust if is_surveyed else self._params.map.drawn_trust
        # a survey of interpolated places is off by more than a walk from a known start
        self._may_be_lost = start is None or is_surveyed
        self._filter: LearnedMapFilter | None = None
        if start is not None:
            self._filter = self._new_filter(start.level)
            self._filter.begin_near(np.array(start.xy_m), start.radius_m)
            if self._has_level_changes:
                self._filter.follow_levels(briefing.building, start.level)
        elif survey is not None:
            middle = survey.middle()
            self._xy_m, self._level = middle.xy_m, middle.level

    def step(self, observation: Observation) -> Estimate:
        for move in self._reckoner.update(observation.rows):
            if self._filter is not None:
                self._walk(self._filter, move)
        if self._survey is not None:
            for places in self._survey.update(observation["wifi"]):
                self._receive(places)
        cloud = self._filter
        if self._has_level_changes and cloud is not None and self._start_is_known:
            for _, levels, _, way in observation["level_change"].tolist():
                cloud.change_level(int(levels), by_lift=way == BY_LIFT)
        if cloud is None:
            return Estimate(xy_m=self._xy_m, level=self._level, converged=False)
        return Estimate(
            xy_m=cloud.xy_m + self._extrapolated_m(observation.now_s),
            level=cloud.level,
            heading_rad=self._heading_rad,
            sigma_m=self._params.cloud_claim * cloud.sigma_m,
            converged=None if self._start_is_known else cloud.sigma_m <= self._params.one_place_m,
        )

    def debug(self) -> dict[str, NDArray[Any]]:
        """Particles, how often all died, the mean factor on lengths and the mean error of headings."""
        return debug_of(self._filter)

    def _new_filter(self, level: int) -> LearnedMapFilter:
        """Particles for a walk that begins on a level."""
        return LearnedMapFilter(self._building, self._rng, self._params.map, level)

    def _surveyed(self, briefing: Briefing) -> ScanLocator | None:
        """The survey of a briefing; the one of the walk before where that is the same."""
        radio_map = briefing.radio_map
        if radio_map is None or not len(radio_map.age_s) or "wifi" not in briefing.sensors:
            return None
        if self._survey is None or self._survey.radio_map is not radio_map:
            return ScanLocator(radio_map, briefing.sensors["wifi"])
        self._survey.forget()
        return self._survey

    def _walk(self, cloud: LearnedMapFilter, move: Move) -> None:
        if not move.stands:
            cloud.move(move.move_m, move.covariance_m2)
        self._follow(cloud.mean_scale * turned(move.move_m, cloud.mean_bias_rad), move.end_s)

    def _receive(self, places: ScanPlaces) -> None:
        """Begins where the first scan was received; later ones weigh particles, where their level is surveyed."""
        if self._filter is None:
            self._filter = self._new_filter(places.likeliest_level)
            self._filter.begin_among(places)
        elif self._survey is not None and self._filter.level in self._survey.levels:
            self._filter.weigh(places, trust=self._trust, may_be_lost=self._may_be_lost)


class LearnedMapSmoothed(LearnedMap):
    """The same, its past revised when the walk is over (offline division) by lines through its clouds.

    Answers on the way are those of `LearnedMap`. Between two clouds a particle keeps its factor on lengths and its
    error of headings but for what renewal changes; on top of the covariance of the network a place may be off by the
    jitter of renewal.
    """

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        super().reset(briefing, rng)
        self._past = BackwardSampler()
        if self._filter is not None:
            self._past.follow(stored(self._filter, 0.0), 0.0)

    def step(self, observation: Observation) -> Estimate:
        self._now_s = observation.now_s
        estimate = super().step(observation)
        if self._has_level_changes and len(observation["level_change"]) and self._filter is not None:
            self._past.amend(stored(self._filter, self._now_s))
        return self._past.answered(observation.now_s, estimate)

    def revise(self) -> FloatArray:
        """(K, 5) t_s, x_m, y_m, level, sigma_m at the times of the answers."""
        (rng,) = self._rng.spawn(1)
        claim = SMOOTHED_CLAIM * self._params.cloud_claim
        return self._past.revised(rng, claim=claim)

    def _walk(self, cloud: LearnedMapFilter, move: Move) -> None:
        super()._walk(cloud, move)
        if not move.stands:
            self._past.follow(stored(cloud, move.end_s), move.end_s - EVERY_S, motion_of(move, self._params.map))

    def _receive(self, places: ScanPlaces) -> None:
        begins = self._filter is None
        super()._receive(places)
        assert self._filter is not None
        if begins:
            self._past.follow(stored(self._filter, self._now_s), self._now_s)
        else:
            self._past.amend(stored(self._filter, self._now_s))


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


def retrained(params: Mapping[str, Any] | None = None) -> Learned:
    """`learned-v0` with a network that learned from all train sessions of `MallPhone-v2` as well."""
    return Learned(params, defaults=RETRAINED)


def retrained_map(params: Mapping[str, Any] | None = None) -> LearnedMap:
    """`learned_map-v0` with the network of `learned-v1`."""
    return LearnedMap(params, defaults=RETRAINED)


def transferred(params: Mapping[str, Any] | None = None) -> Learned:
    """`learned-v1` with a network whose lengths are step rates times bounded steps; see `gait`."""
    return Learned(params, defaults=TRANSFERRED)


def transferred_map(params: Mapping[str, Any] | None = None) -> LearnedMap:
    """`learned_map-v1` with the network of `learned-v2`."""
    return LearnedMap(params, defaults=TRANSFERRED)


def smoothed_map(params: Mapping[str, Any] | None = None) -> LearnedMapSmoothed:
    """`learned_map-v1` with its past revised at the end (offline division)."""
    return LearnedMapSmoothed(params, defaults=RETRAINED)


def load_network(weights: str = "learned-v2") -> Network:
    """The network of a name or in a file; one that comes with pdrbench is known by its hash.

    Raises:
        UnsuitableError: torch or safetensors is not installed: nothing to score, so that a sweep goes on without.
        DatasetError: The file is not what it should be.
    """
    reader = _reader()
    network: Network = reader.packaged(weights) if weights in reader.PACKAGED else reader.restore(Path(weights))
    return network


def _reader() -> ModuleType:
    """What reads weights, and needs torch."""
    try:
        import pdrbench_baselines.learned.weights as weights
    except ModuleNotFoundError as error:
        raise UnsuitableError(
            f"needs {error.name}: run `{INSTALL}`; a folder of results keeps what was declined, so take a new one then"
        ) from error
    return weights
