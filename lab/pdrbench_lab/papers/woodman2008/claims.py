"""What Woodman & Harle 2008 claim, beside what `experiments` measures (claims W1, W4, W6 to W18)."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench_lab.papers.woodman2008.misses import RADIO
from pdrbench_lab.reproduce.number_text import SHARE
from pdrbench_lab.reproduce.reproduction import Claim, Experiment, Gate, Reproduction, at_quantile, pooled_percentile
from pdrbench_lab.reproduce.reproduction import fraction_over_seeds as fraction_of
from pdrbench_lab.reproduce.reproduction import largest_over_seeds as largest
from pdrbench_lab.reproduce.reproduction import mean_over_seeds as mean
from pdrbench_lab.reproduce.reproduction import median_over_seeds as median

WALKS: Final = 20  # of the test split
near = Gate.around


def _measure(name: str, seeds: int = WALKS, *, of: str = "experiments", alone: bool = False) -> Experiment:
    return Experiment(name, f"pdrbench_lab.papers.woodman2008.{of}:{name}", seeds, quick_seeds=1, alone=alone)


_track, _track_drift = _measure("track"), _measure("track_drift")
_blind, _wlan = _measure("track_blind"), _measure("track_wlan")
_blind_drift, _wlan_drift = _measure("track_blind_drift"), _measure("track_wlan_drift")
_starts, _stride, _agreement = _measure("wlan_starts"), _measure("one_stride"), _measure("agreement")
_priors, _throughput = _measure("priors"), _measure("throughput", seeds=3, alone=True)
_tracking, _search, _radio = (_measure(name, 10, of="misses") for name in ("tracking", "search", "radio"))


def _errors_in_wing(track: Experiment, variant: str = "") -> tuple[Claim, ...]:
    """W1, of one variant of the filter."""
    return tuple(
        track.claim(
            *("W1", f"{variant}error at stances in the wing, {100 * fraction:.0f} %", f"{stated_m:.2f} m"),
            *(median("wing_error_m", at_quantile(fraction)), Gate(high=stated_m), "m"),
        )
        for fraction, stated_m in ((0.75, 0.50), (0.95, 0.73))
    )


def _tracking_clouds(track: Experiment, variant: str = "") -> tuple[Claim, ...]:
    """W15, and whether the first single cluster of W16 is the walker's."""
    average, largest = (median("tracking_particles", of) for of in (np.mean, np.max))
    of_all, most_of_all = (median("converged_particles", of) for of in (np.mean, np.max))
    return (
        track.claim("W15", f"{variant}particles while tracking, average", "170", average, Gate(120, 220)),
        track.claim("W15", f"{variant}particles while tracking, maximum", "500", largest, Gate(high=600)),
        track.claim("W15", f"{variant}particles of any single cluster, average", "not stated", of_all),
        track.claim("W15", f"{variant}particles of any single cluster, maximum", "not stated", most_of_all),
        _first_is_walker(track, f"{variant}first single cluster is the walker's"),
    )


def _first_is_walker(track: Experiment, what: str) -> Claim:
    return track.claim("W16", what, "it is", fraction_of("correct"), Gate(low=0.95), SHARE)


def _strides(id_: str, track: Experiment, variant: str, paper: str) -> Claim:
    value = median("strides_to_converge", np.median)
    return track.claim(id_, f"{variant}strides to a single cluster", paper, value)


def _other_inputs(wlan: Experiment, blind: Experiment, variant: str = "") -> tuple[Claim, ...]:
    """W16 with WLAN and W17 without heights."""
    what = f"{variant}without heights: it is the walker's"
    return (
        _first_is_walker(wlan, f"{variant}with WLAN: first single cluster is the walker's"),
        _strides("W16", wlan, f"{variant}with WLAN: ", "fewer"),
        _strides("W17", blind, f"{variant}without heights: ", "more"),
        blind.claim("W17", what, "not stated", fraction_of("correct"), None, SHARE),
    )


