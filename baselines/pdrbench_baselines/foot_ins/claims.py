"""What is claimed of inertial navigation on the foot, beside what is measured (claims W2, W3, F6 to F8)."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.evaluation.reproduction import (
    SHARE,
    Claim,
    Experiment,
    Gate,
    Reproduction,
    Value,
    largest_over_seeds,
    mean_over_walks,
    median_over_seeds,
    median_over_walks,
)
from pdrbench.geometry import FloatArray
from pdrbench_baselines.foot_ins.experiments import LOOPS, SHORT, VICON, WALKS

LOWER: Final = Gate(high=0.999)  # of a ratio: what is lower than one and not merely rounded


def _measure(name: str, *envs: str) -> Experiment:
    """The recordings and the filters draw nothing: one seed says all."""
    return Experiment(name, f"pdrbench_baselines.foot_ins.experiments:{name}", seeds=1, quick_seeds=1, envs=envs)


def _shown(id_: str, what: str, paper: str, experiment: str, value: Value, unit: str = "") -> Claim:
    return Claim(id_, what, paper, experiment, value, None, unit)


def _median_size(values: FloatArray) -> float:
    return float(np.median(np.abs(values)))


_LABELS: Final = (
    Claim(
        *(
            "F7",
            "motion capture, told when the foot rests (SHOE labels): mean RMSE",
            "0.078 m of all 56",
            "capture_labels",
        ),
        *(mean_over_walks("labels_shoe_m"), Gate(high=0.09), "m"),
    ),
    *(
        _shown(
            "F7", f"the same, {name} labels", "not stated", "capture_labels", mean_over_walks(f"labels_{key}_m"), "m"
        )
        for name, key in (("ARE", "ared"), ("MV", "amvd"), ("MAG", "mbgtd"), ("motion capture's", "vicon"))
    ),
    _shown(
        "F7",
        "published error of SHOE, per axis: mean",
        "0.059 m of all 56",
        "capture_labels",
        mean_over_walks("published_m"),
        "m",
    ),
    _shown(
        "F7",
        "published error of SHOE, per axis: median trial",
        "0.049 m of all 56",
        "capture_labels",
        median_over_walks("published_m"),
        "m",
    ),
    _shown(
        *("F7", "in the same reading, told when the foot rests: mean", "as above"),
        *("capture_labels", mean_over_walks("labels_axis_m"), "m"),
    ),
    _shown(
        *("F7", "in the same reading, one threshold for all trials: mean", "tuned by trial"),
        *("capture_labels", mean_over_walks("literal_axis_m"), "m"),
    ),
    _shown(
        "F7",
        "one threshold for all trials: median trial",
        "tuned by trial",
        "capture_labels",
        median_over_walks("literal_axis_m"),
        "m",
    ),
    _shown(
        *("F7", "one threshold, less published: median trial", "0 m"),
        *("capture_labels", median_over_walks("axis_difference_m"), "m"),
    ),
    _shown(
        *("F7", "one threshold against published: correlation over trials", "1"),
        *("capture_labels", median_over_seeds("axis_correlation")),
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
        _shown("F6", f"motion capture, {key}-v0: mean ATE", "not stated", "capture_played", mean_over_walks(key), "m")
        for key in ("foot_ins", "foot_ins_are", "foot_ins_mv", "foot_ins_mag", "foot_ins_interval")
    ),
    *(
        _shown("F6", f"share of the loops at rest, {name}", "0.33 in stance", "rests", mean_over_walks(name), SHARE)
        for name in ("shoe", "are", "mv", "mag", "interval", "soft")
    ),
)
_ADAPTIVE: Final = (
    Claim(
        *("F7", "motion capture, adaptive: mean ATE", "one set of defaults", "capture_played"),
        *(mean_over_walks("foot_ins_adaptive"), Gate(high=0.15), "m"),
    ),
    Claim(
        *("F7", "motion capture, adaptive: worst trial", "one set of defaults", "capture_played"),
        *(largest_over_seeds("foot_ins_adaptive"), Gate(high=0.6), "m"),
    ),
    _shown(
        *("F7", "motion capture, adaptive filter in its own frame: mean RMSE", "not stated"),
        *("capture_labels", mean_over_walks("adaptive_m"), "m"),
    ),
    Claim(
        *("F7", "loops, adaptive: horizontal closure, worst loop", "0.43 %: literal", "loops_played"),
        *(largest_over_seeds("foot_ins_adaptive"), Gate(high=1.0), "%"),
    ),
    Claim(
        *("F7", "loops, adaptive: horizontal closure, median", "0.43 %: literal", "loops_played"),
        *(median_over_walks("foot_ins_adaptive"), Gate(high=0.45), "%"),
    ),
    _shown(
        "F7", "loops, literal: horizontal closure, median", "0.43 %", "loops_played", median_over_walks("foot_ins"), "%"
    ),
    _shown(
        "F7",
        "loops, adaptive: closure in height, mean",
        "not stated",
        "loops_played",
        mean_over_walks("adaptive_height_m"),
        "m",
    ),
    _shown(
        *("F7", "loops, literal: closure in height, mean", "0.58 m to 0.70 m"),
        *("loops_played", mean_over_walks("literal_height_m"), "m"),
    ),
    Claim(
        *("F7", "walks 31, 32, 33, 36, adaptive: worst ATE at strides", "one set of defaults", "walks_played"),
        *(largest_over_seeds("foot_ins_adaptive_walks"), Gate(high=0.35), "m"),
    ),
    Claim(
        *("F7", "runs 34, 35, adaptive: worse ATE at strides", "one set of defaults", "walks_played"),
        *(largest_over_seeds("foot_ins_adaptive_runs"), Gate(high=3.0), "m"),
    ),
    _shown(
        *("F7", "other walks and runs, adaptive: worst ATE at strides", "not registered"),
        *("walks_played", largest_over_seeds("foot_ins_adaptive_others"), "m"),
    ),
    _shown(
        *("F7", "runs 34, 35, literal: worse ATE at strides", "breaks: 2.5 m to 59 m"),
        *("walks_played", largest_over_seeds("foot_ins_runs"), "m"),
    ),
    _shown(
        "F7", "short loop, literal: gap in space", "82 mm: theirs", "short_played", mean_over_walks("literal_m"), "m"
    ),
    _shown(
        "F7", "short loop, literal: in the plane", "not stated", "short_played", mean_over_walks("literal_flat_m"), "m"
    ),
    _shown(
        "F7", "short loop, adaptive: gap in space", "82 mm: theirs", "short_played", mean_over_walks("adaptive_m"), "m"
    ),
    _shown(
        "F7",
        "short loop, adaptive: in the plane",
        "not stated",
        "short_played",
        mean_over_walks("adaptive_flat_m"),
        "m",
    ),
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
    _shown(
        "F7",
        "smoother, motion capture: mean ATE",
        "not stated",
        "capture_played",
        mean_over_walks("foot_ins_smooth"),
        "m",
    ),
    Claim(
        *("F7", "smoother, walks and runs: mean ATE over that of the filter", "lower", "walks_played"),
        *(median_over_seeds("smoothed_share"), LOWER),
    ),
    _shown(
        "F7",
        "smoother, walks and runs: mean ATE",
        "not stated",
        "walks_played",
        mean_over_walks("foot_ins_smooth"),
        "m",
    ),
    Claim(
        *("F7", "smoother, literal filter: mean RMSE over that of the filter", "lower", "capture_labels"),
        *(median_over_seeds("smoothed_share"), LOWER),
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
    Claim(
        *("W3", "strides: median error of length, without sign", "1 cm to 2 cm", "strides_measured"),
        *(median_over_seeds("length_error_m", np.median), Gate(high=0.02), "m"),
    ),
    _shown(
        "W3",
        "walking: mean error of length",
        "not stated",
        "strides_measured",
        median_over_seeds("rolling_walks_m", np.mean),
        "m",
    ),
    _shown(
        "W3",
        "walking: median error of length",
        "not stated",
        "strides_measured",
        median_over_seeds("rolling_walks_m", np.median),
        "m",
    ),
    _shown(
        *("W3", "walking, as if the unit lay on the floor: median error of length", "-1.9 %: a foot rolls"),
        *("strides_measured", median_over_seeds("still_walks_m", np.median), "m"),
    ),
    _shown(
        "W3", "the same, share", "-1.9 %", "strides_measured", median_over_seeds("still_walks_share", np.median), SHARE
    ),
    _shown(
        *("W3", "walking, with the roll: median error of length, share", "0"),
        *("strides_measured", median_over_seeds("rolling_walks_share", np.median), SHARE),
    ),
    _shown(
        "W3",
        "running: median error of length",
        "not stated",
        "strides_measured",
        median_over_seeds("rolling_runs_m", np.median),
        "m",
    ),
    _shown(
        "W3",
        "surveyed strides that were found, walking",
        "1",
        "strides_measured",
        mean_over_walks("found_walks"),
        SHARE,
    ),
    _shown(
        "W3", "surveyed strides that were found, running", "1", "strides_measured", mean_over_walks("found_runs"), SHARE
    ),
    _shown(
        "W3",
        "walking: error of the change of course, median without sign",
        "0.6° (W4)",
        "strides_measured",
        median_over_seeds("turn_walks_deg", _median_size),
        "°",
    ),
    _shown(
        *("W2", "literal, error of the distance against strides: R² of a line", "linear"),
        *("strides_measured", median_over_walks("length_r2")),
    ),
    _shown(
        *("W2", "literal, error of the place grows as strides to the power", "1"),
        *("strides_measured", median_over_walks("growth_exponent")),
    ),
)
_STEPS: Final = (
    _shown(
        *("F8", "unit turned by 25°: step to the side, of its length", "sin 25° = 42.3 %"),
        *("step_sensor", largest_over_seeds("raw_lateral_share"), SHARE),
    ),
    Claim(
        *("F8", "the same, misalignment taken off", "(stride, 0)", "step_sensor"),
        *(largest_over_seeds("lateral_m"), Gate(high=0.001), "m"),
    ),
    Claim(
        *("F8", "the same, error of the step ahead", "(stride, 0)", "step_sensor"),
        *(largest_over_seeds("ahead_m"), Gate(high=0.01), "m"),
    ),
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
    ),
    claims=(*_ADAPTIVE, *_SMOOTHER, *_LABELS, *_DETECTORS, *_CONSISTENCY, *_STRIDES, *_STEPS),
    figures="pdrbench_baselines.foot_ins.figures:draw",
)
