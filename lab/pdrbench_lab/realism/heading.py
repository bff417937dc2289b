"""Realism of the heading that a phone reports, and of the legs reckoned with it (sources.md 1.5)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray, IntArray, wrap_rad
from pdrbench.inertial.quaternions import phone_heading_rad
from pdrbench.inertial.steps import PeakStepDetector
from pdrbench.recording import Recording
from pdrbench_lab.realism.block import Control, Distribution, Figure, Values, clustered, statistics
from pdrbench_lab.realism.phone_walks import Leg, legs, resampled, synthetic_walk, walk_block

LONG_M: Final = 5.0  # longer legs show errors of the phone; in shorter ones turning round at the marks prevails
STEP_M: Final = 0.62  # sources.md 1.5: of every step
TURNED_S: Final = 2.0  # after its mark a surveyor has turned into the next leg


def leg_headings(recording: Recording) -> FloatArray:
    """Headings of one walk against the bearings between the places that were marked.

    Returns:
        (3, k) by leg: its length in metres; the circular mean of the heading reported, less the bearing of the leg, in
        radians; the standard deviation within the leg, from `TURNED_S` after its mark on, NaN where it is shorter.
    """
    rotation = recording.streams["rotation"].rows
    heading_rad = phone_heading_rad(rotation[:, 1:5])
    found = [_leg(rotation[:, 0], heading_rad, leg) for leg in legs(recording)]
    return np.array(found, dtype=np.float64).reshape(-1, 3).T


def _leg(t_s: FloatArray, heading_rad: FloatArray, leg: Leg) -> tuple[float, float, float]:
    during = (t_s > leg.start_s) & (t_s <= leg.end_s)
    off_rad = wrap_rad(heading_rad[during] - leg.bearing_rad)
    turned = off_rad[t_s[during] > leg.start_s + TURNED_S]
    wander_rad = float(np.std(wrap_rad(turned - _mean_rad(turned)))) if len(turned) else math.nan
    return leg.length_m, _mean_rad(off_rad) if len(off_rad) else math.nan, wander_rad


def _mean_rad(angle_rad: FloatArray) -> float:
    """Circular mean."""
    return float(np.angle(np.exp(1j * angle_rad).mean()))


def heading_values(recordings: Sequence[Recording]) -> dict[str, list[FloatArray]]:
    """By statistic, an array for each walk; degrees."""
    values: dict[str, list[FloatArray]] = {name: [] for name in ("all", "error", "wander", "offset", "residual")}
    for recording in recordings:
        length_m, all_error_rad, wander_rad = leg_headings(recording)
        long = length_m > LONG_M
        error_rad = all_error_rad[long]
        offset_rad = np.array([_mean_rad(error_rad)] if len(error_rad) > 1 else [])
        residual_rad = wrap_rad(error_rad - offset_rad) if len(offset_rad) else np.zeros(0)
        values["all"].append(np.degrees(np.abs(all_error_rad)))
        values["error"].append(np.degrees(np.abs(error_rad)))
        values["wander"].append(np.degrees(wander_rad[long]))
        values["offset"].append(np.degrees(offset_rad))
        values["residual"].append(np.degrees(np.abs(residual_rad)))
    return values


def leg_errors_m(recording: Recording) -> FloatArray:
    """(k,) how far the end of each leg is missed with steps of `STEP_M` and the heading reported."""
    rotation, accel = recording.streams["rotation"].rows, recording.streams["accel"].rows
    rate_hz = (len(accel) - 1) / (accel[-1, 0] - accel[0, 0])
    step_s = PeakStepDetector(float(rate_hz)).update(accel)
    row = np.maximum(np.searchsorted(rotation[:, 0], step_s, side="right") - 1, 0)
    heading_rad = phone_heading_rad(rotation[row, 1:5])
    missed = []
    for leg in legs(recording):
        during = (step_s > leg.start_s) & (step_s <= leg.end_s)
        ahead = np.column_stack([np.cos(heading_rad[during]), np.sin(heading_rad[during])])
        missed.append(float(np.hypot(*(STEP_M * ahead.sum(axis=0) - leg.step_m))))
    return np.array(missed)


_FIGURES: Final[dict[str, tuple[str, Callable[[FloatArray], float]]]] = {  # of a whole set
    "all_mean": ("all", np.mean),
    "mean": ("error", np.mean),
    "p95": ("error", lambda values: float(np.percentile(values, 95))),
    "offset_sd": ("offset", lambda values: float(np.std(values, ddof=1))),
    "residual_mean": ("residual", np.mean),
}


def _figures(values: dict[str, list[FloatArray]], walks: IntArray) -> dict[str, float]:
    """By name, of the set that is made of these walks."""
    pooled = {name: np.concatenate([arrays[walk] for walk in walks]) for name, arrays in values.items()}
    return {name: float(figure(pooled[source])) for name, (source, figure) in _FIGURES.items()}


def _heading(recordings: Sequence[Recording], sets: Sequence[IntArray]) -> Values:
    """Every statistic of the block "Phone heading"."""
    values = heading_values(recordings)
    figures = [_figures(values, walks) for walks in sets]
    has_both = [i for i, offset in enumerate(values["offset"]) if len(offset)]
    return {
        **clustered("error", values["error"]),
        **clustered("wander", values["wander"]),
        **{name: np.array([figure[name] for figure in figures]) for name in _FIGURES},
        "walk_offset": np.array([abs(values["offset"][i][0]) for i in has_both]),
        "walk_residual": np.array([values["residual"][i].mean() for i in has_both]),
        "walk_wander": np.array([np.nanmedian(values["wander"][i]) for i in has_both]),
    }


def _true_attitude(seed: int, count: int) -> Values:
    """A phone that knows its attitude: what is left is how it is held and how places are marked."""
    walks = [synthetic_walk(seed, number, rotate=lambda t_s, quaternion, *_: quaternion) for number in range(count)]
    return _heading(walks, resampled(count, seed))


def _legs(recordings: Sequence[Recording], sets: Sequence[IntArray]) -> Values:
    """Every statistic of the block "PDR leg"."""
    missed = [leg_errors_m(recording) for recording in recordings]
    long = [np.array([leg.length_m for leg in legs(recording)]) > LONG_M for recording in recordings]
    return {
        **clustered("missed", missed),
        **clustered("missed_long", [m[k] for m, k in zip(missed, long, strict=True)]),
        "missed_mean": np.array([np.concatenate([missed[walk] for walk in walks]).mean() for walks in sets]),
        "walk_missed": np.array([values.mean() for values in missed]),
        "walk_longest": np.array([values.max() for values in missed]),
    }


_OF_LONG: Final = f"legs longer than {LONG_M:g} m"
HEADING: Final = walk_block(
    "Phone heading",
    (
        *statistics(
            "leg",
            Distribution(),
            ("error", f"heading off the bearing of {_OF_LONG}", "deg"),
            ("wander", f"spread of the heading within {_OF_LONG}", "deg"),
        ),
        *statistics(
            "set",
            Figure(),
            ("mean", f"mean error of the heading on {_OF_LONG}", "deg"),
            ("p95", f"95 % of the errors of the heading on {_OF_LONG}", "deg"),
            ("all_mean", "mean error of the heading on all legs", "deg"),
            ("offset_sd", "spread over walks of the mean error of a walk, signed", "deg"),
            ("residual_mean", "mean size of what the mean error of a walk leaves", "deg"),
        ),
    ),
    _heading,
    controls={"true attitude": Control("the phone knows its attitude", _true_attitude, "mean")},
    features=("walk_offset", "walk_residual", "walk_wander"),
)
LEGS: Final = walk_block(
    "PDR leg",
    (
        *statistics(
            "leg",
            Distribution(),
            ("missed", f"end of a leg missed with steps of {STEP_M:g} m", "m"),
            ("missed_long", f"the same on {_OF_LONG}", "m"),
        ),
        *statistics("set", Figure(), ("missed_mean", "mean of all legs", "m")),
    ),
    _legs,
    features=("walk_missed", "walk_longest"),
)
