"""What Woodman & Harle 2008 claim, beside what `experiments` measures (claims W1, W4, W6 to W18)."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.evaluation.number_text import SHARE
from pdrbench.evaluation.reproduction import (
    Claim,
    Experiment,
    Gate,
    Reproduction,
    at_share,
    claims_of,
    largest_over_seeds,
    mean_over_seeds,
    median_over_seeds,
    pooled_percentile,
    share_over_seeds,
)

WALKS: Final = 20  # of the test split


def _measure(name: str, seeds: int = WALKS, quick_seeds: int = 1, *, alone: bool = False) -> Experiment:
    return Experiment(name, f"pdrbench_baselines.woodman2008.experiments:{name}", seeds, quick_seeds, alone)


# Claims of one experiment: what, the paper's statement, and the value.
_track_m = claims_of("W1", "track", "m")
_one_stride = claims_of("W6", "one_stride")
_priors_floor = claims_of("W7", "priors")
_wlan_starts_particles = claims_of("W14", "wlan_starts")
_wlan_starts_share = claims_of("W14", "wlan_starts", SHARE)
_track_clouds = claims_of("W16", "track")
_track_clouds_share = claims_of("W16", "track", SHARE)


def _errors_in_wing(experiment: str, variant: str = "") -> tuple[Claim, ...]:
    """W1, of one variant of the filter."""
    of_wing_m = claims_of("W1", experiment, "m")
    return tuple(
        of_wing_m(
            f"{variant}error at stances in the wing, {100 * fraction:.0f} %",
            f"{stated_m:.2f} m",
            median_over_seeds("wing_error_m", at_share(fraction)),
            Gate(high=stated_m),
        )
        for fraction, stated_m in ((0.75, 0.50), (0.95, 0.73))
    )


def _tracking_clouds(experiment: str, variant: str = "") -> tuple[Claim, ...]:
    """W15, and whether the first single cluster of W16 is the walker's."""
    particles = claims_of("W15", experiment)
    return (
        particles(
            f"{variant}particles while tracking, average",
            "170",
            median_over_seeds("tracking_particles", np.mean),
            Gate(120, 220),
        ),
        particles(
            f"{variant}particles while tracking, maximum",
            "500",
            median_over_seeds("tracking_particles", np.max),
            Gate(high=600),
        ),
        _first_is_walker(experiment, f"{variant}first single cluster is the walker's"),
    )


def _first_is_walker(experiment: str, what: str) -> Claim:
    return Claim("W16", what, "it is", experiment, share_over_seeds("correct"), Gate(low=0.95), SHARE)


def _strides(id_: str, experiment: str, variant: str, paper: str) -> Claim:
    what, value = f"{variant}strides to a single cluster", median_over_seeds("strides_to_converge", np.median)
    return Claim(id_, what, paper, experiment, value)


def _other_inputs(suffix: str = "", variant: str = "") -> tuple[Claim, ...]:
    """W16 with WLAN and W17 without heights."""
    wlan, blind = f"track_wlan{suffix}", f"track_blind{suffix}"
    return (
        _first_is_walker(wlan, f"{variant}with WLAN: first single cluster is the walker's"),
        _strides("W16", wlan, f"{variant}with WLAN: ", "fewer"),
        _strides("W17", blind, f"{variant}without heights: ", "more"),
        Claim(
            *("W17", f"{variant}without heights: it is the walker's", "not stated", blind),
            *(share_over_seeds("correct"), None, SHARE),
        ),
    )


