"""A surveyor's walk over a wide floor: straight from one surveyed place to the next, each marked on the phone.

What a heading or a leg is compared with are the bearings between those places, so that where they lie and when they
are marked matters as much as the phone: in the recordings half of the places lie at a turn, the mark is made a second
before the body has turned, and to some places a person shifts aside without turning. Turns are those of 202 places on
the walks that parameters may be fitted on (site 1, train and survey walks [M]); lengths and marks those of its 15 walks
with every sensor.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.ndimage import gaussian_filter1d

from pdrbench.building import Building
from pdrbench.geometry import FloatArray, read_only, wrap_rad
from pdrbench.trajectory import Trajectory
from pdrbench_lab.realism.surveyors import SURVEYORS
from pdrbench_sim.buildings.assembly import one_room
from pdrbench_sim.people.body_line import arc_length_m
from pdrbench_sim.people.person import draw_person
from pdrbench_sim.people.walk import Bout, SimulatedWalk

HALF_M: Final = 400.0  # of the side of the floor: no walk comes near its walls
_SPACING_M: Final = 0.05
_LEAD_IN_S: Final = 1.5  # standing before the first step


@dataclass(frozen=True, slots=True)
class SurveyorParams:
    """How surveyors walk from place to place.

    Attributes:
        leg_median_m, leg_log_sigma: Of the log-normal law of legs; standard deviation of the logarithm.
        leg_m: Shortest and longest.
        turn_fraction: Fraction of places with a sharp turn where the shorter one of both legs is shortest.
        turn_fraction_per_m: By which it falls for each metre that this leg is longer, to `min_turn_fraction`.
        min_turn_fraction: Of them, wherever legs are long.
        turn_rad: Mean and standard deviation of the size of these turns.
        slant_fraction: Fraction of places beside a leg of up to `slant_m` with a turn by `slant_rad`.
        slant_m: Length of the shorter leg, at most.
        slant_rad: Least and most, evenly.
        aside_m: Elsewhere the direction changes by a Laplace law whose mean size is so much over the shorter leg.
        shift_fraction: Of the legs up to `slant_m` long, off the direction of a longer neighbour by `slant_rad`, those
            in which the body does not turn but shifts aside.
        shift_turn: Fraction of the turn into such a leg that the body and what it holds make.
        corner_m: Half of the way over which a turn is made.
        corner_speed: Fraction of the speed left in a sharp turn.
        sway_m, sway_length_m: Standard deviation of the deviation from the straight line; its correlation length.
        off_m: Standard deviation, on each axis, of the place from where it is marked.
        early_s: How long before the middle of a turn its place is marked; mean and standard deviation. The last place
            is marked when the body has come to a stop there.
        run_up_m: Way walked before the first place, which is marked in passing.
        accel_mps2: Setting off and stopping.
    """

    leg_median_m: float = 5.0  # [M] 45 legs of the walks with every sensor; survey walks have longer ones
    leg_log_sigma: float = 0.64  # [M]
    leg_m: tuple[float, float] = (2.0, 15.0)  # [M] 2.2 to 13.3 m hold 90 % of them
    turn_fraction: float = 0.68  # [M] 71 % of turns at a leg shorter than 3 m are sharper than 48 degrees
    turn_fraction_per_m: float = 0.05  # [M] and 37 % of those at a leg longer than 9 m
    min_turn_fraction: float = 0.25  # ours
    turn_rad: tuple[float, float] = (math.radians(90.0), math.radians(22.0))  # [M] quartile 91, 95 %: 128 degrees
    slant_fraction: float = 0.19  # [M] with the other laws 30 % at legs of 3 to 6 m, 20 % at shorter ones
    slant_m: float = 6.0  # [M] 5 % beside longer ones
    slant_rad: tuple[float, float] = (math.radians(30.0), math.radians(65.0))  # [M]
    aside_m: float = 1.0  # [M] a quarter of turns is smaller than 36 degrees at the short legs, 3 degrees at the long
    shift_fraction: float = 0.65  # [M] at 7 of 11 such places of 15 walks, and at 1 of the 19 others
    shift_turn: float = 0.3  # [M] by the gyroscope of the phone, 13 of 44 degrees
    corner_m: float = 0.35  # [M] 15 to 85 % of a turn within 0.75 s
    corner_speed: float = 0.45  # [M] 0.8 m/s on legs shorter than 3 m, 1.25 m/s on those longer than 8 m
    sway_m: float = 0.15  # ours: a straight line is aimed at
    sway_length_m: float = 4.0  # ours
    off_m: float = 0.2  # ours: a third of a step
    early_s: tuple[float, float] = (0.93, 0.12)  # [M] gyroscope at 13 clear turns: quartiles 0.89 and 1.03 s
    run_up_m: float = 3.0  # [M] accelerometers of 15 walks: full speed at the first mark
    accel_mps2: float = 0.9  # as `WalkParams`


@functools.cache
def wide_floor() -> Building:
    """One floor without anything on it."""
    corner = HALF_M * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    return one_room("wide floor", corner)


def survey_walk(
    rng: np.random.Generator, num_places: int, params: SurveyorParams | None = None
) -> tuple[SimulatedWalk, Trajectory]:
    """One surveyor's way over `wide_floor`, and the places as they were marked.

    Args:
        rng: Person, places, speed and marks draw from children of their own.
        num_places: Two or more.
        params: None for the defaults.
    """
    params = params or SurveyorParams()
    who, where, how, when, beside, facing = rng.spawn(6)
    person = draw_person(who, SURVEYORS)
    places_m = _draw_places(where, num_places, params)
    ahead_m = params.run_up_m * (places_m[0] - places_m[1]) / np.hypot(*(places_m[0] - places_m[1]))
    xy_m, s_m, corner_s_m = _rounded(how, np.vstack([places_m[:1] + ahead_m, places_m]), params)
    corner_s_m = corner_s_m[1:]
    travel_rad = np.unwrap(np.arctan2(*np.gradient(xy_m, s_m, axis=0).T[::-1]))
    heading_rad = travel_rad - _aside_rad(facing, places_m, s_m, corner_s_m, params)
    speed = person.speed_mps * _slower(s_m, heading_rad, params)
    speed = np.minimum(speed, np.sqrt(2 * params.accel_mps2 * np.minimum(s_m, s_m[-1] - s_m)))
    speed = _eased(s_m, speed, params.accel_mps2)
    t_s = _LEAD_IN_S + np.concatenate([[0.0], np.cumsum(2 * np.diff(s_m) / (speed[1:] + speed[:-1]))])
    bout = Bout(
        t_s=read_only(t_s),
        s_m=read_only(s_m),
        speed_mps=read_only(speed),
        xy_m=read_only(xy_m),
        polygon=read_only(np.zeros(len(s_m)), np.int64),
        heading_rad=read_only(heading_rad),
        treads_s_m=np.zeros(0),
        climb_s_m=read_only([0.0, s_m[-1]]),
        climb_z_m=np.zeros(2),
    )
    early_s = np.clip(params.early_s[0] + params.early_s[1] * when.standard_normal(num_places), 0.0, 1.4)
    early_s[-1] = 0.0
    mark_s = np.interp(corner_s_m, s_m, t_s) - early_s
    marks = Trajectory(
        t_s=np.maximum.accumulate(mark_s),
        xy_m=places_m + params.off_m * beside.standard_normal(places_m.shape),
        level=np.zeros(num_places, dtype=np.int64),
        surveyed=np.ones(num_places, dtype=np.bool_),
    )
    return SimulatedWalk(wide_floor(), person, (bout,)), marks


def _draw_places(rng: np.random.Generator, count: int, params: SurveyorParams) -> FloatArray:
    """(count, 2) a chain of legs and turns around the middle of the floor."""
    leg_m = params.leg_median_m * np.exp(params.leg_log_sigma * rng.standard_normal(count - 1))
    leg_m = np.clip(leg_m, *params.leg_m)
    shorter_m = np.minimum(leg_m[1:], leg_m[:-1])
    sharp_fraction = params.turn_fraction - params.turn_fraction_per_m * (shorter_m - params.leg_m[0])
    mean, sigma = params.turn_rad
    left = rng.choice([-1.0, 1.0], count - 2)
    sharp_rad = left * (mean + sigma * rng.standard_normal(count - 2))
    slant_rad = left * rng.uniform(*params.slant_rad, count - 2)
    aside_rad = params.aside_m / shorter_m * rng.laplace(size=count - 2)
    kind = rng.random(count - 2)
    is_sharp = kind < np.maximum(sharp_fraction, params.min_turn_fraction)
    is_slant = (kind > 1 - params.slant_fraction) & (shorter_m <= params.slant_m)
    turn_rad = np.concatenate([[0.0], np.select([is_sharp, is_slant], [sharp_rad, slant_rad], aside_rad)])
    travel_rad = rng.uniform(-math.pi, math.pi) + np.cumsum(turn_rad)
    step_m = leg_m[:, None] * np.column_stack([np.cos(travel_rad), np.sin(travel_rad)])
    places_m = np.vstack([np.zeros((1, 2)), np.cumsum(step_m, axis=0)])
    return np.asarray(places_m - places_m.mean(axis=0))


def _rounded(
    rng: np.random.Generator, places_m: FloatArray, params: SurveyorParams
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points of a swaying way with round corners, the way to them, and the way to each place."""
    leg_m = np.hypot(*np.diff(places_m, axis=0).T)
    at_m = np.concatenate([[0.0], np.cumsum(leg_m)])
    count = 1 + math.ceil(at_m[-1] / _SPACING_M)
    along_m = np.linspace(0.0, at_m[-1], count)
    xy_m = np.column_stack([np.interp(along_m, at_m, places_m[:, axis]) for axis in (0, 1)])
    sway = gaussian_filter1d(rng.standard_normal((count, 2)), params.sway_length_m / _SPACING_M / 2, axis=0)
    sway *= params.sway_m * math.sqrt(math.sqrt(math.pi) * params.sway_length_m / _SPACING_M)
    xy_m = gaussian_filter1d(xy_m, params.corner_m / _SPACING_M, axis=0, mode="nearest") + sway
    s_m = arc_length_m(xy_m)
    return xy_m, s_m, np.interp(at_m, along_m, s_m)


