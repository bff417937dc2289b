"""What Woodman & Harle 2008 claim, beside what `experiments` measures (claims W1, W4, W6 to W18)."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.evaluation.reproduction import (
    SHARE,
    Claim,
    Experiment,
    Gate,
    Reproduction,
    at_share,
    largest_over_seeds,
    mean_over_seeds,
    median_over_seeds,
    pooled_percentile,
    share_over_seeds,
)

WALKS: Final = 20  # of the test split


def _measure(name: str, seeds: int = WALKS, quick_seeds: int = 1, *, alone: bool = False) -> Experiment:
    return Experiment(name, f"pdrbench_baselines.woodman2008.experiments:{name}", seeds, quick_seeds, alone)


_TRACKING: Final = (
    Claim(
        *("W1", "error at stances in the wing, 75 %", "0.50 m", "track"),
        *(median_over_seeds("wing_error_m", at_share(0.75)), Gate(high=0.50), "m"),
    ),
    Claim(
        *("W1", "error at stances in the wing, 95 %", "0.73 m", "track"),
        *(median_over_seeds("wing_error_m", at_share(0.95)), Gate(high=0.73), "m"),
    ),
    Claim(
        "W1", "the same, walks pooled, 75 %", "one walk", "track", pooled_percentile("wing_error_m", 0.75), None, "m"
    ),
    Claim(
        "W1", "the same, walks pooled, 95 %", "one walk", "track", pooled_percentile("wing_error_m", 0.95), None, "m"
    ),
    Claim("W1", "pairs of positions in five runs", "845", "track", median_over_seeds("num_pairs")),
    Claim(
        *("W1", "error at all stances, 75 %", "not stated", "track"),
        *(median_over_seeds("error_m", at_share(0.75)), None, "m"),
    ),
    Claim(
        *("W1", "error at all stances, 95 %", "not stated", "track"),
        *(median_over_seeds("error_m", at_share(0.95)), None, "m"),
    ),
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
    Claim(
        *("W6", "live particles outside their polygon", "impassable walls", "one_stride"),
        *(largest_over_seeds("outside"), Gate(high=0)),
    ),
    Claim("W6", "live particles looked at", "not stated", "one_stride", median_over_seeds("looked_at")),
    Claim(
        *("W7", "floor area", "8725 m²", "priors"),
        *(median_over_seeds("area_m2"), Gate.around(8725, 0.01), "m²"),
    ),
    Claim("W7", "levels", "3", "priors", median_over_seeds("num_levels"), Gate(3, 3)),
    Claim("W7", "floor polygons", "not stated", "priors", median_over_seeds("num_polygons")),
    Claim("W7", "treads among them", "one each", "priors", median_over_seeds("num_treads"), Gate(low=40)),
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
        "W13",
        "starts where a strong access point was dropped",
        "not stated",
        "wlan_starts",
        share_over_seeds("dropped"),
        None,
        SHARE,
    ),
    Claim(
        *("W14", "starts of at most 151 000 particles", "136 000", "wlan_starts"),
        *(share_over_seeds("small"), Gate(low=0.8), SHARE),
    ),
    Claim(
        *("W14", "walker inside the region", "a key requirement", "wlan_starts"),
        *(share_over_seeds("inside"), Gate(low=0.99), SHARE),
    ),
    Claim(
        *("W14", "particles of the WLAN prior, median start", "136 000", "wlan_starts"),
        *(median_over_seeds("particles", at_share(0.5)),),
    ),
    Claim(
        *("W14", "access points above -75 dBm, median start", "4", "wlan_starts"),
        *(median_over_seeds("num_strong", at_share(0.5)),),
    ),
)
_CONVERGENCE: Final = (
    Claim(
        *("W15", "particles while tracking, average", "170", "track"),
        *(median_over_seeds("tracking_particles", np.mean), Gate(120, 220)),
    ),
    Claim(
        *("W15", "particles while tracking, maximum", "500", "track"),
        *(median_over_seeds("tracking_particles", np.max), Gate(high=600)),
    ),
    Claim(
        *("W16", "first single cluster is the walker's", "it is", "track"),
        *(share_over_seeds("correct"), Gate(low=0.95), SHARE),
    ),
    Claim(
        "W16", "single clusters that are the walker's", "all", "track", share_over_seeds("correct_later"), None, SHARE
    ),
    Claim("W16", "walker found at the end", "it is", "track", share_over_seeds("correct_at_end"), None, SHARE),
    Claim(
        "W16", "strides to a single cluster", "not stated", "track", median_over_seeds("strides_to_converge", np.median)
    ),
    Claim("W16", "clouds that died in a run", "not stated", "track", mean_over_seeds("deaths", np.mean)),
    Claim(
        *("W16", "with WLAN: first single cluster is the walker's", "it is", "track_wlan"),
        *(share_over_seeds("correct"), Gate(low=0.95), SHARE),
    ),
    Claim(
        *("W16", "with WLAN: strides to a single cluster", "fewer", "track_wlan"),
        *(median_over_seeds("strides_to_converge", np.median),),
    ),
    Claim(
        *("W17", "without heights: strides to a single cluster", "more", "track_blind"),
        *(median_over_seeds("strides_to_converge", np.median),),
    ),
    Claim(
        *("W17", "without heights: it is the walker's", "not stated", "track_blind"),
        *(share_over_seeds("correct"), None, SHARE),
    ),
    Claim(
        *("W18", "bins of the prior over those with a known heading", "36", "priors"),
        *(median_over_seeds("bins_ratio"), Gate(35.9, 36.1)),
    ),
    Claim(
        "W18", "particles with a known heading", "4.53 M / 36", "priors", median_over_seeds("known_heading_particles")
    ),
)
_DRIFT: Final = (
    Claim(
        *("W1", "drift learned: error at stances in the wing, 75 %", "0.50 m", "track_drift"),
        *(median_over_seeds("wing_error_m", at_share(0.75)), Gate(high=0.50), "m"),
    ),
    Claim(
        *("W1", "drift learned: error at stances in the wing, 95 %", "0.73 m", "track_drift"),
        *(median_over_seeds("wing_error_m", at_share(0.95)), Gate(high=0.73), "m"),
    ),
    Claim(
        *("W15", "drift learned: particles while tracking, average", "170", "track_drift"),
        *(median_over_seeds("tracking_particles", np.mean), Gate(120, 220)),
    ),
    Claim(
        *("W15", "drift learned: particles while tracking, maximum", "500", "track_drift"),
        *(median_over_seeds("tracking_particles", np.max), Gate(high=600)),
    ),
    Claim(
        *("W16", "drift learned: first single cluster is the walker's", "it is", "track_drift"),
        *(share_over_seeds("correct"), Gate(low=0.95), SHARE),
    ),
    Claim(
        "W16",
        "drift learned: walker found at the end",
        "it is",
        "track_drift",
        share_over_seeds("correct_at_end"),
        None,
        SHARE,
    ),
    Claim(
        *("W16", "drift learned: strides to a single cluster", "not stated", "track_drift"),
        *(median_over_seeds("strides_to_converge", np.median),),
    ),
    Claim(
        *("W16", "drift learned, with WLAN: first single cluster is the walker's", "it is", "track_wlan_drift"),
        *(share_over_seeds("correct"), Gate(low=0.95), SHARE),
    ),
    Claim(
        *("W16", "drift learned, with WLAN: strides to a single cluster", "fewer", "track_wlan_drift"),
        *(median_over_seeds("strides_to_converge", np.median),),
    ),
    Claim(
        *("W17", "drift learned, without heights: strides to a single cluster", "more", "track_blind_drift"),
        *(median_over_seeds("strides_to_converge", np.median),),
    ),
    Claim(
        *("W17", "drift learned, without heights: it is the walker's", "not stated", "track_blind_drift"),
        *(share_over_seeds("correct"), None, SHARE),
    ),
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
