"""Rounds of one loop, walked again and again: what a map of one's own way is worth on recordings of a foot.

`foot_loops` holds seven rounds of one loop by one walker, who began and ended each on the same place. Strides of
several rounds, one after the other, are a longer walk. Where the foot was is known at the ends only; in between it is
taken to be where inertial navigation says, less the gap between both ends in proportion to the way: 0.1 to 0.5 m.
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Any, Final

import numpy as np

from pdrbench.geometry import FloatArray, IntArray, path_heading_rad, wrap_rad
from pdrbench.inertial import find_strides, navigate
from pdrbench_lab.foot_ins.experiments import LOOPS, units_of, walks_of
from pdrbench_lab.footslam.cloud import ADAPTIVE_FILTER, OdometryNoise, SlamCloud, SlamParams

NUM_ROUNDS: Final = 4
CHORD_M: Final = 2.0  # over which the heading at the end of a round is measured
NUM_POINTS: Final = 200  # of a round, evenly spaced, by which rounds are laid upon each other
ADDED_DRIFT_RAD: Final = math.radians(0.29)  # sources.md, note 1: the widest that is stated for a foot-mounted unit
FILTERS: Final[Mapping[str, SlamParams]] = MappingProxyType(
    {
        "nomap": SlamParams(uses_map=False),
        "map": SlamParams(),
        "map_half": SlamParams(radius_m=0.5),  # the hexagons of the papers
    }
)


@dataclass(frozen=True, slots=True)
class Round:
    """One loop.

    Attributes:
        length_m: (S,) of the strides.
        heading_rad: (S,) as navigated.
        true_m: (S + 1, 2) from the start on, closed.
    """

    length_m: FloatArray
    heading_rad: FloatArray
    true_m: FloatArray

    @property
    def heading_error_rad(self) -> float:
        """By how much the navigated heading at the end differs from that of the closed loop."""
        moved_m = self.length_m[:, None] * np.column_stack([np.cos(self.heading_rad), np.sin(self.heading_rad)])
        navigated_m = np.concatenate([np.zeros((1, 2)), np.cumsum(moved_m, axis=0)])
        ends = [path_heading_rad(way_m[::-1], CHORD_M) for way_m in (navigated_m, self.true_m)]
        assert ends[0] is not None and ends[1] is not None
        return float(wrap_rad(ends[0] - ends[1]))

    def turned(self, angle_rad: float) -> Round:
        """The same in another frame."""
        c, s = math.cos(angle_rad), math.sin(angle_rad)
        return Round(self.length_m, self.heading_rad + angle_rad, self.true_m @ np.array([[c, s], [-s, c]]))


@dataclass(frozen=True, slots=True)
class LongWalk:
    """Several rounds, one after the other.

    Attributes:
        strides: (S, 2) lengths and turns; the first turn counts from +x.
        true_m: (S, 2) after each stride.
        round: (S,) number from 0.
        middle: (R,) index of the stride in the middle of each round, by length.
        end: (R,) index of the last stride of each round.
    """

    strides: FloatArray
    true_m: FloatArray
    round: IntArray
    middle: IntArray
    end: IntArray


def recorded_rounds() -> list[Round]:
    """The loops of `foot_loops`, each in the frame of its own navigation."""
    rounds = []
    for walk in walks_of("foot_loops"):
        strides = find_strides(navigate(*walk.rows))
        way_m = np.concatenate([strides.start_xyz_m[:1, :2], strides.end_xyz_m[:, :2]])
        way_m = way_m - way_m[0]
        rounds.append(Round(strides.length_m, strides.heading_rad, closed(way_m)))
    return rounds


def closed(way_m: FloatArray) -> FloatArray:
    """(T, 2) a way that ends where it begins: the gap is taken off in proportion to the way so far."""
    along_m = _along_m(way_m)
    shut: FloatArray = way_m - along_m[:, None] / along_m[-1] * (way_m[-1] - way_m[0])
    return shut


def turn_onto_rad(way_m: FloatArray, onto_m: FloatArray) -> float:
    """Angle about the start by which a way lies best on another, point for point along both."""
    a, b = _evenly(way_m), _evenly(onto_m)
    return math.atan2(float(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0])), float(np.sum(a * b)))


def long_walk(rounds: Sequence[Round], drift_rad: float = 0.0) -> LongWalk:
    """Rounds in a row, as one unit would have navigated them.

    All are turned onto the first. The error of heading that one has at its end goes on through those that follow, and
    every stride adds a drift.
    """
    turned = [one.turned(turn_onto_rad(one.true_m, rounds[0].true_m)) for one in rounds]
    error_rad = np.concatenate([[0.0], np.cumsum([one.heading_error_rad for one in turned])[:-1]])
    count = np.array([len(one.length_m) for one in turned])
    heading_rad = np.concatenate([one.heading_rad + e for one, e in zip(turned, error_rad, strict=True)])
    heading_rad = heading_rad + drift_rad * np.arange(1, len(heading_rad) + 1)
    end = np.cumsum(count) - 1
    half = [int(np.searchsorted(np.cumsum(one.length_m), one.length_m.sum() / 2)) for one in turned]
    return LongWalk(
        strides=np.column_stack([np.concatenate([one.length_m for one in turned]), np.diff(heading_rad, prepend=0.0)]),
        true_m=np.concatenate([one.true_m[1:] for one in turned]),
        round=np.repeat(np.arange(len(turned)), count),
        middle=end - count + 1 + half,
        end=end,
    )


def navigated_m(walk: LongWalk) -> FloatArray:
    """(S, 2) after each stride by adding strides alone."""
    heading_rad = np.cumsum(walk.strides[:, 1])
    added: FloatArray = np.cumsum(
        walk.strides[:, :1] * np.column_stack([np.cos(heading_rad), np.sin(heading_rad)]), axis=0
    )
    return added


def answered_m(walk: LongWalk, noise: OdometryNoise, params: SlamParams, rng: np.random.Generator) -> FloatArray:
    """(S, 2) the answer of the filter after each stride."""
    cloud, found = SlamCloud(np.zeros(2), 0.0, noise, params, rng), []
    for length_m, turn_rad in walk.strides.tolist():
        cloud.stride(length_m, turn_rad, 0)
        found.append(cloud.mean()[0])
    return np.array(found)


def rounds(seed: int) -> dict[str, Any]:
    """Errors in metres of walks of four rounds, each beginning with another of the loops: (7,) by name.

    `<who>_<drift>_<when>`: who adds strides (`strides`) or is one of `FILTERS`; `real` as recorded, `drift` with a
    drift of N(0, 0.29 degrees) a stride added to each walk, and to the prior of the filter; `end1`, `middle2`, `end2`,
    `end4` at one stride, `mean1` to `mean4` over a round. `<who>_<drift>_ratio`: mean of `mean4` over that of
    `strides`.
    """
    recorded, rng = recorded_rounds(), np.random.default_rng(seed)
    prior = math.hypot(ADAPTIVE_FILTER.drift_sigma_rad, ADDED_DRIFT_RAD)
    regimes = (("real", 0.0, ADAPTIVE_FILTER), ("drift", 1.0, replace(ADAPTIVE_FILTER, drift_sigma_rad=prior)))
    found: dict[str, list[float]] = defaultdict(list)
    for first in range(len(recorded)):
        in_order = [recorded[(first + k) % len(recorded)] for k in range(NUM_ROUNDS)]
        unit = rng.standard_normal()
        for regime, amount, noise in regimes:
            walk = long_walk(in_order, amount * ADDED_DRIFT_RAD * unit)
            _record(found, f"strides_{regime}", walk, navigated_m(walk))
            for who, params in FILTERS.items():
                _record(found, f"{who}_{regime}", walk, answered_m(walk, noise, params, rng.spawn(1)[0]))
    arrays = {name: np.array(values) for name, values in found.items()}
    ratios = {
        f"{who}_{regime}_ratio": float(
            arrays[f"{who}_{regime}_mean4"].mean() / arrays[f"strides_{regime}_mean4"].mean()
        )
        for who in FILTERS
        for regime, _, _ in regimes
    }
    return {**arrays, **ratios, "unit": units_of(LOOPS)}


def _record(found: dict[str, list[float]], name: str, walk: LongWalk, answered: FloatArray) -> None:
    error_m = np.hypot(*(answered - walk.true_m).T)
    found[f"{name}_end1"].append(float(error_m[walk.end[0]]))
    found[f"{name}_middle2"].append(float(error_m[walk.middle[1]]))
    found[f"{name}_end2"].append(float(error_m[walk.end[1]]))
    found[f"{name}_end{NUM_ROUNDS}"].append(float(error_m[walk.end[-1]]))
    for number in range(NUM_ROUNDS):
        found[f"{name}_mean{number + 1}"].append(float(error_m[walk.round == number].mean()))


def _along_m(way_m: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way_m, axis=0).T))])


def _evenly(way_m: FloatArray) -> FloatArray:
    along_m = _along_m(way_m)
    at_m = np.linspace(0.0, along_m[-1], NUM_POINTS)
    return np.column_stack([np.interp(at_m, along_m, column) for column in way_m.T])