def _aside_rad(
    rng: np.random.Generator, places_m: FloatArray, s_m: FloatArray, corner_s_m: FloatArray, params: SurveyorParams
) -> FloatArray:
    """(n,) angle from where the body faces to where it moves, counter-clockwise: not 0 where a person shifts aside."""
    step_m = np.diff(places_m, axis=0)
    leg_m, travel_rad = np.hypot(*step_m.T), np.arctan2(*step_m.T[::-1])
    shifts = rng.random(len(leg_m)) < params.shift_fraction
    aside_rad = np.zeros(len(leg_m))
    for leg in np.flatnonzero(shifts & (leg_m <= params.slant_m)):
        beside = [other for other in (leg - 1, leg + 1) if 0 <= other < len(leg_m)]
        longer = max(beside, key=leg_m.__getitem__, default=leg)
        turn_rad = float(wrap_rad(travel_rad[leg] - travel_rad[longer]))
        if leg_m[longer] > leg_m[leg] and params.slant_rad[0] <= abs(turn_rad) <= params.slant_rad[1]:
            aside_rad[leg] = (1 - params.shift_turn) * turn_rad
    on_leg = np.clip(np.searchsorted(corner_s_m, s_m, side="right") - 1, 0, len(leg_m) - 1)
    return np.asarray(gaussian_filter1d(aside_rad[on_leg], params.corner_m / _SPACING_M, mode="nearest"))


def _slower(s_m: FloatArray, heading_rad: FloatArray, params: SurveyorParams) -> FloatArray:
    """(n,) fraction of the speed that is left: `corner_speed` in a turn by 90 degrees within 1.5 m."""
    turn = np.interp(s_m + 0.75, s_m, heading_rad) - np.interp(s_m - 0.75, s_m, heading_rad)
    return np.asarray(1 - (1 - params.corner_speed) * np.minimum(np.abs(turn) / (math.pi / 2), 1.0))


def _eased(s_m: FloatArray, speed_mps: FloatArray, accel_mps2: float) -> FloatArray:
    """(n,) the speed, held back where it would change faster than `accel_mps2`."""
    square = speed_mps**2
    for order in (slice(None), slice(None, None, -1)):
        # The least over all points of the square there plus 2 a times the way from it, in one direction.
        way = s_m[order] if order.step is None else -s_m[order]
        square[order] = np.minimum.accumulate(square[order] - 2 * accel_mps2 * way) + 2 * accel_mps2 * way
    return np.sqrt(np.maximum(square, 0.0))