_FOUND: Final = "runs whose first single cluster is the walker's"
_TRACKING: Final = (
    *_errors_in_wing(_track),
    _track.claim("W1", "the same, walks pooled, 75 %", "one walk", pooled_percentile("wing_error_m", 0.75), None, "m"),
    _track.claim("W1", "the same, walks pooled, 95 %", "one walk", pooled_percentile("wing_error_m", 0.95), None, "m"),
    *(
        _track.claim(
            *("W1", f"{_FOUND}: error in the wing, {100 * fraction:.0f} %", "not stated"),
            *(median("wing_error_found_m", at_quantile(fraction)), None, "m"),
        )
        for fraction in (0.75, 0.95)
    ),
    _track.claim("W1", "pairs of positions in five runs", "845", median("num_pairs")),
    _track.claim("W1", "error at all stances, 75 %", "not stated", median("error_m", at_quantile(0.75)), None, "m"),
    _track.claim("W1", "error at all stances, 95 %", "not stated", median("error_m", at_quantile(0.95)), None, "m"),
)
_ALGORITHM: Final = (
    _stride.claim("W4", "noise on the length of a stride", "0.15 m", median("length_sigma_m"), near(0.15, 0.02), "m"),
    _stride.claim("W4", "noise on the change of heading", "0.6°", median("turn_sigma_deg"), near(0.6, 0.02), "°"),
    _stride.claim(
        *("W4", "strides of no length that go backwards", "l' = l + X"),
        *(median("fraction_backwards"), Gate(0.48, 0.52), SHARE),
    ),
    _stride.claim("W6", "live particles outside their polygon", "impassable walls", largest("outside"), Gate(high=0)),
    _stride.claim("W6", "live particles looked at", "not stated", median("looked_at")),
    _priors.claim("W7", "floor area", "8725 m²", median("area_m2"), near(8725, 0.01), "m²"),
    _priors.claim("W7", "levels", "3", median("num_levels"), Gate(3, 3)),
    _priors.claim("W7", "floor polygons", "not stated", median("num_polygons")),
    _priors.claim("W7", "treads among them", "one each", median("num_treads"), Gate(low=40)),
    _stride.claim("W8", "weights off N(|dz - dz_poly|; 0.1 m)", "eq. 16", largest("weight_off_by"), Gate(high=1e-3)),
    _agreement.claim(
        *("W9", "fast from literal over literal from literal", "1: one filter"),
        *(median("distance_ratio"), Gate(high=1.1)),
    ),
    _agreement.claim(
        "W9", "particles, fast over literal", "1: one filter", median("particles_ratio"), Gate(0.95, 1.05)
    ),
    _priors.claim(
        "W10", "particles over the bound for their bins", "1", median("particles_over_bound"), Gate(0.999, 1.001)
    ),
    _agreement.claim(
        *("W9", "particles beyond the bound, fraction of a generation", "0: one by one"),
        *(largest("overshoot_fraction"), Gate(high=0.02), SHARE),
    ),
)
_PRIOR: Final = (
    _track.claim(
        *("W11", "particles of the uniform prior", "4 530 000"),
        *(mean("prior_particles", of=at_quantile(0.5)), near(4.53e6, 0.1)),
    ),
    _priors.claim("W11", "bins per m² and 10°", "1.44 for 4.53 M", median("bins_per_m2")),
    _throughput.claim("W12", "particles in 1.1 s, one thread", "274 000", median("fast_per_stride"), Gate(low=274_000)),
    _throughput.claim("W12", "the same, literal mode", "274 000", median("literal_per_stride"), Gate(low=274_000)),
)
_WLAN: Final = (
    _starts.claim("W13", "longest extent of a cell", "8 m", largest("longest_cell_m"), Gate(high=8.0 + 1e-6), "m"),
    _starts.claim("W13", "fewest queries in a cell", "20", median("fewest_queries"), Gate(low=20)),
    _starts.claim(
        *("W13", "starts where a strong access point was dropped", "not stated"), *(fraction_of("dropped"), None, SHARE)
    ),
    _starts.claim(
        *("W14", "starts of at most 151 000 particles", "136 000"), *(fraction_of("small"), Gate(low=0.8), SHARE)
    ),
    _starts.claim("W14", "walker inside the region", "a key requirement", fraction_of("inside"), Gate(low=0.99), SHARE),
    _starts.claim("W14", "particles of the WLAN prior, median start", "136 000", median("particles", at_quantile(0.5))),
    _starts.claim(
        "W14",
        "starts of four access points above -75 dBm: particles",
        "136 000",
        pooled_percentile("particles_of_four", 0.5),
    ),
    _starts.claim("W14", "access points above -75 dBm, median start", "4", median("num_strong", at_quantile(0.5))),
)
_CONVERGENCE: Final = (
    *_tracking_clouds(_track),
    _track.claim("W16", "single clusters that are the walker's", "all", fraction_of("correct_later"), None, SHARE),
    _track.claim("W16", "walker found at the end", "it is", fraction_of("correct_at_end"), None, SHARE),
    _strides("W16", _track, "", "not stated"),
    _track.claim("W16", "clouds that died in a run", "not stated", mean("deaths", np.mean)),
    *_other_inputs(_wlan, _blind),
    _priors.claim(
        *("W18", "bins of the prior over those with a known heading, as many particles a bin", "36"),
        *(median("bins_ratio"), Gate(35.9, 36.1)),
    ),
    _priors.claim("W18", "the same, as many particles as KLD sampling draws", "36", median("drawn_bins_ratio")),
    _priors.claim("W18", "particles with a known heading", "4.53 M / 36", median("known_heading_particles")),
)
_DRIFT: Final = (
    *_errors_in_wing(_track_drift, "drift learned: "),
    *_tracking_clouds(_track_drift, "drift learned: "),
    _track_drift.claim(
        *("W16", "drift learned: walker found at the end", "it is"), *(fraction_of("correct_at_end"), None, SHARE)
    ),
    _strides("W16", _track_drift, "drift learned: ", "not stated"),
    *_other_inputs(_wlan_drift, _blind_drift, "drift learned, "),
    _track_drift.claim("W16", "drift learned: clouds that died in a run", "not stated", mean("deaths", np.mean)),
)

