"""`fusion`: everything a phone and a survey give, in one filter with a cloud for every level."""

from __future__ import annotations

import math
import warnings
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.building import Building
from pdrbench.errors import RecordingWarning, UnsuitableError
from pdrbench.filters import level_map
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.radio import middle_of_survey
from pdrbench.recording import RadioMap
from pdrbench.trajectory import Start
from pdrbench_baselines.backward import NUM_LINES, BackwardSampler, Transition, mean_of
from pdrbench_baselines.foot_ins.localizer import FootInsRobust
from pdrbench_baselines.fusion.cloud import Cloud
from pdrbench_baselines.fusion.compass import CompassMean
from pdrbench_baselines.fusion.lost import ScanBelief
from pdrbench_baselines.fusion.middle import geometric_median
from pdrbench_baselines.fusion.open_space import MARGIN_M, open_space
from pdrbench_baselines.fusion.params import FUSION, FusionParams, ScanTrustParams
from pdrbench_baselines.fusion.radio import ELSEWHERE, RadioEvidence, fraction_off_survey
from pdrbench_baselines.fusion.shoe import ShoeReckoner
from pdrbench_baselines.gp_wifi.fingerprints import FingerprintEvidence
from pdrbench_baselines.learned.attitude_sources import FOOT, PHONE
from pdrbench_baselines.learned.base import BY_LIFT, NetworkLocalizer
from pdrbench_baselines.learned.map_filter import LearnedMapFilterParams, debug_of, motion_of, stored
from pdrbench_baselines.learned.reckoning import EVERY_S, Move
from pdrbench_baselines.learned.signals import turned

KEPT_DOUBT: Final = 0.9  # of doubts of a plan, from one second to the next
OFF_FLOOR_M: Final = 1.0  # a start farther than that off the floor of a plan is not on that plan
MIN_FREE: Final = 1e-4  # of the particles, that walls let through, for its logarithm
MAX_WORK: Final = 2e7  # of fitting fields in a step: 0.15 s; a first scan in one of the malls has nine times that
MIN_OFFSET: Final = 0.01  # an offset of the device that fewer particles have is left out


@dataclass(slots=True, eq=False)
class Hypothesis:
    """A cloud and its past."""

    cloud: Cloud
    past: BackwardSampler
    follows_levels: bool  # by changes of pressure; else the plan says how particles get to other levels
    floor: Building  # that it walks on


