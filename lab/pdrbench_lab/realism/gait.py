"""Stride times: how much they vary, and over how many strides they correlate.

Long-range correlation needs hundreds of strides in a row, which no available recording has: it is compared with the
published exponent. The variation is compared on walks of some fifty strides, found on both sides by navigating the unit
on the foot.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import replace
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import FloatArray
from pdrbench.inertial import find_strides, navigate_smoothed
from pdrbench_lab.realism.block import Block, Control, Distribution, Part, Values, Within, clustered, statistics
from pdrbench_lab.realism.foot_statistics import LOOPS, ON_INSTEP, inertial_columns, recorded_logs
from pdrbench_sim.buildings.assembly import one_room
from pdrbench_sim.foot.foot import foot_motion
from pdrbench_sim.foot.site import SOLE
from pdrbench_sim.people.person import draw_person
from pdrbench_sim.people.route import Place, navigation_mesh
from pdrbench_sim.people.strides import NATURAL_GAIT, Stances, stances
from pdrbench_sim.people.walk import SimulatedWalk
from pdrbench_sim.people.walker import NATURAL_WALK, walk_through
from pdrbench_sim.units.device import draw_unit
from pdrbench_sim.units.profiles import imu_profile

MIN_BOX: Final = 8  # strides; in shorter ones a straight line takes away too much
NUM_BOXES: Final = 16
CORRIDOR_M: Final = 1000.0  # some 700 strides
ENDS: Final = 3  # strides that begin or end a walk
STEADY: Final = 0.15  # strides whose length is within this fraction of the walk's median
TURNING_RAD: Final = math.radians(15.0)  # of a stride; people slow down beside such turns
MIN_STEADY_STRIDES: Final = 8  # steady strides that a walk needs
# Without stops and turning back: one bout.
ONWARD: Final = replace(NATURAL_WALK, pause_every_s=1e9, u_turn_fraction=0.0)
PUBLISHED: Final = "stride times of an hour's walk on PhysioNet: 0.83 (sources.md 1.2)"


def dfa_exponent(series: FloatArray) -> float:
    """Exponent of detrended fluctuation analysis: 0.5 for white noise, 1 for 1/f noise, 1.5 for a random walk.

    The series (N,), less its mean, is summed up; in boxes of n a straight line is taken off; the exponent is the slope
    of log F(n) over log n, F being the root mean square of what is left, for n from `MIN_BOX` to N/4 (C.-K. Peng,
    S. Havlin, H. E. Stanley, A. L. Goldberger, Chaos 5, 1995). NaN where the series is too short.
    """
    longest = len(series) // 4
    if longest < 2 * MIN_BOX:
        return float("nan")
    profile = np.cumsum(series - series.mean())
    sizes = np.unique(np.rint(np.geomspace(MIN_BOX, longest, NUM_BOXES)).astype(np.int64))
    fluctuation = []
    for size in sizes.tolist():
        boxes = profile[: len(profile) // size * size].reshape(-1, size).T
        line = np.vander(np.arange(size), 2)
        left = boxes - line @ np.linalg.lstsq(line, boxes, rcond=None)[0]
        fluctuation.append(np.sqrt((left**2).mean()))
    return float(np.polyfit(np.log(sizes), np.log(fluctuation), 1)[0])


def variation(t_s: FloatArray, accel: FloatArray, gyro: FloatArray) -> tuple[float, float]:
    """Standard deviation over mean of time and of length of the steady strides of a walk; NaN where there are few.

    Steady are strides of the usual length, off turns and off the ends of the walk.

    Args:
        t_s: (n,).
        accel: (n, 3) of a unit on a foot, m/s2.
        gyro: (n, 3) rad/s.
    """
    states = navigate_smoothed(t_s, accel, gyro)
    found = find_strides(states)
    if len(found.length_m) < MIN_STEADY_STRIDES:
        return float("nan"), float("nan")
    # A foot at rest has no sharp moment; a swinging one is fastest at one.
    speed_mps = np.hypot(*states.velocity_mps[:, :2].T)
    bounds = np.searchsorted(states.t_s, np.column_stack([found.start_s, found.end_s]))
    fastest_s = np.array([states.t_s[low + speed_mps[low:high].argmax()] for low, high in bounds.tolist()])
    stride_s, length_m = np.diff(fastest_s), found.length_m[1:]
    unsteady = np.abs(length_m / np.median(length_m) - 1) > STEADY
    turning = np.abs(found.turn_rad[1:]) > TURNING_RAD
    steady = np.convolve(unsteady | turning, np.ones(3), mode="same") < 0.5  # nor is the stride before or after
    steady[:ENDS] = steady[-ENDS:] = False
    if steady.sum() < MIN_STEADY_STRIDES:
        return float("nan"), float("nan")
    stride_s, length_m = stride_s[steady], length_m[steady]
    return float(stride_s.std() / stride_s.mean()), float(length_m.std() / length_m.mean())


def real(part: Part) -> Values:
    """The variation on recorded walks; nothing for the exponent."""
    logs = recorded_logs((ON_INSTEP if part == "fit" else LOOPS)[part])
    return _variations([[inertial_columns(log) for log in logs]])


def _variations(people: Iterable[Iterable[tuple[FloatArray, FloatArray, FloatArray]]]) -> Values:
    """Of walks by person."""
    found = [100 * np.array([variation(*walk) for walk in walks]).reshape(-1, 2) for walks in people]
    names = ("stride_time_cv", "stride_length_cv")
    return {key: v for k, name in enumerate(names) for key, v in clustered(name, [p[:, k] for p in found]).items()}


def synthetic(seed: int, count: int) -> Values:
    """The exponent of `count` people on a long straight way; the variation of as many on a loop."""
    exponent = np.array([dfa_exponent(_stride_times(seed, number)) for number in range(count)])
    return {"dfa": exponent, **_variations([_measured(seed, number)] for number in range(count))}


def shuffled(seed: int, count: int) -> Values:
    """The same stride times in any order."""
    rng = np.random.default_rng([seed, count])
    return {"dfa": np.array([dfa_exponent(rng.permutation(_stride_times(seed, n))) for n in range(count)])}


def _stride_times(seed: int, number: int) -> FloatArray:
    """(S,) of the left foot of a person on a long straight way."""
    left, _ = _feet(_corridor(), ((1.0, 2.0), (CORRIDOR_M - 1.0, 2.0)), [seed, number, 0])[1]
    return np.diff(left.mid_s)[ENDS:-ENDS]


def _measured(seed: int, number: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, accelerometer and gyroscope of a unit in the left sole of a person on a loop."""
    building = _loop()
    walk, (left, _) = _feet(building, ((17.0, 10.75), (14.0, 10.75)), [seed, number, 1])
    rng = np.random.default_rng([seed, number, 2])
    motion = foot_motion(building, left, rng, end_s=walk.end_s + 1.0, site=SOLE)
    return draw_unit(imu_profile("3dm-gx3"), rng).measure(motion.t_s, *motion.ideal_signals(), rng)


