"""One person's way through a building as bouts of walking, and the body sampled along it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray, IntArray, wrap_rad
from pdrbench_sim.people.person import Person

TURN_STEP_RAD: Final = math.pi / 2  # standing, the feet turn at most this far at a time (sources.md 1.3)
TURN_STEP_S: Final = 1.1  # and take about a stride for it
LIFT_MPS: Final = 1.0  # mean speed of a lift between two levels; ours, those of offices go at 1 to 1.6 m/s
LIFT_DOORS_S: Final = (1.5, 0.5)  # from the last step until a lift starts, at least, and from its stop until a turn


class WalkError(PdrbenchError):
    """A walk that cannot be as it was asked for."""


@dataclass(frozen=True, slots=True)
class Bout:
    """Walking from one standstill to the next, as knots that a body passes with constant acceleration between them."""

    t_s: FloatArray  # (K,) increasing
    s_m: FloatArray  # (K,) way since the beginning of the bout, from 0
    speed_mps: FloatArray  # (K,) 0 at both ends
    xy_m: FloatArray  # (K, 2) of the body
    polygon: IntArray  # (K,) floor polygon
    heading_rad: FloatArray  # (K,) direction of travel of the body, unwrapped within the bout
    treads_s_m: FloatArray  # (J,) way at which the body is in the middle of each tread it passes
    climb_s_m: FloatArray  # (L,) way at knots of the height that the body climbs evenly between
    climb_z_m: FloatArray  # (L,) floor height there: middles of treads, ends of floors
    runner: Person | None = None  # how the person runs; None where they walk

    @property
    def is_run(self) -> bool:
        """True where the person runs."""
        return self.runner is not None

    def way_m(self, t_s: FloatArray) -> FloatArray:
        """(N,) way at times (N,) of the bout."""
        knot = np.clip(np.searchsorted(self.t_s, t_s, side="right") - 1, 0, len(self.t_s) - 2)
        after_s = t_s - self.t_s[knot]
        accel = (self.speed_mps[knot + 1] - self.speed_mps[knot]) / (self.t_s[knot + 1] - self.t_s[knot])
        way: FloatArray = self.s_m[knot] + self.speed_mps[knot] * after_s + accel * after_s**2 / 2
        return np.clip(way, self.s_m[0], self.s_m[-1])

    def time_s(self, s_m: FloatArray) -> FloatArray:
        """(N,) time at which the body has come as far as `s_m` (N,)."""
        knot = np.clip(np.searchsorted(self.s_m, s_m, side="right") - 1, 0, len(self.s_m) - 2)
        way = np.maximum(s_m - self.s_m[knot], 0.0)
        accel = (self.speed_mps[knot + 1] ** 2 - self.speed_mps[knot] ** 2) / (
            2 * (self.s_m[knot + 1] - self.s_m[knot])
        )
        speed = np.sqrt(np.maximum(self.speed_mps[knot] ** 2 + 2 * accel * way, 0.0))
        mean = (self.speed_mps[knot] + speed) / 2
        time: FloatArray = self.t_s[knot] + np.divide(way, mean, out=np.zeros_like(way), where=mean > 0)
        return time

    def place(self, building: Building, s_m: FloatArray) -> tuple[FloatArray, IntArray, FloatArray]:
        """Body at ways (N,): xy_m (N, 2), polygon (N,) and heading_rad (N,)."""
        from scipy.interpolate import CubicSpline

        xy_m = CubicSpline(self.s_m, self.xy_m)(s_m)
        knot = np.clip(np.searchsorted(self.s_m, s_m, side="right") - 1, 0, len(self.s_m) - 2)
        polygon, alive = building.move(self.polygon[knot], self.xy_m[knot], xy_m)
        if not alive.all():
            # A spline bulges by a millimetre at most; where even that is too much, the chord is safe.
            fraction = ((s_m - self.s_m[knot]) / (self.s_m[knot + 1] - self.s_m[knot]))[:, None]
            chord = (1 - fraction) * self.xy_m[knot] + fraction * self.xy_m[knot + 1]
            xy_m = np.where(alive[:, None], xy_m, chord)
            polygon, _ = building.move(self.polygon[knot], self.xy_m[knot], xy_m)
        return xy_m, polygon, np.interp(s_m, self.s_m, self.heading_rad)


@dataclass(frozen=True, slots=True)
class SimulatedWalk:
    """One person's way through a building: bouts of walking, standing still between them."""

    building: Building  # where
    person: Person  # who
    bouts: tuple[Bout, ...]  # in order; the next begins where the last one ended, later

    @property
    def end_s(self) -> float:
        """End of the last bout."""
        return float(self.bouts[-1].t_s[-1])


@dataclass(frozen=True, slots=True)
class BodyPath:
    """Where a body is, evenly in time."""

    t_s: FloatArray  # (T,)
    xy_m: FloatArray  # (T, 2)
    polygon: IntArray  # (T,) int
    z_m: FloatArray  # (T,) height of the floor under the body above level 0, smooth over stairs
    heading_rad: FloatArray  # (T,) direction of travel, unwrapped; turns while standing, too
    speed_mps: FloatArray  # (T,)


