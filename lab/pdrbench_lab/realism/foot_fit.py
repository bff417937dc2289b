"""Fits how a foot swings to recorded walks and writes `shape.json`: `python -m pdrbench_lab.realism.foot_fit`.

Poses come from the adaptive foot filter with its smoother. A stride is cut at two landmarks that every swing has, toe
lowest and toe highest: time between landmarks is stretched so that strides lie on top of each other. What is written
is the mean of the strides, how it grows with their length, and a few principal components of what varies between
strides.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.interpolate import CubicSpline

from pdrbench.geometry import FloatArray
from pdrbench.inertial import FootStates, find_strides, navigate_smoothed
from pdrbench.inertial.quaternions import multiply, twist_rad
from pdrbench.inertial.strides import Strides
from pdrbench.io.log import Log
from pdrbench_lab.realism.foot_statistics import ON_INSTEP, inertial_columns, recorded_logs
from pdrbench_sim.foot.shape import CHANNELS, NUM_KNOTS, SHAPE_FILE, TOE_HIGH, TOE_LOW
from pdrbench_sim.readers import foot_stride_gcp

RUNS: Final = [(foot_stride_gcp.read, "foot_stride_gcp", "gcp_labelled/SensorConnectData_3[45]_LLIO.mat")]
NUM_MODES: Final = 5
MIN_LENGTH_M: Final = 0.8
MAX_TIME_S: Final = 1.6
MAX_TURN_RAD: Final = np.radians(25.0)
MAX_PITCH_RAD: Final = np.radians(85.0)  # where roll and yaw can still be separated
_REACH: Final = 10  # knots before and after mid-stance over which the end of a stride becomes the beginning of the next
_ENDS: Final = 0.12  # phase over which what varies from stride to stride fades out towards mid-stance
_DIGITS: Final = 7  # a tenth of a micrometre: second differences of knots stay below 1 mm/s2


def shaped_strides(log: Log) -> list[tuple[FloatArray, float]]:
    """The strides of a recording that lie between two others, straight enough and long enough.

    Returns:
        For each stride, its `CHANNELS` over the phase (NUM_KNOTS, 6), and its horizontal length in metres.
    """
    states = navigate_smoothed(*inertial_columns(log))
    strides = find_strides(states)
    states = states.part(slice(int(np.argmax(np.isfinite(states.x[:, 0]))), None))
    yaw, pitch, roll = _angles(states, strides)
    low_s, high_s = _landmarks(states.t_s, pitch, strides)
    time_s = strides.end_s - strides.start_s
    fits = (strides.length_m > MIN_LENGTH_M) & (time_s < MAX_TIME_S) & (np.abs(strides.turn_rad) < MAX_TURN_RAD)
    fits &= high_s - low_s > 0.15
    follows = np.append(False, np.abs(strides.start_s[1:] - strides.end_s[:-1]) < 0.02)
    poses = CubicSpline(states.t_s, np.column_stack([states.position_m, pitch, roll, yaw]))
    found = []
    for k in range(1, len(fits) - 1):
        if not (fits[k - 1 : k + 2].all() and follows[k : k + 2].all()):
            continue
        phases = np.arange(-_REACH, NUM_KNOTS + _REACH) / (NUM_KNOTS - 1)
        when_s = np.interp(
            phases, [TOE_HIGH - 1, TOE_LOW, TOE_HIGH, TOE_LOW + 1], [high_s[k - 1], low_s[k], high_s[k], low_s[k + 1]]
        )
        stride = poses(when_s)
        if np.abs(stride[:, 3]).max() < MAX_PITCH_RAD:
            found.append(_shape(stride))
    return found


def _angles(states: FootStates, strides: Strides) -> tuple[FloatArray, FloatArray, FloatArray]:
    """(n,) yaw, pitch, roll of the foot: level at rest, x along the direction of travel in the median."""
    long = strides.length_m > MIN_LENGTH_M
    at_rest = states.quaternion[np.searchsorted(states.t_s, strides.end_s[long])]
    half = -strides.heading_rad[long] / 2
    zero = np.zeros(len(half))
    mount = multiply(np.column_stack([np.cos(half), zero, zero, np.sin(half)]), at_rest)
    mount = np.median(mount * np.sign(mount @ mount[0])[:, None], axis=0)
    unmount = mount / np.linalg.norm(mount) * [1, -1, -1, -1]
    foot = multiply(states.quaternion, np.broadcast_to(unmount, states.quaternion.shape))
    w, x, y, z = foot.T
    pitch = np.arcsin(np.clip(2 * (w * y - x * z), -1, 1))
    roll = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    return np.unwrap(twist_rad(foot)), pitch, roll


def _landmarks(t_s: FloatArray, pitch: FloatArray, strides: Strides) -> tuple[FloatArray, FloatArray]:
    """(S,) times of the largest (toe down) and then the smallest pitch of each stride."""
    low_s, high_s = [], []
    for begin_s, end_s in zip(strides.start_s, strides.end_s, strict=True):
        begin, end = np.searchsorted(t_s, [begin_s - 0.05, end_s + 0.05])
        low = begin + int(np.argmax(pitch[begin:end]))
        low_s.append(t_s[low])
        high_s.append(t_s[low + int(np.argmin(pitch[low:end]))])
    return np.array(low_s), np.array(high_s)


def _shape(poses: FloatArray) -> tuple[FloatArray, float]:
    """A stride from its poses (m, 6), which reach a little beyond mid-stance at either end."""
    begin, end = _REACH, _REACH + NUM_KNOTS - 1
    moved = poses[end] - poses[begin]
    length_m = float(np.hypot(moved[0], moved[1]))
    ahead = moved[:2] / length_m
    from_start = poses - poses[begin]
    along = from_start[:, :2] @ ahead / length_m
    side = from_start[:, :2] @ [-ahead[1], ahead[0]]
    height, yaw = (from_start[:, k] - along * moved[k] for k in (2, 5))
    return _closed(np.column_stack([along, side, height, poses[:, 3:5], yaw])), length_m


def _closed(values: FloatArray) -> FloatArray:
    """(NUM_KNOTS, 6) values whose end is the beginning of the next stride: the two are faded into each other."""
    step = np.array([1.0, 0, 0, 0, 0, 0])  # along starts anew
    fraction = np.linspace(0, 1, 2 * _REACH + 1)[:, None]
    fraction = fraction**2 * (3 - 2 * fraction)
    mixed = fraction * values[: 2 * _REACH + 1] + (1 - fraction) * (values[NUM_KNOTS - 1 :] - step)
    closed = values[_REACH : _REACH + NUM_KNOTS].copy()
    closed[: _REACH + 1], closed[-_REACH - 1 :] = mixed[_REACH:], mixed[: _REACH + 1] + step
    first = closed[0] * [1, 1, 1, 0, 0, 1]
    return np.asarray(closed - first)


def fitted(logs: Iterable[Log]) -> dict[str, Any]:
    """The numbers of one gait from the strides of some recordings."""
    shapes, lengths_m = zip(*(stride for log in logs for stride in shaped_strides(log)), strict=True)
    values, length_m = np.array(shapes), np.array(lengths_m)
    design = np.column_stack([np.ones(len(length_m)), length_m - length_m.mean()])
    flat = values.reshape(len(values), -1)
    (mean, slope), *_ = np.linalg.lstsq(design, flat, rcond=None)
    phase = np.linspace(0, 1, NUM_KNOTS)
    fade = np.clip(np.minimum(phase, 1 - phase) / _ENDS, 0, 1)
    fade = (fade**2 * (3 - 2 * fade))[:, None]
    left = (flat - design @ [mean, slope]).reshape(values.shape) * fade
    # Metres against radians: a stride's length is the natural unit of `along`, and the unit sits 0.1 m from the sole.
    weight = np.array([1.3, 1.0, 1.0, 0.1, 0.1, 0.1])
    modes = np.linalg.svd((left * weight).reshape(len(left), -1), full_matrices=False)
    count = min(NUM_MODES, len(left) - 1)
    sizes = modes.S[:count] / np.sqrt(len(left) - 2)
    scaled = (modes.Vh[:count] * sizes[:, None]).reshape(count, NUM_KNOTS, len(CHANNELS)) / weight
    return {
        "num_strides": len(values),
        "length_m": _digits(length_m.mean()),
        "length_range_m": _digits(np.percentile(length_m, [2, 98])),
        "explained": _digits(np.sum(modes.S[:count] ** 2) / np.sum(modes.S**2)),
        "mean": _digits(mean.reshape(NUM_KNOTS, -1)),
        "slope": _digits(slope.reshape(NUM_KNOTS, -1)),
        "modes": _digits(scaled),
    }


def fit() -> dict[str, Any]:
    """The whole file."""
    return {
        "format": 1,
        "provenance": {
            "written_by": "python -m pdrbench_lab.realism.foot_fit",
            "walk": [*(f"foot_stride_gcp {number}" for number in (31, 32, 33, 36)), "foot_short short_walk"],
            "run": [f"foot_stride_gcp {number}" for number in (34, 35)],
            "licence": "both sets are published under the MIT licence",
            "channels": list(CHANNELS),
        },
        "walk": fitted(recorded_logs(ON_INSTEP["fit"])),
        "run": fitted(recorded_logs(RUNS)),
    }


def _digits(values: Any) -> Any:
    """Numbers as they are written."""
    rounded = np.round(np.asarray(values, dtype=np.float64), _DIGITS) + 0.0
    return rounded.tolist()


def main() -> None:
    """Fits and writes the file that `pdrbench_sim.foot.shape` reads, or another one."""
    parser = argparse.ArgumentParser(prog="python -m pdrbench_lab.realism.foot_fit", description=__doc__)
    parser.add_argument("--out", type=Path, default=SHAPE_FILE, help="file to write; the packaged one without it")
    out = parser.parse_args().out
    out.write_text(json.dumps(fit(), separators=(",", ":")) + "\n", encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
