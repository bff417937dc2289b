"""Settings of `fusion`."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

from pdrbench_baselines.fusion.compass import CompassParams
from pdrbench_baselines.fusion.lost import LostParams
from pdrbench_baselines.gp_wifi.fingerprints import FingerprintParams
from pdrbench_baselines.gp_wifi.localizer import GpWifiParams
from pdrbench_baselines.learned.map_filter import LearnedMapFilterParams


@dataclass(frozen=True, slots=True)
class ScanTrustParams:
    """What a scan counts for, and what `sigma_m` is, by the kind of the survey.

    Attributes:
        map_error_m: By which the radio map is off, per axis.
        trust: Power of the likelihood of a scan by fields, over that of `gp_wifi`; 0 for none.
        known_trust: The same where the start is known.
        fingerprint_trust: Power of the density of a scan by its nearest fingerprints; 0 for none.
        known_fingerprint_trust: The same where the start is known.
        known_lost_fraction: How often, at a scan, the walker may be anywhere, where the start is known.
        turned_fraction: Of particles that are carried away, how many may walk in any direction: a phone may lie in a
            bag, or be turned over, so that displacements point somewhere else.
        known_resets: Whether, where the start is known, particles are carried away by sensor resetting
            (`Cloud.weigh_by`).
        known_sigma_factor: On the spread of particles, for `sigma_m`, where the start is known.
        known_revised_sigma_factor: On that of lines through them.
    """

    map_error_m: float
    trust: float
    known_trust: float
    fingerprint_trust: float
    known_fingerprint_trust: float
    known_lost_fraction: float
    turned_fraction: float
    known_resets: bool
    known_sigma_factor: float
    known_revised_sigma_factor: float


INTERPOLATED: Final = ScanTrustParams(
    map_error_m=5.0,
    trust=1.0,
    known_trust=0.3,
    fingerprint_trust=1.0,
    known_fingerprint_trust=0.0,
    known_lost_fraction=0.0,
    turned_fraction=0.0,
    known_resets=False,
    known_sigma_factor=1.7,
    known_revised_sigma_factor=1.9,
)
SURVEYED: Final = ScanTrustParams(
    map_error_m=1.0,
    trust=0.0,
    known_trust=0.0,
    fingerprint_trust=0.5,
    known_fingerprint_trust=0.5,
    known_lost_fraction=3e-3,
    turned_fraction=0.5,
    known_resets=True,
    known_sigma_factor=1.1,
    known_revised_sigma_factor=1.1,
)

FOOT_CLOUD: Final = LearnedMapFilterParams(
    scale_sigma=0.012,
    bias_sigma_rad=math.radians(3.0),
    bias_walk_rad=math.radians(0.8),
    near_scale=0.002,
    near_bias_rad=math.radians(0.3),
)


@dataclass(frozen=True, slots=True)
class FusionParams:
    """Defaults, ours; the notebook on fusion has what was measured of each.

    Attributes:
        radio: Of the radio map.
        map: Of each cloud.
        foot: The same of a unit on a foot, whose displacements come from `foot_ins_robust`.
        interpolated: Of a survey whose places were interpolated, and where there is none.
        surveyed: Of one whose places were surveyed.
        fingerprints: How far fingerprints are trusted.
        lost_fraction: How often, at a scan, the walker may be anywhere, where the start is not known.
        unlikely: Clouds whose evidence falls below this fraction of the best are dropped.
        sigma_factor: On the spread of particles, for `sigma_m`, where the start is not known.
        revised_sigma_factor: On that of lines through them.
        num_kept: Particles of a cloud that are kept for the revision of the past.
        num_lines: That are drawn through them where the start is not known.
        one_place_m: Particles that spread less are in one place, for `converged` after an unknown start.
        interpolated_length_factor: On displacements, where the start of a phone is known and the places of the survey
            were interpolated.
        compass: Errors of the mean of a compass, where a phone has one, instead of `map.bias_sigma_rad` and
            `map.bias_walk_rad`.
        open_compass: The same where there is no plan: no wall corrects a heading, and of phones of several makes whole
            walks are turned by 21 degrees (standard deviation), see the notebook on shopping centres.
        num_open: Particles in open space beside a cloud on a plan, where the start is known, in case the plan is wrong.
        doubt: The plan is taken for wrong once the logarithms of the fractions of particles that walls let through
            come to less than minus this, those of before counting 0.9 of themselves a second.
        lost: Of the belief by scans alone that shows that a cloud is lost, in the same case.
    """

    radio: GpWifiParams = field(default_factory=GpWifiParams)
    map: LearnedMapFilterParams = field(default_factory=lambda: LearnedMapFilterParams(num_particles=4000))
    foot: LearnedMapFilterParams = FOOT_CLOUD
    interpolated: ScanTrustParams = INTERPOLATED
    surveyed: ScanTrustParams = SURVEYED
    fingerprints: FingerprintParams = field(default_factory=FingerprintParams)
    lost_fraction: float = 0.003
    unlikely: float = 1e-6
    sigma_factor: float = 5.4
    revised_sigma_factor: float = 15.0
    num_kept: int = 512
    num_lines: int = 128
    one_place_m: float = 2.0
    interpolated_length_factor: float = 0.97
    compass: CompassParams = field(default_factory=CompassParams)
    open_compass: CompassParams = field(default_factory=lambda: CompassParams(sigma_rad=math.radians(15.0)))
    num_open: int = 1000
    doubt: float = 15.0
    lost: LostParams = field(default_factory=LostParams)


FUSION: Final = FusionParams()
