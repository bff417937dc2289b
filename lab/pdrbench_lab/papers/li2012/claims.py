"""What Li et al. 2012 claim, beside what `experiments` and `steps` measure (L1 to L24)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench_lab.papers.li2012.paper_size import (
    Sample,
    gated,
    less_than,
    mean_of,
    mean_of_steps,
    percent_of,
    percentile_of_steps,
)
from pdrbench_lab.reproduce.number_text import SHARE
from pdrbench_lab.reproduce.reproduction import (
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
    ratio_over_seeds,
)

PLACES: Final = ("hand", "pocket")
LAPS: Final = 20  # L1, by 13 people: as if of 20, so that gates are rather too narrow
HEADINGS: Final = 5  # L12, people; how often each walked is not stated
LOST: Final = 10  # L22, people with four laps each
PHONES: Final = 8  # L7, people; L8 and L9 say "all subjects"
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
SHOWN: Final = 10  # seeds of what has no gate
MIN_CHANCE: Final = 0.05  # that a sample of the paper's size comes out as the paper's did
STATED_FALSE_PCT: Final = {"PD": (7.7, 8.9), "PD+H": (1.54, 3.48), "PD+H+DTW": (1.15, 1.29)}  # L8: hand, pocket
STATED_MISSED_PCT: Final = {"PD": (0.0, 0.0), "PD+H": (0.3, 0.5), "PD+H+DTW": (0.4, 0.6)}


def _measure(name: str, seeds: int = 20, quick_seeds: int = 1, of: str = "experiments") -> Experiment:
    return Experiment(name, f"pdrbench_lab.papers.li2012.{of}:{name}", seeds, quick_seeds)


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
        tolerance = Gate.around(mean_m, 0.2)
        value = gated(mean_over_seeds(f"along_{key}_m"), _lap_sample(key), mean_m, 0.1, tolerance)
        claims += [
            _laps_m(f"{what}, mean", f"{mean_m:g} m", value, tolerance),
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


def _lap_sample(*keys: str) -> Sample:
    """L1: twenty laps, each with its sum of errors and its number of steps, of one algorithm or of two."""
    names = tuple(name for key in keys for name in (f"by_lap_{key}_m", f"steps_{key}"))
    return Sample(LAPS, names, mean_of if len(keys) == 1 else less_than)


def _gains() -> tuple[Claim, ...]:
    """L24, of the means over seeds, as the paper has it of its means."""
    claims = []
    for (step, place), stated in STATED_GAIN.items():
        worse, better, what = STEPS[step]
        for kind, words in (("", ""), ("_left", ", the lost left alone")):
            keys = f"{place}_{better}{kind}", f"{place}_{worse}{kind}"
            value, tolerance = less_by(*(f"along_{key}_m" for key in keys)), Gate(stated - 0.08, stated + 0.08)
            claims.append(
                Claim(
                    *(
                        "L24",
                        f"{place}: mean error less by {what}{words}",
                        "not stated" if kind else f"{100 * stated:.0f} %",
                    ),
                    *("laps", value if kind else gated(value, _lap_sample(*keys), stated, 0.01, tolerance)),
                    *(None if kind else tolerance, SHARE),
                )
            )
    for place in PLACES:
        of_place = [f"{place}_{algorithm}" for algorithm in NAMES]
        claims += [
            Claim(
                *("L1", f"{place}: twenty laps that have the algorithms in the order of the paper", "they are", "laps"),
                *(in_order(of_place), Gate(low=MIN_CHANCE), SHARE),
            ),
            Claim(
                *("L1", f"{place}: all laps have the algorithms in the order of the paper", "1: they are", "laps"),
                all_in_order(of_place),
            ),
        ]
    return tuple(claims)


def _is_in_order(*sums_and_counts: FloatArray) -> FloatArray:
    means = [mean_of(*pair) for pair in zip(sums_and_counts[::2], sums_and_counts[1::2], strict=True)]
    return np.asarray(np.all([worse > better for worse, better in pairwise(means)], axis=0), dtype=np.float64)


def _order_sample(worst_first: Sequence[str]) -> Sample:
    return replace(_lap_sample(*worst_first), statistic=_is_in_order)


def in_order(worst_first: Sequence[str]) -> Value:
    """Fraction of samples of the paper's size in which means over steps fall from each algorithm to the next."""
    return lambda runs: Measured(float(_order_sample(worst_first).drawn(runs).mean()))


def all_in_order(worst_first: Sequence[str]) -> Value:
    """1 where those of all laps do, else 0."""
    return lambda runs: Measured(_order_sample(worst_first).of_all(runs))


def less_by(better: str, worse: str) -> Value:
    """By which fraction one mean over seeds is below another.

    Args:
        better: Name of a number.
        worse: Name of the number that it is compared with, on the same walks.
    """
    ratio = ratio_over_seeds(better, worse)

    def value(runs: Sequence[Numbers]) -> Measured:
        found = ratio(runs)
        return Measured(1 - found.ours, 1 - found.high, 1 - found.low)

    return value


