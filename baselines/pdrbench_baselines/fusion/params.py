"""Settings of `fusion-v0` to `-v2`; docs/fusion.md has what was measured of each."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from pdrbench_baselines.backward import NUM_LINES
from pdrbench_baselines.fusion.compass import CompassParams
from pdrbench_baselines.fusion.fingerprints import FingerprintParams
from pdrbench_baselines.fusion.free import FreeParams
from pdrbench_baselines.gp_wifi.localizer import GpWifiParams
from pdrbench_baselines.learned.map_filter import LearnedMapFilterParams


@dataclass(frozen=True, slots=True)
class ScanParams:
    """What a scan counts for, and what is claimed, by the kind of the survey.

    Attributes:
        map_error_m: By which the radio map is off, per axis.
        trust: Power of the likelihood of a scan, over that of `gp_wifi-v0`.
        known_trust: The same where the start is known.
        fingerprint_trust: Power of the density of a scan by its nearest fingerprints; 0 for none.
        known_fingerprint_trust: The same where the start is known.
        known_lost_fraction: How often, at a scan, the walker may be anywhere, where the start is known.
        turned_fraction: Of particles that are carried away, how many may walk in any direction: a phone may lie in a
            bag, or be turned over, so that displacements point somewhere else.
        known_resets: Whether, where the start is known, particles are carried away by sensor resetting
            (`Cloud.weigh_by`).
        known_sigma_factor, known_revised_sigma_factor: On the spread of particles, and of lines through them, for
            `sigma_m`, where the start is known.
    """

    map_error_m: float
    trust: float
    known_trust: float
    fingerprint_trust: float = 0.0
    known_fingerprint_trust: float = 0.0
    known_lost_fraction: float = 1e-5
    turned_fraction: float = 0.0
    known_resets: bool = False
    known_sigma_factor: float = 1.7
    known_revised_sigma_factor: float = 2.1


INTERPOLATED = ScanParams(map_error_m=5.0, trust=2.0, known_trust=0.3)


@dataclass(frozen=True, slots=True)
class FusionParams:
    """Defaults, ours, those of `fusion-v0`; see docs/fusion.md for what was measured.

    Attributes:
        radio: Of the radio map.
        map: Of each cloud.
        interpolated: Of a survey whose places were interpolated, and where there is none.
        surveyed: Of one whose places were surveyed.
        fingerprints: How far fingerprints are trusted.
        first_trust: Power of what the first scan says, over that of the others: clouds are put by it alone.
        takes_median: Whether, where the start is not known, the answer is the geometric median of the particles, or of
            lines, instead of the mean.
        lost_fraction: How often, at a scan, the walker may be anywhere, where the start is not known.
        unlikely: Clouds whose evidence falls below this fraction of the best are dropped.
        sigma_factor, revised_sigma_factor: On the spread of particles, and of lines through them, for `sigma_m`, where
            the start is not known.
        num_kept: Particles of a cloud that are kept for the revision of the past.
        num_lines: That are drawn through them where the start is not known.
        is_lean: Whether scans are evaluated only on levels, and with offsets of the device, that particles still have,
            and networks in compiled code instead of PyTorch.
        one_place_m: Particles that spread less are in one place, for `converged` after an unknown start.
        known_companions: Where the start of a phone is known, networks with which displacements of `learned-v2` are
            averaged; one that declines a walk is left out of it. The last one is asked between seconds as well.
        known_interpolated_length_factor: On displacements, where the start of a phone is known and the places of the
            survey were interpolated.
        bridges_gaps: Whether networks are asked about seconds of a phone of which a part is missing.
        known_covers_floor: Whether, where the start is known, the radio map has all floor of a surveyed level.
        compass: Errors of the mean of a compass, where a phone has one, instead of `map.bias_sigma_rad` and
            `map.bias_walk_rad`. None where headings turn with that mean.
        free: Of particles that no wall stops, where the start of a phone with a compass is known and the places of the
            survey were interpolated; None without.
    """

    radio: GpWifiParams = field(default_factory=GpWifiParams)
    map: LearnedMapFilterParams = field(default_factory=lambda: LearnedMapFilterParams(num_particles=4000))
    interpolated: ScanParams = INTERPOLATED
    surveyed: ScanParams = INTERPOLATED
    fingerprints: FingerprintParams = field(default_factory=FingerprintParams)
    first_trust: float = 1.0
    takes_median: bool = False
    lost_fraction: float = 0.003
    unlikely: float = 1e-6
    sigma_factor: float = 3.5
    revised_sigma_factor: float = 6.0
    num_kept: int = 512
    num_lines: int = NUM_LINES
    is_lean: bool = False
    one_place_m: float = 2.0
    known_companions: tuple[str, ...] = ()
    known_interpolated_length_factor: float = 1.0
    bridges_gaps: bool = False
    known_covers_floor: bool = False
    compass: CompassParams | None = None
    free: FreeParams | None = None


FUSION_V0 = FusionParams()
FUSION_V1 = FusionParams(
    interpolated=ScanParams(
        map_error_m=5.0, trust=1.0, known_trust=0.3, fingerprint_trust=1.0, known_fingerprint_trust=0.0
    ),
    surveyed=ScanParams(
        map_error_m=1.0,
        trust=0.0,
        known_trust=0.0,
        fingerprint_trust=0.5,  # as learned_map-v2
        known_fingerprint_trust=0.5,
    ),
    takes_median=True,
    sigma_factor=4.5,
    revised_sigma_factor=9.5,
    num_lines=256,
)
FUSION_V2 = replace(
    FUSION_V1,
    interpolated=replace(FUSION_V1.interpolated, known_lost_fraction=0.0, known_revised_sigma_factor=1.9),
    surveyed=replace(
        FUSION_V1.surveyed,
        known_lost_fraction=3e-3,
        turned_fraction=0.5,
        known_resets=True,
        known_sigma_factor=1.1,
        known_revised_sigma_factor=1.1,
    ),
    is_lean=True,
    num_lines=128,
    sigma_factor=5.4,
    revised_sigma_factor=15.0,
    known_companions=("learned-v1",),
    known_interpolated_length_factor=0.97,
    bridges_gaps=True,
    known_covers_floor=True,
    compass=CompassParams(),
    free=FreeParams(),
)