_COUNTED: Final = {
    "paper": "from a known start",
    "delta_001": "delta 0.01",
    "delta_01": "delta 0.1",
    "live": "only particles that live count in bins",
    "exact": "strides without errors",
    "literal": "literal filter",
}
_CHANGED: Final = {
    "exact": "strides without errors",
    "straight": "strides without the turn that all of a walk have in common",
    "many": "twice as many particles",
    "exact_many": "twice as many particles, strides without errors",
    "waits": "a single cluster that has lasted for twenty strides",
}
_MISSES: Final = (
    *(
        _tracking.claim("W15", f"{words}: particles while tracking, {what}", stated, median(f"{key}_{name}"))
        for name, words in _COUNTED.items()
        for key, what, stated in (("average", "average", "170"), ("largest", "maximum", "500"))
    ),
    *(
        _search.claim(
            *("W16", f"{words}: first single cluster is the walker's", "it is"),
            *(fraction_of(f"correct_{name}"), None, SHARE),
        )
        for name, words in _CHANGED.items()
    ),
    *(
        _radio.claim("W14", f"{area_m2} m² an access point, {detection_dbm} dBm: {what}", stated, value, None, unit)
        for area_m2, detection_dbm in RADIO
        for what, stated, value, unit in (
            (
                *("starts of at most 151 000 particles", "136 000"),
                *(fraction_of(f"small_{area_m2}_{-detection_dbm}"), SHARE),
            ),
            (
                *("access points above -75 dBm, median start", "4"),
                *(median(f"num_strong_{area_m2}_{-detection_dbm}", at_quantile(0.5)), ""),
            ),
            (
                *("particles, starts of four", "136 000"),
                *(pooled_percentile(f"particles_of_four_{area_m2}_{-detection_dbm}", 0.5), ""),
            ),
        )
    ),
)

REPRODUCTION: Final = Reproduction(
    name="woodman2008",
    paper="O. Woodman, R. Harle: Pedestrian localisation for indoor environments. UbiComp 2008",
    experiments=(
        *(_track_drift, _search, _track, _blind, _wlan, _blind_drift, _wlan_drift),
        *(_tracking, _radio, _starts, _stride, _agreement, _priors, _throughput),
    ),
    claims=(*_TRACKING, *_ALGORITHM, *_PRIOR, *_WLAN, *_CONVERGENCE, *_DRIFT, *_MISSES),
    figures="pdrbench_lab.papers.woodman2008.figures:draw",
)
