"""What Li et al. 2012 claim, beside what `experiments` and `steps` measure (L1 to L24)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from pdrbench.evaluation.number_text import SHARE
from pdrbench.evaluation.reproduction import (
    Claim,
    Experiment,
    Gate,
    Measured,
    Numbers,
    Reproduction,
    Value,
    claims_of,
    largest_over_seeds,
    mean_over_seeds,
    median_over_seeds,
    pooled_percentile,
)

PLACES: Final = ("hand", "pocket")
DRAWS: Final = 2000  # of a bootstrap interval: its ends then err by 2 % of its width
BOOTSTRAP_SEED: Final = 2008
STATED_M: Final = {  # L1, Fig. 11: mean, 95th percentile
    ("hand", "alg1"): (2.4, 6.4),
    ("hand", "alg2"): (2.1, 5.1),
    ("hand", "alg3"): (1.5, 4.3),
    ("pocket", "alg1"): (2.9, 8.3),
    ("pocket", "alg2"): (2.5, 6.5),
    ("pocket", "alg3"): (2.0, 4.8),
}
NAMES: Final = {"alg1": "generic, no DTW", "alg2": "generic", "alg3": "personal"}
STEPS: Final = {"warping": ("alg1", "alg2", "DTW"), "personal": ("alg2", "alg3", "a personal model")}
STATED_GAIN: Final = {  # L24
    ("warping", "hand"): 0.13,
    ("warping", "pocket"): 0.14,
    ("personal", "hand"): 0.29,
    ("personal", "pocket"): 0.20,
}
MIN_SEEDS: Final = 5  # seeds that make an interval
GAIN_WITHIN: Final = 0.08
STATED_FALSE_PCT: Final = {"PD": (7.7, 8.9), "PD+H": (1.54, 3.48), "PD+H+DTW": (1.15, 1.29)}  # L8: hand, pocket
STATED_MISSED_PCT: Final = {"PD": (0.0, 0.0), "PD+H": (0.3, 0.5), "PD+H+DTW": (0.4, 0.6)}


def _measure(name: str, seeds: int = 20, quick_seeds: int = 1, of: str = "experiments") -> Experiment:
    return Experiment(name, f"pdrbench_baselines.li2012.{of}:{name}", seeds, quick_seeds)


# Claims of one experiment: what, the paper's statement, and the value.
_failures_m = claims_of("L21", "failures", "m")
_failures = claims_of("L22", "failures")
_failures_pct = claims_of("L23", "failures", "%")
_handling = claims_of("L7", "handling")
_laps_m = claims_of("L1", "laps", "m")
_laps_deg = claims_of("L12", "laps", "°")
_laps_pct = claims_of("L14", "laps", "%")


def _positions() -> tuple[Claim, ...]:
    """L1: means with gates, 95th percentiles beside them; the same where no user taps again; Euclidean errors."""
    claims = []
    for (place, algorithm), (mean_m, p95_m) in STATED_M.items():
        what, key = f"{place}, {NAMES[algorithm]}: error along the path", f"{place}_{algorithm}"
        gate = Gate.around(mean_m, 0.2)
        claims += [
            _laps_m(f"{what}, mean", f"{mean_m:g} m", mean_over_seeds(f"along_{key}_m"), gate),
            _laps_m(f"{what}, 95 %", f"{p95_m:g} m", pooled_percentile(f"errors_{key}_m", 0.95)),
        ]
    for place, algorithm in STATED_M:
        what, key = f"{place}, {NAMES[algorithm]}", f"{place}_{algorithm}"
        claims += [
            Claim(
                *("L2", f"{what}: Euclidean error, mean", "not stated", "laps"),
                *(mean_over_seeds(f"euclid_{key}_m"), None, "m"),
            ),
            _laps_m(
                f"{what}, the lost left alone: error along the path, mean",
                "not stated",
                mean_over_seeds(f"along_{key}_left_m"),
            ),
            _laps_m(
                f"{what}, the lost left alone: mean error of the median lap",
                "not stated",
                median_over_seeds(f"typical_{key}_left_m"),
            ),
        ]
    return tuple(claims)


def _gains() -> tuple[Claim, ...]:
    """L24, of the means over seeds, as the paper has it of its means."""
    claims = []
    for (step, place), stated in STATED_GAIN.items():
        worse, better, what = STEPS[step]
        for kind, words in (("", ""), ("_left", ", the lost left alone")):
            claims.append(
                Claim(
                    *(
                        "L24",
                        f"{place}: mean error less by {what}{words}",
                        "not stated" if kind else f"{100 * stated:.0f} %",
                    ),
                    *("laps", less_by(f"along_{place}_{better}{kind}_m", f"along_{place}_{worse}{kind}_m")),
                    *(None if kind else Gate(stated - GAIN_WITHIN, stated + GAIN_WITHIN), SHARE),
                )
            )
    for place in PLACES:
        claims.append(
            Claim(
                *("L1", f"{place}: algorithms in the order of the paper", "1: they are", "laps"),
                *(in_order([f"along_{place}_{algorithm}_m" for algorithm in NAMES]), Gate(low=1)),
            )
        )
    return tuple(claims)


def in_order(worst_first: Sequence[str]) -> Value:
    """1 where means over seeds fall from each name to the next, else 0; no interval."""

    def value(runs: Sequence[Numbers]) -> Measured:
        mean = np.array([np.mean([float(run[name]) for run in runs]) for name in worst_first])
        return Measured(float((np.diff(mean) < 0).all()))

    return value


def less_by(better: str, worse: str) -> Value:
    """By which fraction one mean over seeds is below another; the interval resamples seeds.

    Args:
        better: Name of a number.
        worse: Name of the number that it is compared with, on the same walks.
    """

    def value(runs: Sequence[Numbers]) -> Measured:
        pairs = np.array([(float(run[better]), float(run[worse])) for run in runs])
        ours = float(1.0 - pairs[:, 0].mean() / pairs[:, 1].mean())
        if len(pairs) < MIN_SEEDS:
            return Measured(ours)
        drawn = pairs[np.random.default_rng(BOOTSTRAP_SEED).integers(len(pairs), size=(DRAWS, len(pairs)))]
        mean = drawn.mean(axis=1)
        low, high = np.quantile(1.0 - mean[:, 0] / mean[:, 1], [0.025, 0.975])
        return Measured(ours, float(low), float(high))

    return value


def _headings() -> tuple[Claim, ...]:
    """L12: in the pocket, without and with the adjustment."""
    claims = []
    for name, paper, mean, p95 in (("plain", "as inferred", 12.0, 32.0), ("adjusted", "adjusted", None, 23.0)):
        key = f"heading_pocket_{name}_deg"
        claims += [
            _laps_deg(
                f"pocket, {paper}: heading error, mean",
                f"{mean:g}°" if mean else "not stated",
                mean_over_seeds(f"heading_mean_pocket_{name}_deg"),
                Gate.around(mean, 0.25) if mean else None,
            ),
            _laps_deg(
                f"pocket, {paper}: heading error, 95 %",
                f"{p95:g}°",
                pooled_percentile(key, 0.95),
                Gate.around(p95, 0.25),
            ),
            _laps_deg(f"pocket, {paper}: heading error, largest", "40°" if mean else "28°", largest_over_seeds(key)),
        ]
    for name, what in (("plain", "as inferred"), ("adjusted", "adjusted")):
        claims.append(
            _laps_deg(
                f"hand, {what}: heading error, 95 %", "not stated", pooled_percentile(f"heading_hand_{name}_deg", 0.95)
            )
        )
    return tuple(claims)


def _steps() -> tuple[Claim, ...]:
    """L7, L8, L9."""
    claims = [_handling("handling: false steps of PD in a minute", "not stated", median_over_seeds("per_min_PD"))]
    for stage, stated, within in (("PD+H", 0.29, 0.10), ("PD+H+DTW", 0.14, 0.07)):
        what, gate = f"handling: false steps of {stage} over those of PD", Gate(stated - within, stated + within)
        claims.append(_handling(what, f"{stated:g}", median_over_seeds(f"share_{stage}"), gate))
    for kind, word, table in (("false", "false", STATED_FALSE_PCT), ("missed", "missed", STATED_MISSED_PCT)):
        for stage, by_place in table.items():
            for place, stated in zip(PLACES, by_place, strict=True):
                within = max(0.5, 0.5 * stated)
                claims.append(
                    Claim(
                        *("L8", f"walking, {place}, {stage}: {word} steps", f"{stated:g} %", "walking"),
                        *(
                            mean_over_seeds(f"{kind}_pct_{stage}_{place}"),
                            Gate(max(0.0, stated - within), stated + within),
                            "%",
                        ),
                    )
                )
    for place, stated in zip(PLACES, (1.6, 1.1), strict=True):
        claims.append(
            Claim(
                *("L9", f"walking, {place}: error of the count", f"{stated:g} %", "walking"),
                *(mean_over_seeds(f"count_error_pct_{place}"), Gate(high=2.0), "%"),
            )
        )
    return tuple(claims)


_LEARNING: Final = (
    Claim("L14", "generic model: a", "not stated", "laps", median_over_seeds("generic_a"), None, "m/Hz"),
    Claim("L14", "generic model: b", "not stated", "laps", median_over_seeds("generic_b"), None, "m"),
    _laps_pct(
        "steps of the generic model over true ones, mean of people",
        "not stated",
        mean_over_seeds("generic_mean_off_pct"),
    ),
    _laps_pct("the same, standard deviation over people", "not stated", mean_over_seeds("generic_sigma_pct")),
    _failures("generic: failures in 40 laps", "17", mean_over_seeds("generic"), Gate.around(17, 0.5)),
    _failures("personal: failures in 40 laps", "3", mean_over_seeds("personal"), Gate.around(3, 0.5)),
    _failures_pct("step length error before a turn", "a figure", mean_over_seeds("first_error_pct")),
    _failures_pct("step length error after two turns", "a figure", mean_over_seeds("two_turns_error_pct")),
    _failures_pct("step length error after four turns and more", "stable", mean_over_seeds("late_error_pct")),
    Claim(
        *("L23", "part of the step length error that is gone after two turns", "converges quickly", "failures"),
        *(median_over_seeds("gone_after_two_turns"), Gate(low=0.5), SHARE),
    ),
    _failures_m(
        "another lap, model of an earlier walk: error along the path", "not stated", mean_over_seeds("stored_mean_m")
    ),
    _failures_m("the same lap with the generic model at first", "not stated", mean_over_seeds("fresh_mean_m")),
)


def _variants() -> tuple[Claim, ...]:
    """What L1 owes to what the paper leaves open."""
    claims = []
    for name, what in (
        ("steep", "K = 5 instead of 1"),
        ("narrow", "models spread half as wide"),
        ("doors", "doors open"),
    ):
        for place in PLACES:
            claims.append(
                Claim(
                    *("L1", f"{what}: {place}, personal: error along the path, mean", "left open", "variants"),
                    *(mean_over_seeds(f"along_{place}_{name}_m"), None, "m"),
                )
            )
    for name, algorithm in (("generic, no DTW", "alg1"), ("generic", "alg2"), ("personal", "alg3")):
        claims.append(
            Claim(
                *("L1", f"handled before: hand, {name}: error along the path, mean", "left open", "handled"),
                *(mean_over_seeds(f"along_handled_{algorithm}_m"), None, "m"),
            )
        )
    claims.append(
        Claim(
            *("L12", "K = 5 instead of 1: pocket, adjusted: heading error, 95 %", "left open", "variants"),
            *(pooled_percentile("heading_steep_pocket_adjusted_deg", 0.95), None, "°"),
        )
    )
    return tuple(claims)


REPRODUCTION: Final = Reproduction(
    name="li2012",
    paper="F. Li, C. Zhao, G. Ding, J. Gong, C. Liu, F. Zhao: A reliable and accurate indoor localization method using "
    "phone inertial sensors. UbiComp 2012",
    experiments=(
        _measure("failures"),
        _measure("laps"),
        _measure("variants"),
        _measure("handled"),
        _measure("walking", of="steps"),
        _measure("handling", of="steps"),
    ),
    claims=(*_positions(), *_gains(), *_LEARNING, *_headings(), *_steps(), *_variants()),
    figures="pdrbench_baselines.li2012.figures:draw",
)