def _feet(
    building: Building, places: tuple[tuple[float, float], ...], seed: list[int]
) -> tuple[SimulatedWalk, tuple[Stances, Stances]]:
    """A person's walk from one place to the next."""
    person, way, gait = np.random.default_rng(seed).spawn(3)
    there = [Place(0, np.array(xy_m)) for xy_m in places]
    walk = walk_through(way, navigation_mesh(building), draw_person(person), there, ONWARD)
    return walk, stances(walk, gait, NATURAL_GAIT)


@functools.cache
def _corridor() -> Building:
    return one_room("corridor", [(0, 0), (CORRIDOR_M, 0), (CORRIDOR_M, 4), (0, 4)])


@functools.cache
def _loop() -> Building:
    """Nearly a loop, of the size of those of `foot_loops`: 10 m by 29 m, with a wall where it would close."""
    outer = [(0, 0), (31, 0), (31, 12), (16, 12), (16, 9.5)]
    inner = [(28.5, 9.5), (28.5, 2.5), (2.5, 2.5), (2.5, 9.5), (15, 9.5), (15, 12), (0, 12)]
    return one_room("loop", [*outer, *inner])


GAIT: Final = Block(
    name="Gait",
    statistics=(
        *statistics(
            "walk", Within(0.73, 0.93, PUBLISHED), ("dfa", "DFA exponent of stride times on a long straight way", "")
        ),
        *statistics(
            "walk",
            Distribution(),
            ("stride_time_cv", "variation of the time of steady strides", "%"),
            ("stride_length_cv", "variation of the length of steady strides", "%"),
        ),
    ),
    datasets=("foot_loops",),
    real=real,
    synthetic=synthetic,
    count=60,
    controls={"shuffled steps": Control("the order of strides is shuffled", shuffled, "dfa")},
)