def body_path(walk: SimulatedWalk, rate_hz: float = 50.0) -> BodyPath:
    """The body sampled evenly, from t = 0 to the end of the last bout.

    Raises:
        WalkError: A rate that is not positive.
    """
    if not 0 < rate_hz < math.inf:
        raise WalkError(f"a body is sampled at a positive rate; got rate_hz={rate_hz:g}")
    t_s = np.arange(math.floor(walk.end_s * rate_hz) + 1) / rate_hz
    begin = np.searchsorted(t_s, [bout.t_s[0] for bout in walk.bouts], side="left")
    end = np.searchsorted(t_s, [bout.t_s[-1] for bout in walk.bouts], side="right")
    first = walk.bouts[0]
    xy_m, polygon = np.empty((len(t_s), 2)), np.empty(len(t_s), dtype=np.int64)
    z_m, heading_rad, speed_mps = np.empty(len(t_s)), np.empty(len(t_s)), np.zeros(len(t_s))
    xy_m[: begin[0]], polygon[: begin[0]] = first.xy_m[0], first.polygon[0]
    z_m[: begin[0]] = walk.building.height(first.polygon[:1])
    heading_rad[: begin[0]] = last_rad = first.heading_rad[0]
    for i, bout in enumerate(walk.bouts):
        during, after = slice(begin[i], end[i]), slice(end[i], [*begin, len(t_s)][i + 1])
        s_m = bout.way_m(t_s[during])
        xy_m[during], polygon[during], heading = bout.place(walk.building, s_m)
        offset_rad = 2 * math.pi * round((last_rad - bout.heading_rad[0]) / (2 * math.pi))  # whole turns, to go on
        heading_rad[during] = heading + offset_rad
        z_m[during] = np.interp(s_m, bout.climb_s_m, bout.climb_z_m)
        speed_mps[during] = np.interp(t_s[during], bout.t_s, bout.speed_mps)
        xy_m[after], polygon[after] = bout.xy_m[-1], bout.polygon[-1]
        z_m[after] = walk.building.height(bout.polygon[-1:])[0]
        heading_rad[after] = last_rad = bout.heading_rad[-1] + offset_rad
        if i + 1 < len(walk.bouts):
            last_rad = _turn_standing(t_s[after], heading_rad[after], bout, walk.bouts[i + 1], offset_rad)
            rise_m = lift_ride_m(walk.building, bout, walk.bouts[i + 1])
            if rise_m:
                start_s, stop_s = lift_times_s(rise_m, bout, walk.bouts[i + 1])
                fraction = np.clip((t_s[after] - start_s) / (stop_s - start_s), 0.0, 1.0)
                z_m[after] += lifted_m(rise_m, fraction)
                polygon[after] = np.where(fraction < 0.5, bout.polygon[-1], walk.bouts[i + 1].polygon[0])
    return BodyPath(t_s, xy_m, polygon, z_m, heading_rad, speed_mps)


def lifted_m(rise_m: float, fraction: FloatArray) -> FloatArray:
    """(N,) how far up a lift is after fractions (N,) of its time, metres: it starts and stops gently."""
    return rise_m * fraction**2 * (3 - 2 * fraction)


def lift_ride_m(building: Building, before: Bout, after: Bout) -> float:
    """How far a lift carries the person up between two bouts, metres; 0 where they stand on a floor."""
    from_m, to_m = building.height(np.array([before.polygon[-1], after.polygon[0]]))
    return float(to_m - from_m)


def lift_times_s(rise_m: float, before: Bout, after: Bout) -> tuple[float, float]:
    """From when until when a lift that rises by so much goes between two bouts: after all waiting, before any turn."""
    turning_s = TURN_STEP_S * turn_steps(standing_turn_rad(before, after))
    stop_s = float(after.t_s[0]) - turning_s - LIFT_DOORS_S[1]
    return stop_s - abs(rise_m) / LIFT_MPS, stop_s


def standing_turn_rad(before: Bout, after: Bout) -> float:
    """By how much a person turns while standing between two bouts, the short way round."""
    return float(wrap_rad(after.heading_rad[0] - before.heading_rad[-1]))


def turn_steps(turn_rad: float) -> int:
    """In how many steps of each foot a person turns on the spot; small turns are made while walking off."""
    return 0 if abs(turn_rad) < math.radians(20) else math.ceil(abs(turn_rad) / TURN_STEP_RAD)


def _turn_standing(t_s: FloatArray, heading_rad: FloatArray, before: Bout, after: Bout, offset_rad: float) -> float:
    """Fills in the headings (N,) of a turn on the spot, made just before the next bout; returns the last of them."""
    turn_rad = standing_turn_rad(before, after)
    end_s = after.t_s[0]
    start_s = end_s - TURN_STEP_S * max(turn_steps(turn_rad), 0.5)
    turning = t_s >= start_s
    fraction = (t_s[turning] - start_s) / (end_s - start_s)
    heading_rad[turning] = before.heading_rad[-1] + offset_rad + turn_rad * fraction**2 * (3 - 2 * fraction)
    return float(before.heading_rad[-1] + offset_rad + turn_rad)
