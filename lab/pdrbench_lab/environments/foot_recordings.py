"""`FootLoops-v1`, `FootShort-v1`, `FootDual-v1`: recorded walks of the foot, too few to rank localizers."""

from __future__ import annotations

import dataclasses
import functools
from pathlib import Path
from typing import Final

from pdrbench.io.log import Log
from pdrbench.trajectory import Trajectory
from pdrbench_envs.descriptions import describe
from pdrbench_envs.foot_recordings import FootSet, make_task, motion_capture, on_the_ground
from pdrbench_lab.readers import foot_dual, foot_loops, foot_short

_LOOP: Final = """
**Scored** is one place, the last: the walk ends where it began. That is no test of where one was in between, and who
never moves scores 0: read it beside the distance walked, and compare no localizer that knows of the loop.

**Start**: the origin, level 0. No heading is known, and none is needed.

**Splits**: `test` only, under opaque ids in shuffled order. Tune elsewhere.
"""


def both_ends(log: Log) -> Trajectory:
    """The start, which is given, and the end, scored, which is the same place."""
    ends = log.reference
    return on_the_ground(ends.t_s, ends.xy_m, ends.t_s > 0, z_m=ends.z_m)


_LOOPS: Final = FootSet(
    env="FootLoops-v1",
    datasets=("foot_loops",),
    pattern="Measurement_*/data_inert.txt",
    read=foot_loops.read,
    reference=both_ends,
    device="MicroStrain 3DM-GX2",
    sensors=("accel", "gyro", "mag"),
    rate_hz=250.0,
    noise_m=0.01,
    summary="A unit in the sole of a shoe, loops of 81 to 89 m that close to a centimetre; start place known",
    description="""\
Loops of 81 to 89 m, some 10 by 29 m, walked at 5 km/h with a unit in the sole of the right shoe (Skog, Nilsson,
Handel 2010). The shoe rests for a few seconds at both ends and stands on the same place to a centimetre.
"""
    + "\n"
    + describe("foot", sensors="accelerometer, gyroscope and magnetometer at 250 Hz, a few rows of the last missing")
    + _LOOP,
)
_SHORT: Final = FootSet(
    env="FootShort-v1",
    datasets=("foot_short",),
    pattern="*.csv",
    read=foot_short.read,
    reference=both_ends,
    device="x-io NGIMU",
    sensors=("accel", "gyro"),
    rate_hz=398.0,
    noise_m=0.01,
    summary="A unit on the foot, one loop of 25 m; start place known",
    description="""\
One loop of some 25 m that ends where it began, of x-io's example of gait tracking. Samples were lost on the way to the
logger: 165 steps of time are two to five times as long as the others.
"""
    + "\n"
    + describe("foot", sensors="accelerometer and gyroscope at 398 Hz")
    + _LOOP,
)


def _both_feet(path: Path) -> Log:
    """The unit of one file, and as `accel_2` and `gyro_2` the one on the other foot."""
    other = path.with_name("imuMeasRight.csv" if "Left" in path.name else "imuMeasLeft.csv")
    log, rows = foot_dual.read(path), foot_dual.read(other).rows
    return dataclasses.replace(log, rows={**log.rows, "accel_2": rows["accel"], "gyro_2": rows["gyro"]})


_DUAL: Final = FootSet(
    env="FootDual-v1",
    datasets=("foot_dual",),
    pattern="imuMeas*.csv",
    read=_both_feet,
    reference=motion_capture,
    device="not stated",
    sensors=("accel", "gyro", "accel_2", "gyro_2"),
    rate_hz=60.0,
    noise_m=0.01,
    summary="Units on both feet of one walker at 60 Hz, 62 and 72 m; start pose known",
    description="""\
One person walks for 120 s with a unit on each foot (Hu, Hu 2025). Each of the two walks follows one foot: `accel` and
`gyro` are the unit on it, `accel_2` and `gyro_2` the unit on the other foot, of which no place is given. The reference
is the foot at every 0.05 s, with its height. Published horizontal RMS of a Kalman filter with zero velocities, not
aligned: 1.484 m right, 3.904 m left; of a factor graph with a constraint on the step: 0.331 m and 1.414 m.

**What is hard**: 60 Hz, and a second of standing at the start, in which the gyroscope on the right foot reads up to 1.2
degrees/s. The two feet are never farther apart than a step.
"""
    + "\n"
    + describe("foot", "foot_start", sensors="accelerometer and gyroscope of both units at 60 Hz"),
)
task_loops = functools.partial(make_task, _LOOPS)
task_short = functools.partial(make_task, _SHORT)
task_dual = functools.partial(make_task, _DUAL)
