"""Li et al. 2012: a phone, a floor map and a particle filter that learns how long its owner's steps are.

F. Li, C. Zhao, G. Ding, J. Gong, C. Liu, F. Zhao, "A reliable and accurate indoor localization method using phone
inertial sensors", UbiComp 2012.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.inertial import STAGES, WAYS
from pdrbench.inertial.phone_attitude import PhoneAttitude, PhoneAttitudeParams
from pdrbench.inertial.step_detection import StepDetector, StepParams
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench_baselines.backward import BackwardSampler, StoredCloud, Transition, gaussian
from pdrbench_baselines.li2012.map_filter import StepModel, StepModelFilter, StepModelFilterParams
from pdrbench_baselines.li2012.turns import TurnDetector, TurnParams
from pdrbench_baselines.li2012.user_heading import UserHeading

BY_LIFT: Final = float(WAYS.index("lift"))
KEPT_S: Final = 8.0  # of attitudes: a step may be validated two steps late, and wait for the one before it
HEADING_BIAS: Final[Mapping[str, Any]] = MappingProxyType(  # settings of the filter with `heading_bias`
    {
        "adjustment": 0.0,
        "heading_sigma_rad": math.radians(5.0),  # sources.md 1.5 and 1.4: what is left within a leg is 4 degrees
        "bias_sigma_rad": math.radians(10.0),  # sources.md 1.5
        "bias_walk_rad": math.radians(0.5),
    }
)
BIASED_POCKET_SIGMA_RAD: Final = math.radians(10.0)  # ours
GENERIC: Final = StepModel(0.181, 0.334)  # L14: 4150 steps of 23 simulated people, `model.generic_model`


@dataclass(frozen=True, slots=True)
class Li2012Params:
    """Defaults from Li et al. 2012 unless a line says otherwise.

    Attributes:
        filter: Particles, noise, models, summary.
        steps: Of step detection.
        turns: Of turn detection.
        attitude: Where the phone reports none.
        model: The generic step model, with which every walker begins.
        generic: Every particle keeps the generic model: algorithm 2 of the paper's Fig. 11.
        warping: Steps are validated by dynamic time warping; without, and with `generic`: algorithm 1 of Fig. 11.
        map: False: no walls, no pathways.
        heading_bias: Beyond the paper, in place of its correction of the next heading, which forgets at once: every
            particle keeps a heading error of its own (`HEADING_BIAS`), one that comes back takes that of its neighbour,
            and the answer goes on between steps. Headings of a phone are off by a constant of each walk (sources.md
            1.5).
        alternate_q: Two transforms, one for each leg (L11).
        pocket_sigma_rad: Noise of the heading in a pocket; that in the hand is the filter's.
        carries_on: Between steps, and until the next one is known, the answer goes on at the pace of the last; False
            answers where the last step ended, as the paper's system shows it and as its steps are judged there.
        carry_s: It stops, and goes back, where no step has ended for so long.
        margin_steps: Deaths so many steps before a turn belong to it: who is too long hits the wall at its end first.
        revises: Whether clouds are kept, from which `revise` draws the past.
    """

    filter: StepModelFilterParams = field(default_factory=StepModelFilterParams)
    steps: StepParams = field(default_factory=StepParams)
    turns: TurnParams = field(default_factory=TurnParams)
    attitude: PhoneAttitudeParams = field(default_factory=PhoneAttitudeParams)
    model: StepModel = GENERIC
    generic: bool = False
    warping: bool = True
    map: bool = True
    heading_bias: bool = False
    alternate_q: bool = False
    pocket_sigma_rad: float = math.radians(15.0)  # L18
    carries_on: bool = False
    carry_s: float = 1.2  # ours: a step becomes known 0.4 s after its end, and the next one ends half a second later
    margin_steps: int = 4  # ours: half the median filter of L17
    revises: bool = True

    def of_filter(self, *, in_pocket: bool) -> StepModelFilterParams:
        """Settings of the filter for a way of carrying."""
        settings = self.filter
        if self.heading_bias:
            settings = dataclasses.replace(settings, **HEADING_BIAS)
        if in_pocket:
            sigma_rad = BIASED_POCKET_SIGMA_RAD if self.heading_bias else self.pocket_sigma_rad
            settings = dataclasses.replace(settings, heading_sigma_rad=sigma_rad)
        return dataclasses.replace(settings, delta_a=0.0, delta_b=0.0) if self.generic else settings


LI2012: Final = Li2012Params()


class Li2012:
    """Phone steps and headings; particles over places and step models (Li et al. 2012).

    Where changes of level are offered (`level_change`), the level is theirs: particles go where stairs or lifts are.

    Needs a known start, an accelerometer and either the rotation vector or a gyroscope; a magnetometer helps the
    latter. In the hand the phone points ahead where the heading of the start is unknown (assumption 1 of the paper
    with an offset of zero). In a pocket the heading has to be known: nothing else relates a pocket to its bearer.

    A start off the floor is taken to the nearest floor of its level. Where all particles die at once, they are spread
    again around the last estimate; `debug()["resets"]` counts these.

    Args:
        params: See `Li2012Params`.
        model: Of this person, as `personal_model` gave it at the end of an earlier walk; None for the generic one.

    Attributes:
        filter: The particles, from `reset` on.
    """

    def __init__(self, params: Li2012Params = LI2012, *, model: StepModel | None = None) -> None:
        self._params = params
        self._model = model or self._params.model

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("accel",), start=True, carrier="phone")
        assert briefing.start is not None
        p, start = self._params, briefing.start
        if p.map and briefing.building is None:
            raise UnsuitableError("needs a map; this environment has none, li2012?map=false goes without")
        in_pocket = briefing.mounting == "pocket"
        self._attitude = _attitude_source(briefing, start.heading_rad is not None, p.attitude)
        if in_pocket and start.heading_rad is None:
            raise UnsuitableError("needs the heading of the start where the phone is in a pocket; this start has none")
        self._detector = StepDetector(
            briefing.sensors["accel"].rate_hz or 50.0, p.steps, STAGES[-1] if p.warping else STAGES[-2]
        )
        self._heading = UserHeading(start.heading_rad, alternate_q=p.alternate_q)
        self._turns = TurnDetector(p.turns)
        settings = p.of_filter(in_pocket=in_pocket)
        self.filter = StepModelFilter(briefing.building if p.map else None, rng, settings)
        sigma_m = max(settings.start_sigma_m, start.radius_m / 2)
        self.filter.start(start.xy_m, start.level, self._model, sigma_m)
        self._has_level_changes = "level_change" in briefing.sensors
        if self._has_level_changes:
            self.filter.follow_levels(briefing.building if p.map else None, start.level)
        self._attitudes: FloatArray = np.zeros((0, 5))
        self._last_heading_rad = start.heading_rad
        self._last_end_s, self._velocity_mps = -math.inf, np.zeros(2)
        self._rng, self._settings, self._past = rng, settings, BackwardSampler() if p.revises else None
        if self._past is not None:
            self._past.follow(self._stored(0.0), 0.0)

    def step(self, observation: Observation) -> Estimate:
        self._take_attitudes(observation)
        steps = self._detector.update(observation["accel"])
        times = steps.inference_s.tolist(), steps.frequency_hz.tolist(), steps.end_s.tolist()
        for inference_s, frequency_hz, end_s in zip(*times, strict=True):
            if len(self._attitudes):
                self._walk(end_s, frequency_hz, self._heading.heading_rad(self._attitude_at(inference_s)))
        if len(steps):
            self._last_end_s = float(steps.end_s[-1])
        if self._has_level_changes:
            for _, levels, _, way in observation["level_change"].tolist():
                self.filter.change_level(int(levels), by_lift=way == BY_LIFT)
            if self._past is not None and len(observation["level_change"]):
                self._past.amend(self._stored(observation.now_s))
        estimate = Estimate(
            xy_m=self.filter.xy_m + self._extrapolated_m(observation.now_s),
            level=self.filter.level,
            heading_rad=self._last_heading_rad,
            sigma_m=self.filter.sigma_m,
        )
        return estimate if self._past is None else self._past.answered(observation.now_s, estimate)

    def revise(self) -> FloatArray | None:
        """(K, 5) t_s, x_m, y_m, level, sigma_m at the times of the answers; None where no clouds were kept.

        The revised past has places at the times at which steps ended, and goes on evenly between them.
        """
        if self._past is None:
            return None
        (rng,) = self._rng.spawn(1)
        return self._past.revised(rng)

    def personal_model(self) -> StepModel:
        """What was learned of this person: the model for their next walk (L21); that of before where nothing was."""
        learned = self.filter.summary() if not self._params.generic else None
        return learned or self._model

    def debug(self) -> dict[str, NDArray[Any]]:
        """Particles; how many steps were taken, how often all particles died, mean a and b of the models."""
        model = self.filter.model
        return {
            "particles_xy_m": self.filter.particles_xy_m,
            "particles_level": self.filter.particles_level,
            "particles_weight": self.filter.weight.copy(),
            "num_particles": np.array(self.filter.num_particles),
            "num_steps": np.array(self.filter.num_steps),
            "resets": np.array(self.filter.resets),
            "step_model": np.array([model.a_m_per_hz, model.b_m]),
        }

    def _take_attitudes(self, observation: Observation) -> None:
        """Keeps those of the last seconds."""
        if isinstance(self._attitude, PhoneAttitude):
            mag = observation["mag"] if "mag" in observation.rows else None
            new = self._attitude.update(observation["accel"], observation["gyro"], mag)
        else:
            new = observation["rotation"]
        if len(new):
            kept = self._attitudes[self._attitudes[:, 0] > new[-1, 0] - KEPT_S]
            self._attitudes = np.concatenate([kept, new])

    def _attitude_at(self, t_s: float) -> FloatArray:
        """(4,) the attitude nearest to a time."""
        row = int(np.searchsorted(self._attitudes[:, 0], t_s))
        row = min(max(row, 0), len(self._attitudes) - 1)
        if row > 0 and t_s - self._attitudes[row - 1, 0] < abs(self._attitudes[row, 0] - t_s):
            row -= 1
        nearest: FloatArray = self._attitudes[row, 1:]
        return nearest

    def _walk(self, end_s: float, frequency_hz: float, heading_rad: float) -> None:
        """One step of the filter, which ended then, and turns that end with it."""
        corrected_rad = heading_rad + self.filter.correction_rad
        self.filter.step(frequency_hz, heading_rad)
        self._last_heading_rad = heading_rad
        speed_mps = frequency_hz * self.filter.model.length_m(frequency_hz)
        towards_rad = heading_rad + self.filter.bias_rad
        self._velocity_mps = speed_mps * np.array([math.cos(towards_rad), math.sin(towards_rad)])
        turn = self._turns.update(heading_rad)
        if turn is not None:
            margin = self._params.margin_steps
            self.filter.turned(turn.begin - margin, turn.end + margin)
        if self._past is not None:
            transition = self._transition(frequency_hz, corrected_rad)
            self._past.follow(self._stored(end_s), end_s - 1.0 / frequency_hz, transition)

    def _extrapolated_m(self, now_s: float) -> FloatArray:
        """(2,) how far the walker has come since the last step ended."""
        since_s = now_s - self._last_end_s
        walks = (self._params.carries_on or self._params.heading_bias) and since_s < self._params.carry_s
        return self._velocity_mps * since_s if walks else np.zeros(2)

    def _stored(self, t_s: float) -> StoredCloud:
        cloud = self.filter
        state = np.column_stack([cloud.particles_xy_m, cloud.a, cloud.b, cloud.particles_bias_rad])
        level, cell = cloud.particles_level, cloud.particles_cell
        return StoredCloud(t_s, state, level, cell, cloud.weight, cloud.line_check())

    def _transition(self, frequency_hz: float, towards_rad: float) -> Transition:
        p = self._settings
        length_m = self.filter.model.length_m(frequency_hz)
        place_m2 = p.near_m**2 + length_m**2 * (p.length_fraction**2 + p.heading_sigma_rad**2) / 2
        keeps = np.array([p.delta_a / 4, p.delta_b / 4, p.bias_walk_rad + p.bias_sigma_rad / 6]) + 1e-6
        covariance = np.diag([place_m2, place_m2, *np.square(keeps)])

        def expected(state: FloatArray) -> FloatArray:
            along_rad, lengths_m = towards_rad + state[:, 4], state[:, 2] * frequency_hz + state[:, 3]
            steps = lengths_m[:, None] * np.column_stack([np.cos(along_rad), np.sin(along_rad)])
            return np.column_stack([state[:, :2] + steps, state[:, 2:]])

        return gaussian(expected, covariance)


def _attitude_source(briefing: Briefing, is_heading_known: bool, params: PhoneAttitudeParams) -> PhoneAttitude | None:
    """None: the phone's rotation vector."""
    if "rotation" in briefing.sensors:
        return None
    if "gyro" not in briefing.sensors:
        offered = ", ".join(briefing.sensors) or "none"
        raise UnsuitableError(f"needs a rotation vector or a gyroscope to know where steps lead; there is {offered}")
    if "mag" not in briefing.sensors and not is_heading_known:
        raise UnsuitableError("needs a rotation vector, a magnetometer or the heading of the start; none is offered")
    return PhoneAttitude(params)
