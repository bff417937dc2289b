"""`magnetic`: displacements, the plan and a magnetic survey. `MagneticFusion`: a radio map as well."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.radio import middle_of_survey
from pdrbench_baselines.fusion.localizer import Fusion
from pdrbench_baselines.fusion.params import FusionParams
from pdrbench_baselines.fusion.radio import RadioEvidence
from pdrbench_baselines.learned.map_filter import stored
from pdrbench_baselines.learned.reckoning import Move
from pdrbench_lab.magnetic.cloud import MagneticCloud
from pdrbench_lab.magnetic.evidence import SENSORS, MagneticEvidence, MagneticEvidenceParams


@dataclass(frozen=True, slots=True)
class MagneticParams:
    """Defaults, ours; see lab/notebook/magnetic.md.

    Attributes:
        magnetic: Of the survey and of samples.
        fusion: Of clouds, and of the radio map where there is one.
    """

    magnetic: MagneticEvidenceParams = field(default_factory=MagneticEvidenceParams)
    fusion: FusionParams = field(default_factory=FusionParams)


MAX_SURVEYS: Final = 2  # whose fields are kept: of walks of one split, each building has one
MAGNETIC: Final = MagneticParams()


class MagneticFusion(Fusion):
    """`fusion` whose clouds are weighed by samples of the magnetic field as well.

    Needs what `fusion` needs, a magnetic survey, a magnetometer and a rotation vector.

    Args:
        params: See `MagneticParams`.
    """

    leaves_plans = False  # fields were surveyed on them

    def __init__(self, params: MagneticParams = MAGNETIC) -> None:
        super().__init__(params.fusion)
        self._settings = params
        self._magnetic: MagneticEvidence | None = None
        self._surveys: list[MagneticEvidence] = []

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=SENSORS, magnetic_map=True)
        magnetic_map = briefing.magnetic_map
        assert magnetic_map is not None
        same = [each for each in self._surveys if each.magnetic_map is magnetic_map]
        self._magnetic = same[0] if same else MagneticEvidence(magnetic_map, self._settings.magnetic)
        self._magnetic.begin()
        self._surveys = [self._magnetic, *(each for each in self._surveys if each is not self._magnetic)][:MAX_SURVEYS]
        super().reset(briefing, rng)

    def step(self, observation: Observation) -> Estimate:
        assert self._magnetic is not None
        self._magnetic.update(observation.rows)
        return super().step(observation)

    def _new_cloud(self, level: int) -> MagneticCloud:
        assert self._magnetic is not None
        rng = self._rng.spawn(1)[0]
        return MagneticCloud(self._building, rng, self._cloud_params(), level, self._radio, self._magnetic)

    def _walk(self, move: Move) -> None:
        super()._walk(move)
        assert self._magnetic is not None
        sample = self._magnetic.after(0.0 if move.stands else float(np.hypot(*move.move_m)), move.end_s)
        if sample is None:
            return
        if not self._hypotheses:
            self._begin_by_field(move.end_s)
        for each in self._hypotheses:
            assert isinstance(each.cloud, MagneticCloud)
            each.cloud.weigh_by_field(sample)
            each.past.amend(stored(each.cloud, move.end_s, each.past.num_kept))
        if self._hypotheses:
            least = self._best.cloud.log_evidence + math.log(self._own.unlikely)
            self._hypotheses = [each for each in self._hypotheses if each.cloud.log_evidence >= least]

    def _begin_by_field(self, now_s: float) -> None:
        """Begins where the start is not known; here the first scan does."""


class Magnetic(MagneticFusion):
    """Displacements of `learned` on the map, and samples of the magnetic field; no radio map is used.

    Needs what `learned` needs, a plan, a magnetic survey, a magnetometer and a rotation vector. Where the start is not
    known, a cloud on every surveyed level begins evenly over what was surveyed there, with the first second.
    """

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        magnetic_map = briefing.magnetic_map
        if briefing.start is not None or magnetic_map is None:
            super().reset(briefing, rng)
            return
        middle = middle_of_survey(magnetic_map.xy_m, magnetic_map.level)
        super().reset(replace(briefing, start=middle), rng)
        self._hypotheses, self._start_is_known = [], False
        self._xy_m, self._level = middle.xy_m, middle.level

    def _fitted(self, briefing: Briefing) -> RadioEvidence | None:
        return None

    def _begin_by_field(self, now_s: float) -> None:
        assert self._magnetic is not None
        covered: set[int] = set()
        for level in self._magnetic.field.levels.tolist():
            if level in self._building.levels and level not in covered:
                cloud = self._new_cloud(level)
                covered |= cloud.levels
                cloud.begin_over_survey()
                self._hypotheses.append(self._followed(cloud, level, now_s))
