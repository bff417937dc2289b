"""Strides found against swings made, of each recorded set: by the surveyed places, and by motion capture.

Trials of `foot_vicon_2` in which the foot is lifted in place, or crawls, are rows of their own: they have no steps.
"""

from __future__ import annotations

from typing import Any, Final

import numpy as np

from pdrbench.datasets import is_available
from pdrbench.geometry import FloatArray
from pdrbench.inertial import find_strides, navigate
from pdrbench.trajectory import Trajectory
from pdrbench_lab.foot_ins.experiments import walks_of
from pdrbench_lab.reproduce.reproduction import Claim, Experiment, Gate, Reproduction, largest_over_seeds

CAPTURED: Final = ("foot_vicon", "foot_vicon_2", "foot_dual")
SURVEYED: Final = ("foot_stride_gcp", "foot_stride_gcp_2")
NO_STEPS: Final = ("2018-02-09", "2018-02-22")  # of `foot_vicon_2`: lifts in place, crawls
MIN_MOVE_M: Final = 0.05  # of a foot from stand to stand; less is shifting one's weight
TICK_S: Final = 0.02
MOVES_MPS: Final = 0.25  # a foot that is faster swings, and ...
MOVES_FRACTION: Final = 0.15  # ... that fraction of its fastest, where that is more
JOINS_S: Final = 0.06  # gaps in a swing
MIN_SWING_S: Final = 0.12


def swings(seed: int) -> dict[str, Any]:
    """By set the swings, and the strides that are found of them."""
    found: dict[str, int] = {}
    for name in (*CAPTURED, *SURVEYED):
        if not is_available(name):
            continue
        for walk in walks_of(name):
            is_other = name == "foot_vicon_2" and walk.path.name.startswith(NO_STEPS)
            key = f"{name}_no_steps" if is_other else name
            states = navigate(walk.t_s, walk.accel, walk.gyro)
            made = len(walk.reference) - 1 if name in SURVEYED else num_swings(walk.reference)
            for kind, number in (("swings", made), ("strides", _num_moved(find_strides(states)))):
                found[f"{kind}_{key}"] = found.get(f"{kind}_{key}", 0) + number
    numbers = {key: float(value) for key, value in found.items()}
    for key in [key.removeprefix("swings_") for key in found if key.startswith("swings_")]:
        numbers[f"strides_pct_{key}"] = 100 * (found[f"strides_{key}"] / max(found[f"swings_{key}"], 1) - 1)
    return numbers


def num_swings(reference: Trajectory) -> int:
    """How often a foot that is watched goes somewhere else."""
    z_m = np.zeros(len(reference)) if reference.z_m is None else reference.z_m
    t_s = np.arange(reference.t_s[0], reference.t_s[-1], TICK_S)
    xyz_m = np.column_stack([np.interp(t_s, reference.t_s, column) for column in (*reference.xy_m.T, z_m)])
    speed_mps: FloatArray = np.linalg.norm(xyz_m[5:] - xyz_m[:-5], axis=1) / (5 * TICK_S)
    least_mps = max(MOVES_MPS, MOVES_FRACTION * float(np.quantile(speed_mps, 0.95)))
    turns = np.flatnonzero(np.diff((speed_mps > least_mps).astype(np.int8), prepend=0, append=0))
    spans: list[list[int]] = []
    for begin, end in turns.reshape(-1, 2).tolist():
        if spans and (begin - spans[-1][1]) * TICK_S <= JOINS_S + 1e-9:
            spans[-1][1] = end
        else:
            spans.append([begin, end])
    last = len(xyz_m) - 1
    return sum(
        (end - begin) * TICK_S >= MIN_SWING_S - 1e-9
        and float(np.hypot(*(xyz_m[min(end + 2, last), :2] - xyz_m[begin, :2]))) > MIN_MOVE_M
        for begin, end in spans
    )


def _num_moved(strides: Any) -> int:
    return int((np.hypot(strides.length_m, strides.rise_m) > MIN_MOVE_M).sum())


def _claims() -> tuple[Claim, ...]:
    rows = []
    for name in (*CAPTURED, *SURVEYED, "foot_vicon_2_no_steps"):
        gate = None if name.endswith("no_steps") else Gate(-2.0, 2.0)
        what = name.replace("_no_steps", ", lifts in place and crawls")
        for kind, said, unit, limits in (
            ("swings", "swings made", "", None),
            ("strides", "strides found", "", None),
            ("strides_pct", "strides too many", "%", gate),
        ):
            value = largest_over_seeds(f"{kind}_{name}")
            rows.append(Claim("W3", f"{what}: {said}", "not stated", "swings", value, limits, unit))
    return tuple(rows)


REPRODUCTION: Final = Reproduction(
    name="foot_strides",
    paper="strides that find_strides makes of the swings of recorded feet",
    experiments=(
        Experiment(
            "swings",
            "pdrbench_lab.foot_ins.swings:swings",
            seeds=1,
            quick_seeds=1,
            envs=("FootVicon-v1", "FootWalks-v1", "FootDual-v1"),
        ),
    ),
    claims=_claims(),
)
