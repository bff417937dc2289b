"""Closed walks of one foot round a rectangle, as the recorded sets have them, and what a unit on the foot measures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import FloatArray, read_only
from pdrbench.inertial.quaternions import from_yaw_pitch_roll
from pdrbench_sim.buildings.assembly import one_room
from pdrbench_sim.foot.foot import foot_motion
from pdrbench_sim.foot.shape import GaitShape
from pdrbench_sim.foot.site import INSTEP, SOLE, FootSite
from pdrbench_sim.foot.style import FootStyle, SwingParams, draw_foot_style
from pdrbench_sim.people.person import Person, draw_person
from pdrbench_sim.people.strides import NATURAL_GAIT, Stances
from pdrbench_sim.units.device import ImuUnit, draw_unit
from pdrbench_sim.units.motion import RigidMotion
from pdrbench_sim.units.profiles import imu_profile

_RATE_HZ: Final = 500.0
_OUTSIDE_M: Final = 20.0  # from the walk to the walls of the hall


@dataclass(frozen=True, slots=True)
class FootProtocol:
    """How a set was recorded; ranges are least and most.

    Attributes:
        width_m, depth_m: Of the rectangle, ranges.
        corner_m: Radius of its corners.
        distance_m: Range of how far one walk leads, rounded to whole laps.
        speed_mps: Range of the speed of a walk.
        still_s: The foot stands at either end, range.
        device: Profile of the unit.
        site: Where on the shoe the unit sits.
    """

    width_m: tuple[float, float]
    depth_m: tuple[float, float]
    corner_m: float
    distance_m: tuple[float, float]
    speed_mps: tuple[float, float]
    still_s: tuple[float, float]
    device: str
    site: FootSite = INSTEP


@dataclass(frozen=True, slots=True)
class Walker:
    """One person in one pair of shoes with one unit: what all walks of a recorded set have in common."""

    person: Person
    style: FootStyle
    unit: ImuUnit


def draw_walker(rng: np.random.Generator, device: str, params: SwingParams | None = None) -> Walker:
    """Draws a person, a foot and a unit of that profile."""
    for_person, for_style, for_unit = rng.spawn(3)
    unit = draw_unit(imu_profile(device), for_unit)
    return Walker(draw_person(for_person), draw_foot_style(for_style, params), unit)


@dataclass(frozen=True, slots=True)
class SyntheticFootWalk:
    """One synthetic walk: the truth and what the unit delivers.

    Attributes:
        motion: Of the unit; the first and the last place are the same.
        signals: Stamps (n,) in s, specific force (n, 3) in m/s2, angular rate (n, 3) in rad/s.
    """

    motion: RigidMotion
    signals: tuple[FloatArray, FloatArray, FloatArray]


def foot_walk(
    rng: np.random.Generator,
    protocol: FootProtocol,
    *,
    walker: Walker | None = None,
    style: FootStyle | None = None,
    params: SwingParams | None = None,
    gaits: tuple[GaitShape, GaitShape] | None = None,
) -> SyntheticFootWalk:
    """A person's walk under a protocol; the unit is mounted with its axes at random, as the recorded ones are.

    Without a walker every walk is that of another person with another unit, in the shoes of `style` where given.
    """
    for_way, for_foot, for_mount, for_unit, for_noise = rng.spawn(5)
    building, rests, end_s = loop(for_way, protocol, walker.person if walker else None)
    motion = foot_motion(
        building,
        rests,
        for_foot,
        end_s=end_s,
        rate_hz=_RATE_HZ,
        style=walker.style if walker else style,
        params=params,
        gaits=gaits,
        site=protocol.site,
    )
    motion = motion.mounted(_mount(for_mount, protocol.site))
    unit = walker.unit if walker else draw_unit(imu_profile(protocol.device), for_unit)
    return SyntheticFootWalk(motion, unit.measure(motion.t_s, *motion.ideal_signals(), for_noise))


def _mount(rng: np.random.Generator, site: FootSite) -> FloatArray:
    """(4,) tilted by some 45 degrees on the laces, about a horizontal axis of any direction; nearly flat in a sole."""
    yaw, pitch = rng.uniform(-math.pi, math.pi), rng.uniform(*((0.0, 0.2) if site == SOLE else (0.4, 1.0)))
    return np.asarray(from_yaw_pitch_roll(np.array([yaw]), np.array([pitch]), np.zeros(1))[0])


def loop(
    rng: np.random.Generator, protocol: FootProtocol, person: Person | None = None
) -> tuple[Building, Stances, float]:
    """A hall, the rests of one foot on its way round a rectangle back to where it began, and the end of the walk."""
    for_person, for_way, for_strides = rng.spawn(3)
    person = person or draw_person(for_person)
    width_m, depth_m = for_way.uniform(*protocol.width_m), for_way.uniform(*protocol.depth_m)
    speed_mps = for_way.uniform(*protocol.speed_mps)
    side = 1.0 if for_way.random() < 0.5 else -1.0
    corner_m = min(protocol.corner_m, 0.45 * min(width_m, depth_m))
    lap_m = 2 * (width_m + depth_m) - (8 - 2 * math.pi) * corner_m
    laps = max(1, round(for_way.uniform(*protocol.distance_m) / lap_m))
    length_m = 2 * float(person.step_at(np.array([speed_mps]))[0])
    way_m, time_s = _strides(for_strides, laps * lap_m, length_m, speed_mps)
    xy_m, yaw_rad = _rounded(way_m % lap_m, width_m, depth_m, corner_m)
    xy_m[-1], yaw_rad = xy_m[0], np.unwrap(yaw_rad)
    before_s, after_s = for_way.uniform(*protocol.still_s, 2)
    mid_s = np.concatenate([[0.0], before_s + np.cumsum(time_s)])
    margin_s = 0.175 * np.diff(mid_s)
    rests = Stances(
        mid_s=read_only(mid_s),
        begin_s=read_only(np.concatenate([[0.0], mid_s[1:] - margin_s])),
        end_s=read_only(np.concatenate([mid_s[:-1] + margin_s, [np.inf]])),
        xy_m=read_only(xy_m * [1, side]),
        polygon=read_only(np.zeros(len(mid_s)), np.int64),
        yaw_rad=read_only(side * yaw_rad),
    )
    return _hall(width_m, depth_m), rests, float(mid_s[-1]) + after_s


def _strides(
    rng: np.random.Generator, way_m: float, length_m: float, speed_mps: float
) -> tuple[FloatArray, FloatArray]:
    """(S,) way after each stride, from 0, and (S - 1,) how long each took; the first and the last are half as long."""
    count = max(2, round(way_m / length_m))
    size = np.concatenate([[0.5], np.ones(count - 1), [0.5]]) * (1 + _LENGTH_CV * rng.standard_normal(count + 1))
    length = size * way_m / size.sum()
    spread = _TIME_CV * math.exp(
        NATURAL_GAIT.unsteady_log_sigma * float(np.clip(rng.spawn(1)[0].standard_normal(), -2, 2))
    )
    time_s = way_m / count / speed_mps * (1 + spread * rng.standard_normal(count + 1))
    time_s[[0, -1]] *= 0.8  # half as long, not half as quick
    return np.concatenate([[0.0], np.cumsum(length)]), np.asarray(time_s)


_LENGTH_CV: Final = 0.035  # [M] 4.5 % with turns (sources.md 1.2); it does not hang together with the time
# In the median walk. Times from rest to rest, as a filter finds them, then vary by 3.2 % in loops, by 2.6 to 3.8 % as
# printed (sources.md 1.2), and on the instep, the outer tenth left out, by 3.0 %: [M] 2.9 and 3.1 % in two long walks.
_TIME_CV: Final = 0.029


def _rounded(way_m: FloatArray, width_m: float, depth_m: float, corner_m: float) -> tuple[FloatArray, FloatArray]:
    """(S, 2) places and (S,) headings on a rectangle with round corners, counter-clockwise from the origin."""
    straight = np.array([width_m, depth_m, width_m, depth_m]) - 2 * corner_m
    arc_m = math.pi / 2 * corner_m
    # The walk begins in the middle of the first side, so that it ends straight on.
    pieces_m = np.array([straight[0] / 2, *(v for side in straight[1:] for v in (arc_m, side)), arc_m, straight[0] / 2])
    ends_m = np.concatenate([[0.0], np.cumsum(pieces_m)])
    turn = np.tile([0.0, 1 / corner_m], 5)[: len(pieces_m)]
    fine = np.linspace(0, ends_m[-1], 4001)
    middle = (fine[1:] + fine[:-1]) / 2
    curvature = turn[np.searchsorted(ends_m, middle, side="right") - 1]
    step = np.diff(fine)
    heading = np.concatenate([[0.0], np.cumsum(curvature * step)])
    heading *= 2 * math.pi / heading[-1]
    mid_heading = (heading[1:] + heading[:-1]) / 2
    moved = step[:, None] * np.column_stack([np.cos(mid_heading), np.sin(mid_heading)])
    path = np.vstack([np.zeros((1, 2)), np.cumsum(moved, axis=0)])
    path -= np.outer(fine / fine[-1], path[-1])  # closes to the last bit
    return np.column_stack([np.interp(way_m, fine, column) for column in path.T]), np.interp(way_m, fine, heading)


def _hall(width_m: float, depth_m: float) -> Building:
    """One floor all around."""
    reach = width_m + depth_m + _OUTSIDE_M
    outline = reach * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return one_room("hall", outline)