_TRACKING: Final = (
    *_errors_in_wing("track"),
    _track_m("the same, walks pooled, 75 %", "one walk", pooled_percentile("wing_error_m", 0.75)),
    _track_m("the same, walks pooled, 95 %", "one walk", pooled_percentile("wing_error_m", 0.95)),
    Claim("W1", "pairs of positions in five runs", "845", "track", median_over_seeds("num_pairs")),
    _track_m("error at all stances, 75 %", "not stated", median_over_seeds("error_m", at_share(0.75))),
    _track_m("error at all stances, 95 %", "not stated", median_over_seeds("error_m", at_share(0.95))),
)
_ALGORITHM: Final = (
    Claim(
        *("W4", "noise on the length of a stride", "0.15 m", "one_stride"),
        *(median_over_seeds("length_sigma_m"), Gate.around(0.15, 0.02), "m"),
    ),
    Claim(
        *("W4", "noise on the change of heading", "0.6°", "one_stride"),
        *(median_over_seeds("turn_sigma_deg"), Gate.around(0.6, 0.02), "°"),
    ),
    Claim(
        *("W4", "strides of no length that go backwards", "l' = l + X", "one_stride"),
        *(median_over_seeds("share_backwards"), Gate(0.48, 0.52), SHARE),
    ),
    _one_stride(
        "live particles outside their polygon", "impassable walls", largest_over_seeds("outside"), Gate(high=0)
    ),
    _one_stride("live particles looked at", "not stated", median_over_seeds("looked_at")),
    Claim(
        *("W7", "floor area", "8725 m²", "priors"),
        *(median_over_seeds("area_m2"), Gate.around(8725, 0.01), "m²"),
    ),
    _priors_floor("levels", "3", median_over_seeds("num_levels"), Gate(3, 3)),
    _priors_floor("floor polygons", "not stated", median_over_seeds("num_polygons")),
    _priors_floor("treads among them", "one each", median_over_seeds("num_treads"), Gate(low=40)),
    Claim(
        *("W8", "weights off N(|dz - dz_poly|; 0.1 m)", "eq. 16", "one_stride"),
        *(largest_over_seeds("weight_off_by"), Gate(high=1e-3)),
    ),
    Claim(
        *("W9", "fast from literal over literal from literal", "1: one filter", "agreement"),
        *(median_over_seeds("distance_ratio"), Gate(high=1.1)),
    ),
    Claim(
        *("W9", "particles, fast over literal", "1: one filter", "agreement"),
        *(median_over_seeds("particles_ratio"), Gate(0.95, 1.05)),
    ),
    Claim(
        *("W10", "particles over the bound for their bins", "1", "priors"),
        *(median_over_seeds("particles_over_bound"), Gate(0.999, 1.001)),
    ),
    Claim(
        *("W9", "particles beyond the bound, share of a generation", "0: one by one", "agreement"),
        *(largest_over_seeds("overshoot_share"), Gate(high=0.02), SHARE),
    ),
)
_PRIOR: Final = (
    Claim(
        *("W11", "particles of the uniform prior", "4 530 000", "track"),
        *(mean_over_seeds("prior_particles", of=at_share(0.5)), Gate.around(4.53e6, 0.1)),
    ),
    Claim("W11", "bins per m² and 10°", "1.44 for 4.53 M", "priors", median_over_seeds("bins_per_m2")),
    Claim(
        *("W12", "particles in 1.1 s, one thread", "274 000", "throughput"),
        *(median_over_seeds("fast_per_stride"), Gate(low=274_000)),
    ),
    Claim(
        *("W12", "the same, literal mode", "274 000", "throughput"),
        *(median_over_seeds("literal_per_stride"), Gate(low=274_000)),
    ),
)
_WLAN: Final = (
    Claim(
        *("W13", "longest extent of a cell", "8 m", "wlan_starts"),
        *(largest_over_seeds("longest_cell_m"), Gate(high=8.0 + 1e-6), "m"),
    ),
    Claim(
        *("W13", "fewest queries in a cell", "20", "wlan_starts"),
        *(median_over_seeds("fewest_queries"), Gate(low=20)),
    ),
    Claim(
        *("W13", "starts where a strong access point was dropped", "not stated", "wlan_starts"),
        *(share_over_seeds("dropped"), None, SHARE),
    ),
    _wlan_starts_share("starts of at most 151 000 particles", "136 000", share_over_seeds("small"), Gate(low=0.8)),
    _wlan_starts_share("walker inside the region", "a key requirement", share_over_seeds("inside"), Gate(low=0.99)),
    _wlan_starts_particles(
        "particles of the WLAN prior, median start", "136 000", median_over_seeds("particles", at_share(0.5))
    ),
    _wlan_starts_particles(
        "access points above -75 dBm, median start", "4", median_over_seeds("num_strong", at_share(0.5))
    ),
)
_CONVERGENCE: Final = (
    *_tracking_clouds("track"),
    _track_clouds_share("single clusters that are the walker's", "all", share_over_seeds("correct_later")),
    _track_clouds_share("walker found at the end", "it is", share_over_seeds("correct_at_end")),
    _strides("W16", "track", "", "not stated"),
    _track_clouds("clouds that died in a run", "not stated", mean_over_seeds("deaths", np.mean)),
    *_other_inputs(),
    Claim(
        *("W18", "bins of the prior over those with a known heading", "36", "priors"),
        *(median_over_seeds("bins_ratio"), Gate(35.9, 36.1)),
    ),
    Claim(
        "W18", "particles with a known heading", "4.53 M / 36", "priors", median_over_seeds("known_heading_particles")
    ),
)
_DRIFT: Final = (
    *_errors_in_wing("track_drift", "drift learned: "),
    *_tracking_clouds("track_drift", "drift learned: "),
    Claim(
        *("W16", "drift learned: walker found at the end", "it is", "track_drift"),
        *(share_over_seeds("correct_at_end"), None, SHARE),
    ),
    _strides("W16", "track_drift", "drift learned: ", "not stated"),
    *_other_inputs("_drift", "drift learned, "),
    Claim(
        "W16",
        "drift learned: clouds that died in a run",
        "not stated",
        "track_drift",
        mean_over_seeds("deaths", np.mean),
    ),
)

REPRODUCTION: Final = Reproduction(
    name="woodman2008",
    paper="O. Woodman, R. Harle: Pedestrian localisation for indoor environments. UbiComp 2008",
    experiments=(
        _measure("track"),
        _measure("track_drift"),
        _measure("track_blind"),
        _measure("track_wlan"),
        _measure("track_blind_drift"),
        _measure("track_wlan_drift"),
        _measure("wlan_starts"),
        _measure("one_stride"),
        _measure("agreement"),
        _measure("priors"),
        _measure("throughput", seeds=3, quick_seeds=1, alone=True),
    ),
    claims=(*_TRACKING, *_ALGORITHM, *_PRIOR, *_WLAN, *_CONVERGENCE, *_DRIFT),
    figures="pdrbench_baselines.woodman2008.figures:draw",
)
