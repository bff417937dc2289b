"""What is claimed of inertial navigation on the foot, beside what is measured (claims W2, W3, F6 to F8)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench_lab.foot_ins import disturbed, left_out
from pdrbench_lab.foot_ins.experiments import LOOPS, SHORT, VICON, WALKS
from pdrbench_lab.reproduce import reproduction
from pdrbench_lab.reproduce.number_text import SHARE
from pdrbench_lab.reproduce.reproduction import (
    Claim,
    Experiment,
    Gate,
    Reproduction,
    Value,
    claims_of,
    largest_over_seeds,
    mean_over_seeds,
    median_over_seeds,
)

# Walks of one set are of one unit (`Task.units`), so that no set has an interval until it has four.
mean_over_walks = partial(reproduction.mean_over_walks, units="unit")
median_over_walks = partial(reproduction.median_over_walks, units="unit")
LOWER: Final = Gate(high=0.999)  # of a ratio: what is lower than one and not merely rounded


def _measure(name: str, *envs: str) -> Experiment:
    """The recordings and the filters draw nothing: one seed says all."""
    return Experiment(name, f"pdrbench_lab.foot_ins.experiments:{name}", seeds=1, quick_seeds=1, envs=envs)


def _shown(id_: str, what: str, paper: str, experiment: str, value: Value, unit: str = "") -> Claim:
    return Claim(id_, what, paper, experiment, value, None, unit)


def _median_size(values: FloatArray) -> float:
    return float(np.median(np.abs(values)))


# Claims of one experiment: what, the paper's statement, and the value.
_capture_labels = claims_of("F7", "capture_labels")
_capture_labels_m = claims_of("F7", "capture_labels", "m")
_capture_played_m = claims_of("F7", "capture_played", "m")
_loops_played_pct = claims_of("F7", "loops_played", "%")
_loops_played_m = claims_of("F7", "loops_played", "m")
_short_played_m = claims_of("F7", "short_played", "m")
_step_sensor_m = claims_of("F8", "step_sensor", "m")
_strides_measured = claims_of("W2", "strides_measured")
_strides_measured_m = claims_of("W3", "strides_measured", "m")
_strides_measured_share = claims_of("W3", "strides_measured", SHARE)
_walks_played_m = claims_of("F7", "walks_played", "m")

_LABELS: Final = (
    _capture_labels_m(
        "motion capture, rests as labelled (SHOE): mean RMSE",
        "0.078 m of all 56",
        mean_over_walks("labels_shoe_m"),
        Gate(high=0.09),
    ),
    *(
        _capture_labels_m(f"the same, {name} labels", "not stated", mean_over_walks(f"labels_{key}_m"))
        for name, key in (("ARE", "ared"), ("MV", "amvd"), ("MAG", "mbgtd"), ("motion capture's", "vicon"))
    ),
    _capture_labels_m("published error of SHOE, per axis: mean", "0.059 m of all 56", mean_over_walks("published_m")),
    _capture_labels_m(
        "published error of SHOE, per axis: median trial", "0.049 m of all 56", median_over_walks("published_m")
    ),
    _capture_labels_m("in the same reading, rests as labelled: mean", "as above", mean_over_walks("labels_axis_m")),
    _capture_labels_m(
        "in the same reading, one threshold for all trials: mean", "tuned by trial", mean_over_walks("literal_axis_m")
    ),
    _capture_labels_m(
        "one threshold for all trials: median trial", "tuned by trial", median_over_walks("literal_axis_m")
    ),
    _capture_labels_m("one threshold, less published: median trial", "0 m", median_over_walks("axis_difference_m")),
    _capture_labels(
        "one threshold against published: correlation over trials", "1", median_over_seeds("axis_correlation")
    ),
)
_DETECTORS: Final = (
    *(
        _shown(
            "F6",
            f"motion capture, literal filter, {name}: mean RMSE",
            "not stated",
            "capture_labels",
            mean_over_walks(f"{key}_m"),
            "m",
        )
        for name, key in (
            *(("SHOE", "shoe"), ("ARE", "are"), ("MV", "mv"), ("MAG", "mag")),
            *(("interval (Frank)", "interval"), ("soft", "soft")),
        )
    ),
    *(
        _shown("F6", f"motion capture, {key}: mean ATE", "not stated", "capture_played", mean_over_walks(key), "m")
        for key in ("foot_ins", "foot_ins_are", "foot_ins_mv", "foot_ins_mag", "foot_ins_interval")
    ),
    *(
        _shown("F6", f"share of the loops at rest, {name}", "0.33 in stance", "rests", mean_over_walks(name), SHARE)
        for name in ("shoe", "are", "mv", "mag", "interval", "soft")
    ),
)
_ADAPTIVE: Final = (
    _capture_played_m(
        "motion capture, adaptive: mean ATE",
        "one set of defaults",
        mean_over_walks("foot_ins_adaptive"),
        Gate(high=0.15),
    ),
    _capture_played_m(
        "motion capture, adaptive: worst trial",
        "one set of defaults",
        largest_over_seeds("foot_ins_adaptive"),
        Gate(high=0.6),
    ),
    _capture_labels_m(
        "motion capture, adaptive filter in its own frame: mean RMSE", "not stated", mean_over_walks("adaptive_m")
    ),
    _loops_played_pct(
        "loops, adaptive: horizontal closure, worst loop",
        "0.43 %: literal",
        largest_over_seeds("foot_ins_adaptive"),
        Gate(high=1.0),
    ),
    _loops_played_pct(
        "loops, adaptive: horizontal closure, median",
        "0.43 %: literal",
        median_over_walks("foot_ins_adaptive"),
        Gate(high=0.45),
    ),
    _loops_played_pct("loops, literal: horizontal closure, median", "0.43 %", median_over_walks("foot_ins")),
    _loops_played_m("loops, adaptive: closure in height, mean", "not stated", mean_over_walks("adaptive_height_m")),
    _loops_played_m("loops, literal: closure in height, mean", "0.58 m to 0.70 m", mean_over_walks("literal_height_m")),
    _walks_played_m(
        "walks 31, 32, 33, 36, adaptive: worst ATE at strides",
        "one set of defaults",
        largest_over_seeds("foot_ins_adaptive_walks"),
        Gate(high=0.35),
    ),
    _walks_played_m(
        "runs 34, 35, adaptive: worse ATE at strides",
        "one set of defaults",
        largest_over_seeds("foot_ins_adaptive_runs"),
        Gate(high=3.0),
    ),
    _walks_played_m(
        "other walks and runs, adaptive: worst ATE at strides",
        "not registered",
        largest_over_seeds("foot_ins_adaptive_others"),
    ),
    _walks_played_m(
        "runs 34, 35, literal: worse ATE at strides", "breaks: 2.5 m to 59 m", largest_over_seeds("foot_ins_runs")
    ),
    _short_played_m("short loop, literal: gap in space", "82 mm: theirs", mean_over_walks("literal_m")),
    _short_played_m("short loop, literal: in the plane", "not stated", mean_over_walks("literal_flat_m")),
    _short_played_m("short loop, adaptive: gap in space", "82 mm: theirs", mean_over_walks("adaptive_m")),
    _short_played_m("short loop, adaptive: in the plane", "not stated", mean_over_walks("adaptive_flat_m")),
    *(
        Claim("F7", f"{where}: walks that failed", "0", name, largest_over_seeds("failed"), Gate(high=0))
        for where, name in (
            *(("motion capture", "capture_played"), ("walks", "walks_played")),
            *(("loops", "loops_played"), ("short loop", "short_played")),
        )
    ),
)
_SMOOTHER: Final = (
    Claim(
        *("F7", "smoother, motion capture: mean ATE over that of the filter", "lower", "capture_played"),
        *(median_over_seeds("smoothed_share"), LOWER),
    ),
    _capture_played_m("smoother, motion capture: mean ATE", "not stated", mean_over_walks("foot_ins_smooth")),
    Claim(
        *("F7", "smoother, walks and runs: mean ATE over that of the filter", "lower", "walks_played"),
        *(median_over_seeds("smoothed_share"), LOWER),
    ),
    _walks_played_m("smoother, walks and runs: mean ATE", "not stated", mean_over_walks("foot_ins_smooth")),
    _capture_labels(
        "smoother, literal filter: mean RMSE over that of the filter",
        "lower",
        median_over_seeds("smoothed_share"),
        LOWER,
    ),
    _shown(
        *("F7", "smoother, loops: mean closure over that of the filter", "1: nothing comes after the end"),
        *("loops_played", median_over_seeds("smoothed_share")),
    ),
    _shown(
        *("F7", "smoother, short loop: closure over that of the filter", "1: nothing comes after the end"),
        *("short_played", median_over_seeds("smoothed_share")),
    ),
)
_CONSISTENCY: Final = tuple(
    _shown("F7", f"motion capture, {name}: {what}", "1", "capture_consistency", value)
    for name in ("literal", "adaptive")
    for what, value in (
        ("NEES of the position, mean trial", mean_over_walks(f"{name}_nees")),
        ("NEES of the position, median trial", median_over_walks(f"{name}_nees")),
        ("NIS of zero velocities, mean trial", mean_over_walks(f"{name}_nis")),
    )
)
_STRIDES: Final = (
    _strides_measured_m(
        "strides: median error of length, without sign",
        "1 cm to 2 cm",
        median_over_seeds("length_error_m", np.median),
        Gate(high=0.02),
    ),
    _strides_measured_m("walking: mean error of length", "not stated", median_over_seeds("rolling_walks_m", np.mean)),
    _strides_measured_m(
        "walking: median error of length", "not stated", median_over_seeds("rolling_walks_m", np.median)
    ),
    _strides_measured_m(
        "walking, as if the unit lay on the floor: median error of length",
        "-1.9 %: a foot rolls",
        median_over_seeds("still_walks_m", np.median),
    ),
    _strides_measured_share("the same, share", "-1.9 %", median_over_seeds("still_walks_share", np.median)),
    _strides_measured_share(
        "walking, with the roll: median error of length, share",
        "0",
        median_over_seeds("rolling_walks_share", np.median),
    ),
    _strides_measured_m(
        "running: median error of length", "not stated", median_over_seeds("rolling_runs_m", np.median)
    ),
    _strides_measured_share("surveyed strides that were found, walking", "1", mean_over_seeds("found_walks", np.mean)),
    _strides_measured_share("surveyed strides that were found, running", "1", mean_over_seeds("found_runs", np.mean)),
    _shown(
        "W3",
        "walking: error of the change of heading, median without sign",
        "0.6° (W4)",
        "strides_measured",
        median_over_seeds("turn_walks_deg", _median_size),
        "°",
    ),
    _strides_measured(
        "literal, error of the distance against strides: R² of a line",
        "linear",
        median_over_seeds("length_r2", np.median),
    ),
    _strides_measured(
        "literal, error of the place grows as strides to the power",
        "1",
        median_over_seeds("growth_exponent", np.median),
    ),
)
_STEPS: Final = (
    _shown(
        *("F8", "unit turned by 25°: step to the side, of its length", "sin 25° = 42.3 %"),
        *("step_sensor", largest_over_seeds("raw_lateral_share"), SHARE),
    ),
    _step_sensor_m(
        "the same, misalignment taken off", "(stride, 0)", largest_over_seeds("lateral_m"), Gate(high=0.001)
    ),
    _step_sensor_m("the same, error of the step ahead", "(stride, 0)", largest_over_seeds("ahead_m"), Gate(high=0.01)),
)

_LEFT_OUT: Final = Experiment(
    "left_out",
    "pdrbench_lab.foot_ins.left_out:left_out",
    seeds=1,
    quick_seeds=1,
    envs=(VICON, WALKS, LOOPS, SHORT, "FootDual-v1"),
)
LEFT_OUT: Final = Reproduction(
    name="foot_left_out",
    paper="settings of foot_ins_robust, fitted without the set they are measured on, and worse sensors",
    experiments=(_LEFT_OUT, replace(_LEFT_OUT, name="disturbed", measure="pdrbench_lab.foot_ins.disturbed:disturbed")),
    claims=(*left_out.CLAIMS, *disturbed.CLAIMS),
)
REPRODUCTION: Final = Reproduction(
    name="foot_ins",
    paper="K. Frank, B. Krach, N. Catterall, P. Robertson: Development and evaluation of a combined WLAN and inertial "
    "indoor pedestrian positioning system. ION GNSS 2009, section 3; O. Woodman, R. Harle: Pedestrian localisation for "
    "indoor environments. UbiComp 2008",
    experiments=(
        _measure("capture_played", VICON),
        _measure("loops_played", LOOPS),
        _measure("walks_played", WALKS),
        _measure("capture_labels", VICON),
        _measure("short_played", SHORT),
        _measure("capture_consistency", VICON),
        _measure("strides_measured", WALKS),
        _measure("rests", LOOPS),
        _measure("step_sensor"),
        _LEFT_OUT,
    ),
    claims=(*_ADAPTIVE, *_SMOOTHER, *_LABELS, *_DETECTORS, *_CONSISTENCY, *_STRIDES, *_STEPS, *left_out.CLAIMS),
    figures="pdrbench_lab.foot_ins.figures:draw",
)