class Fusion(NetworkLocalizer):
    """Phone with WLAN, and a plan where there is one: `learned` displacements, `gp_wifi` and particles for every level.

    Needs what `learned` needs, and a known start or a radio survey with WLAN. Without a plan floors are open, and
    people are likelier to walk where the survey was walked. Where the start is not known, the first scan puts a
    cloud on every level that the map does not join, by the radio map of `gp_wifi`; each scan says how likely each
    cloud is, and the answer is that of the likeliest: the mean of its particles where the start is known, else their
    geometric median. `revise` gives the past by lines through its clouds. Where walls stop nearly all particles again
    and again, the plan, or the start on it, is wrong, and a cloud that walks in open space since the start goes on in
    its place: `debug` says so. Where scans have a phone's bearer somewhere else, half of the cloud is put there.

    Displacements of a unit on a foot are those of `foot_ins_robust`, which answers alone where there is no plan; a
    known start takes no scans, which err by more than a shoe.

    Args:
        params: See `FusionParams`.
    """

    leaves_plans: ClassVar[bool] = True  # where they are wrong

    def __init__(self, params: FusionParams = FUSION) -> None:
        super().__init__()
        self._own = params
        self._radio: RadioEvidence | None = None
        self._lost: ScanBelief | None = None
        self._shoe: ShoeReckoner | None = None
        self._alone: FootInsRobust | None = None

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        own, start = self._own, briefing.start
        self._radio = radio = self._fitted(briefing)
        if start is None and radio is None:
            raise UnsuitableError("needs a known start, or a radio map and the sensor 'wifi' to find one")
        self._alone = None
        if briefing.carrier == FOOT and briefing.building is None and radio is None:
            self._alone = FootInsRobust()
            self._alone.reset(briefing, rng)
            return
        is_known_phone = start is not None and briefing.carrier == PHONE
        is_interpolated = briefing.radio_map is not None and not briefing.radio_map.surveyed
        factor = own.interpolated_length_factor if is_known_phone and is_interpolated else 1.0
        self._building, self._rng = briefing.building or open_space(briefing.radio_map, start), rng
        self._compass, self._map_params, self._lost, self._shoe = None, own.map, None, None
        if briefing.carrier == FOOT:
            self._begin_on_foot(briefing)
        else:
            self._begin(briefing, factor)
        if self._shoe is None and self._reckoner.has_compass:
            compass = own.open_compass if briefing.building is None else own.compass
            self._compass = CompassMean(compass)
            self._map_params = replace(own.map, bias_walk_rad=compass.walk_rad)
        self._hypotheses: list[Hypothesis] = []
        self._answers = BackwardSampler()
        self._open: tuple[Hypothesis, CompassMean | None] | None = None
        self._doubt, self._plan_is_wrong = 0.0, False
        self._start_is_known = start is not None
        if start is not None:
            cloud = self._new_cloud(start.level)
            cloud.begin_near(np.array(start.xy_m), start.radius_m)
            self._hypotheses.append(self._followed(cloud, start.level, 0.0))
            if self._compass is not None and radio is not None and radio.building is not None and is_interpolated:
                self._lost = ScanBelief(own.lost, own.map.scale_sigma, radio, start, self._rng.spawn(1)[0])
            if briefing.building is not None and self.leaves_plans:
                self._open = self._beside(start, cloud)
                (floor_m,), _ = level_map(self._building, start.level).nearest(np.array([start.xy_m]), start.level)
                if math.dist(floor_m, start.xy_m) > max(OFF_FLOOR_M, start.radius_m):
                    self._leave_plan()
        elif radio is not None:
            radio.get_ready()  # now, and not at the first scan: a step is to be quick
            for level in set(radio.level.tolist()) & set(self._building.levels):
                level_map(self._building, level)
            middle = middle_of_survey(radio.radio_map.xy_m, radio.radio_map.level)
            self._xy_m, self._level = middle.xy_m, middle.level

    def step(self, observation: Observation) -> Estimate:
        if self._alone is not None:
            return self._alone.step(observation)
        moves = self._reckoner.update(observation.rows) if self._shoe is None else self._shoe.update(observation)
        for move in moves:
            self._walk(move)
        if self._radio is not None and (len(observation["wifi"]) or self._radio.waits):
            if self._start_is_known:
                self._focus()
            for log_likelihood in self._radio.update(observation["wifi"]):
                self._receive(log_likelihood, observation.now_s)
        if self._shoe is not None and self._shoe.level_changes:
            self._change_levels(self._shoe.level_changes, observation.now_s)
        elif self._shoe is None and self._has_level_changes and len(observation["level_change"]):
            changes = [(int(levels), way == BY_LIFT) for _, levels, _, way in observation["level_change"].tolist()]
            self._change_levels(changes, observation.now_s)
        estimate = self._estimate(observation.now_s)
        return self._answers.answered(observation.now_s, estimate)

    def revise(self) -> FloatArray | None:
        """(K, 5) t_s, x_m, y_m, level, sigma_m at the times of the answers; None where no clouds were kept.

        Answers of before the first cloud are those of its time.
        """
        if self._alone is not None:
            return self._alone.revise()
        if not self._hypotheses:
            return None
        (rng,) = self._rng.spawn(1)
        _, factor = self._sigma_factors
        rows = self._best.past.revised(
            rng,
            claim=factor,
            answers=self._answers.answers,
            num_lines=NUM_LINES if self._start_is_known else self._own.num_lines,
            middle=mean_of if self._start_is_known else geometric_median,
        )
        begins = int(np.searchsorted(rows[:, 0], self._best.past.begin_s))
        if begins < len(rows):
            rows[:begins, 1:] = rows[begins, 1:]
        return rows

    def debug(self) -> dict[str, NDArray[Any]]:
        """The likeliest cloud, the mean of its states, and what fraction of the evidence it has."""
        if self._alone is not None or not self._hypotheses:
            return debug_of(None)
        cloud = self._best.cloud
        evidence = np.exp([each.cloud.log_evidence - cloud.log_evidence for each in self._hypotheses])
        return debug_of(cloud) | {
            "offset_db": np.array(cloud.mean_offset_db),
            "evidence": np.array(1.0 / evidence.sum()),
            "plan_is_wrong": np.array(self._plan_is_wrong),
        }

    def _begin_on_foot(self, briefing: Briefing) -> None:
        """Displacements are those of `foot_ins_robust`; without a heading of the start they may lead anywhere."""
        self._shoe = ShoeReckoner(briefing, self._rng)
        self._heading_rad = None if briefing.start is None else briefing.start.heading_rad
        self._has_level_changes, self._map_params = True, self._own.foot
        if self._heading_rad is None:
            self._map_params = replace(self._map_params, bias_sigma_rad=math.pi)

    @property
    def _every(self) -> list[Hypothesis]:
        """Hypotheses, and the cloud in open space beside."""
        return self._hypotheses if self._open is None else [*self._hypotheses, self._open[0]]

    @property
    def _best(self) -> Hypothesis:
        return max(self._hypotheses, key=lambda each: each.cloud.log_evidence)

    @property
    def _sigma_factors(self) -> tuple[float, float]:
        """On the spread of particles, and of lines."""
        own = self._own
        if not self._start_is_known:
            return own.sigma_factor, own.revised_sigma_factor
        scans = own.interpolated if self._radio is None else self._scans_of(self._radio.radio_map)
        return scans.known_sigma_factor, scans.known_revised_sigma_factor

    def _estimate(self, now_s: float) -> Estimate:
        if not self._hypotheses:
            return Estimate(xy_m=self._xy_m, level=self._level, converged=False)
        cloud, own = self._best.cloud, self._own
        return Estimate(
            xy_m=(cloud.xy_m if self._start_is_known else cloud.median_m) + self._since_m(cloud, now_s),
            level=cloud.level,
            heading_rad=self._heading_rad,
            sigma_m=self._sigma_factors[0] * cloud.sigma_m,
            converged=None if self._start_is_known else cloud.sigma_m <= own.one_place_m,
        )

    def _since_m(self, cloud: Cloud, now_s: float) -> FloatArray:
        """(2,) how far the walker has come since the last move of the particles."""
        if self._shoe is None:
            return self._extrapolated_m(now_s)
        return turned(cloud.mean_scale * self._shoe.since_m, cloud.mean_bias_rad)

    def _fitted(self, briefing: Briefing) -> RadioEvidence | None:
        """The survey of a briefing; the one of the walk before where that is the same."""
        radio_map = briefing.radio_map
        if radio_map is None or not len(radio_map.age_s) or "wifi" not in briefing.sensors:
            return None
        if briefing.carrier == FOOT and briefing.start is not None:
            return None  # a shoe errs by less than scans do
        radio, own, scans, params = self._radio, self._own, self._scans_of(radio_map), self._own.radio
        plan = briefing.building
        if briefing.start is not None and plan is not None:  # a walk may lead anywhere on a surveyed level
            params = replace(params, field=replace(params.field, covers_floor=True))
        elif briefing.start is not None:
            params = replace(params, field=replace(params.field, margin_m=MARGIN_M))
        is_kept = radio is not None and radio.radio_map is radio_map and radio.building is plan
        if radio is None or not is_kept or radio.params != params:
            off_legs = ELSEWHERE if briefing.start is None else fraction_off_survey(radio_map)
            radio = RadioEvidence(radio_map, plan, params, scans.map_error_m, off_legs)
        trust, near_trust = scans.trust, scans.fingerprint_trust
        if briefing.start is not None:
            trust, near_trust = scans.known_trust, scans.known_fingerprint_trust
        if near_trust and radio.fingerprints is None:
            wifi = briefing.sensors["wifi"]
            radio.fingerprints = FingerprintEvidence(radio_map, wifi, own.fingerprints, radio.xy_m, radio.level)
        radio.begin(trust, near_trust, MAX_WORK)
        return radio

    def _scans_of(self, radio_map: RadioMap) -> ScanTrustParams:
        return self._own.surveyed if radio_map.surveyed else self._own.interpolated

    def _new_cloud(self, level: int) -> Cloud:
        return Cloud(self._building, self._rng.spawn(1)[0], self._cloud_params(), level, self._radio)

    def _cloud_params(self) -> LearnedMapFilterParams:
        """Of a cloud that begins now."""
        if self._compass is None:
            return self._map_params
        return replace(self._map_params, bias_sigma_rad=self._compass.spread_rad)

    def _beside(self, start: Start, cloud: Cloud) -> tuple[Hypothesis, CompassMean | None]:
        """A cloud in open space from the same start, with its compass, in case the plan is wrong."""
        own, radio_map = self._own, None if self._radio is None else self._radio.radio_map
        floor = open_space(radio_map, start, self._building.levels)
        params, compass = replace(self._map_params, num_particles=own.num_open), None
        if self._compass is not None:
            compass = CompassMean(own.open_compass)
            params = replace(params, bias_sigma_rad=compass.spread_rad, bias_walk_rad=own.open_compass.walk_rad)
        beside = cloud.beside(floor, params, start.level)
        beside.begin_near(np.array(start.xy_m), start.radius_m)
        return self._followed(beside, start.level, 0.0, floor), compass

    def _follow_beside(self, move: Move, motion: Transition, turn_rad: float) -> None:
        """Moves the cloud in open space, and goes on with it alone where the plan is wrong."""
        if self._open is None:
            return
        beside, compass = self._open
        if compass is not None and move.compass_rad is not None:
            compass.update(move.compass_rad, move.end_s)
            beside.cloud.turn(turn_rad, compass)
        beside.cloud.move(move.move_m, move.covariance_m2)
        beside.past.follow(stored(beside.cloud, move.end_s, beside.past.num_kept), move.end_s - EVERY_S, motion)
        through = max(self._hypotheses[0].cloud.free_fraction, MIN_FREE)
        self._doubt = KEPT_DOUBT * self._doubt - math.log(through)
        if self._doubt > self._own.doubt:
            self._leave_plan()

    def _leave_plan(self) -> None:
        """Goes on with the cloud in open space alone."""
        if self._open is not None:
            beside, self._compass = self._open
            self._hypotheses, self._building = [beside], beside.floor
            self._open, self._plan_is_wrong = None, True
            warnings.warn("fusion: the plan, or the start on it, is wrong: walls are left out", RecordingWarning, 2)

    def _followed(self, cloud: Cloud, level: int, now_s: float, floor: Building | None = None) -> Hypothesis:
        follows_levels = self._has_level_changes and (self._start_is_known or len(cloud.levels) == 1)
        if follows_levels:
            cloud.follow_levels(floor or self._building, level)
        past = BackwardSampler(self._own.num_kept)
        past.follow(stored(cloud, now_s, past.num_kept), now_s)
        return Hypothesis(cloud, past, follows_levels, floor or self._building)

    def _walk(self, move: Move) -> None:
        if not move.stands:
            compass, turn_rad = self._compass, 0.0
            if compass is not None and move.compass_rad is not None:
                turn_rad = compass.update(move.compass_rad, move.end_s)
            motion = motion_of(move, self._map_params, turn_rad)
            for each in self._hypotheses:
                if compass is not None:
                    each.cloud.turn(turn_rad, compass)
                each.cloud.move(move.move_m, move.covariance_m2)
                now = stored(each.cloud, move.end_s, each.past.num_kept)
                each.past.follow(now, move.end_s - EVERY_S, motion)
            self._follow_beside(move, motion, turn_rad)
        if self._hypotheses:
            cloud = self._best.cloud
            self._follow(cloud.mean_scale * turned(move.move_m, cloud.mean_bias_rad), move.end_s)

    def _receive(self, log_likelihood: FloatArray, now_s: float) -> None:
        """Begins on every level where the first scan may have been received; later ones weigh clouds and particles."""
        assert self._radio is not None
        own = self._own
        if not self._hypotheses:
            self._begin_everywhere(log_likelihood, now_s)
            return
        scans = self._scans_of(self._radio.radio_map)
        known = self._start_is_known
        lost_fraction = scans.known_lost_fraction if known else own.lost_fraction
        for each in self._every:
            gain = each.cloud.weigh_by(
                log_likelihood, lost_fraction, scans.turned_fraction, resets=known and scans.known_resets
            )
            if self._lost is not None and each is self._hypotheses[0]:
                self._lost.weigh_by(log_likelihood, now_s, each.cloud.xy_m, each.cloud.level, gain)
                p = self._lost.params
                if self._lost.lead > p.lead:
                    each.cloud.take(self._lost.draw(round(p.fraction * each.cloud.num_particles)))
                    self._lost.lead = self._doubt = 0.0
            each.past.amend(stored(each.cloud, now_s, each.past.num_kept))
        least = self._best.cloud.log_evidence + math.log(own.unlikely)
        self._hypotheses = [each for each in self._hypotheses if each.cloud.log_evidence >= least]
        self._focus()

    def _focus(self) -> None:
        """Reports to the radio evidence on which levels, and with which offsets, particles still are, or may get to."""
        if self._radio is not None and self._hypotheses:
            clouds = [each.cloud for each in self._hypotheses]
            stays = self._start_is_known and not self._scans_of(self._radio.radio_map).known_lost_fraction
            levels = [cloud.levels_now if stays else cloud.levels for cloud in clouds]
            is_left = np.mean([cloud.offset_fraction for cloud in clouds], axis=0) >= MIN_OFFSET
            self._radio.focus(frozenset().union(*levels), is_left)

    def _begin_everywhere(self, log_likelihood: FloatArray, now_s: float) -> None:
        assert self._radio is not None
        covered: set[int] = set()
        for level in np.unique(self._radio.level).tolist():
            if level in self._building.levels and level not in covered:
                cloud = self._new_cloud(level)
                covered |= cloud.levels
                cloud.begin_over(log_likelihood)
                self._hypotheses.append(self._followed(cloud, level, now_s))

    def _change_levels(self, changes: list[tuple[int, bool]], now_s: float) -> None:
        """By so many levels up, and whether by a lift, each."""
        for each in filter(lambda one: one.follows_levels, self._every):
            for levels, by_lift in changes:
                each.cloud.change_level(levels, by_lift=by_lift)
            each.past.amend(stored(each.cloud, now_s, each.past.num_kept))
        self._doubt = 0.0  # on stairs, walls are where the level is not known yet
        self._focus()