def _headings() -> tuple[Claim, ...]:
    """L12: in the pocket, without and with the adjustment."""
    claims = []
    for name, paper, mean, p95 in (("plain", "as inferred", 12.0, 32.0), ("adjusted", "adjusted", None, 23.0)):
        key, steps = f"heading_pocket_{name}_deg", "heading_steps_pocket"
        value = mean_over_seeds(f"heading_mean_pocket_{name}_deg")
        if mean:
            value = gated(value, Sample(HEADINGS, (key,), mean_of_steps, steps), mean, 1.0, Gate.around(mean, 0.25))
        at_95 = Sample(HEADINGS, (key,), percentile_of_steps(0.95), steps)
        claims += [
            _laps_deg(
                f"pocket, {paper}: heading error, mean",
                f"{mean:g}°" if mean else "not stated",
                value,
                Gate.around(mean, 0.25) if mean else None,
            ),
            _laps_deg(
                f"pocket, {paper}: heading error, 95 %",
                f"{p95:g}°",
                gated(pooled_percentile(key, 0.95), at_95, p95, 1.0, Gate.around(p95, 0.25)),
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


def _mean(values: FloatArray) -> FloatArray:
    return np.asarray(values.mean(axis=1))


def _steps() -> tuple[Claim, ...]:
    """L7, L8, L9."""
    claims = [_handling("handling: false steps of PD in a minute", "not stated", median_over_seeds("per_min_PD"))]
    for stage, stated, within in (("PD+H", 0.29, 0.10), ("PD+H+DTW", 0.14, 0.07)):
        what, gate = f"handling: false steps of {stage} over those of PD", Gate(stated - within, stated + within)
        claims.append(_handling(what, f"{stated:g}", median_over_seeds(f"share_{stage}"), gate))
    for kind, word, table in (("false", "false", STATED_FALSE_PCT), ("missed", "missed", STATED_MISSED_PCT)):
        for stage, by_place in table.items():
            for place, stated in zip(PLACES, by_place, strict=True):
                of, what = f"{stage}_{place}", f"walking, {place}, {stage}: {word} steps"
                sample = Sample(PHONES, (f"{kind}_{of}", f"made_{of}"), percent_of)
                resolution = 0.01 if stated > 1 and stage != "PD" else 0.1  # as Table 2 is printed
                within = max(0.5, 0.5 * stated)
                tolerance = Gate(max(0.0, stated - within), stated + within)
                value = gated(mean_over_seeds(f"{kind}_pct_{of}"), sample, stated, resolution, tolerance)
                claims.append(Claim("L8", what, f"{stated:g} %", "walking", value, tolerance, "%"))
    for place, stated in zip(PLACES, (1.6, 1.1), strict=True):
        of, what = f"count_error_pct_{place}", f"walking, {place}: error of the count"
        sample, tolerance = Sample(PHONES, (f"miscount_pct_{place}",), _mean), Gate(high=2.0)
        value = gated(mean_over_seeds(of), sample, stated, 0.1, tolerance)
        claims.append(Claim("L9", what, f"{stated:g} %", "walking", value, tolerance, "%"))
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
    *(
        _failures(
            *(f"{name}: failures in 40 laps", f"{stated}"),
            gated(
                mean_over_seeds(name),
                Sample(LOST, (f"{name}_by_person",), lambda failed: LOST * failed.mean(axis=1)),
                stated,
                1.0,
                Gate.around(stated, 0.5),
            ),
            Gate.around(stated, 0.5),
        )
        for name, stated in (("generic", 17), ("personal", 3))
    ),
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
        ("literal", "as in the paper, same laps"),
        ("steep", "K = 5 instead of 1"),
        ("narrow", "models spread half as wide"),
        ("doors", "doors open"),
        ("inherits", "who hits a wall takes another's model on the straight as well"),
    ):
        for place in PLACES:
            claims.append(
                Claim(
                    *("L1", f"{what}: {place}, personal: error along the path, mean", "left open", "variants"),
                    *(mean_over_seeds(f"along_{place}_{name}_m"), None, "m"),
                )
            )
            if name != "doors":
                part = f"{what}: {place}, part of the step length error that is gone after two turns"
                value = median_over_seeds(f"gone_{place}_{name}")
                claims.append(Claim("L23", part, "left open", "variants", value, None, SHARE))
    for place, algorithm in STATED_M:
        what = f"users tap again at 12 m: {place}, {NAMES[algorithm]}: error along the path, mean"
        value = mean_over_seeds(f"along_{place}_{algorithm}_patient_m")
        claims.append(Claim("L1", what, "left open", "patience", value, None, "m"))
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
        _measure("variants", SHOWN),
        _measure("patience", SHOWN),
        _measure("handled", SHOWN),
        _measure("walking", of="steps"),
        _measure("handling", of="steps"),
    ),
    claims=(*_positions(), *_gains(), *_LEARNING, *_headings(), *_steps(), *_variants()),
    figures="pdrbench_lab.papers.li2012.figures:draw",
)
