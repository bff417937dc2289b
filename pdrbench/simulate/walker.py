"""A person who walks a route: where the body is at every moment (sources.md 1.10).

A leg leads from one place to the next. Its route is resampled and relaxed like an elastic band that walls push away, so
that corners get round and corridors are walked near their middle; sway is added; and wherever the result would touch a
wall or come too near to one it is drawn back towards the route, which never does. Then speed: slower in turns, through
doors and on stairs, with limited acceleration and pauses.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import BoolArray, FloatArray, IntArray, read_only, wrap_rad
from pdrbench.simulate.person import Person
from pdrbench.simulate.route import NavigationMesh, Place, Route, RouteError
from pdrbench.simulate.walls import NearWalls, walls_along

LONGEST_TREAD_M: Final = 0.6  # walked length; what is longer in a "stairs" polygon is a landing
DOOR_WIDTH_M: Final = 1.4  # a connection up to this wide slows a walker down
TURN_STEP_RAD: Final = math.pi / 2  # standing, the feet turn at most this far at a time (sources.md 1.3)
TURN_STEP_S: Final = 1.1  # and take about a stride for it
_SPACINGS_M: Final = (0.1, 0.05, 0.025)  # of the points of a leg; a finer one where the way is too tight


@dataclass(frozen=True, slots=True)
class WalkParams:
    """How people walk through buildings; pairs are ranges of a uniform draw.

    Attributes:
        clearance_m: Kept from corners, jambs and walls where there is room.
        comfort_m: Walls nearer than this push softly; keeps people near the middle of a corridor.
        least_clearance_m: Of the body's middle; in a gap narrower than twice this, 0.9 of what the route has.
        corner_radius_m: Of turns.
        sway_sigma_m: Of the lateral deviation, where there is room.
        sway_length_m: Its correlation length along the way.
        keep_right_m: Mean deviation to the right, where there is room.
        turn_speed: Share of the speed left in a turn by `sharp_turn_rad` or more.
        sharp_turn_rad: Turn within 1.5 m that slows a walker down fully.
        door_speed: Share of the speed left in a door.
        stairs_cadence_up: Cadence on stairs, relative to the flat; one tread a step.
        stairs_cadence_down: The same, downstairs.
        speed_sigma: Of the relative speed.
        speed_time_s: Its correlation time.
        pause_every_s: Mean time between pauses on the way, where they are possible.
        pause_median_s: Of pauses, log-normal.
        pause_log_sigma: Standard deviation of the logarithm.
        accel_mps2: Speeding up and slowing down.
        bend_accel_mps2: Towards the inside of a bend, at most.
        kink_m: Bends shorter than this are smoothed away.
    """

    clearance_m: tuple[float, float] = (0.3, 0.5)  # sources.md 1.10
    comfort_m: float = 0.9  # ours: half a corridor of 1.8 m
    least_clearance_m: float = 0.22  # half of BODY_WIDTH_M, less a tilt of the shoulders
    corner_radius_m: tuple[float, float] = (0.6, 1.2)  # sources.md 1.10
    sway_sigma_m: float = 0.25  # sources.md 1.10
    sway_length_m: float = 6.0  # ours: bends the course by about 3 degrees
    keep_right_m: tuple[float, float] = (0.1, 0.2)  # sources.md 1.10
    turn_speed: float = 0.7  # sources.md 1.10
    sharp_turn_rad: float = math.radians(60)  # sources.md 1.10
    door_speed: tuple[float, float] = (0.5, 0.8)  # sources.md 1.10
    stairs_cadence_up: float = 0.85  # sources.md 1.3: 10 to 20 % below
    stairs_cadence_down: float = 0.9  # sources.md 1.3: 10 to 20 % below
    speed_sigma: float = 0.08  # sources.md 1.10
    speed_time_s: float = 10.0  # sources.md 1.10
    pause_every_s: float = 150.0  # ours: with the stops at places, one in about 45 s (sources.md 1.10)
    pause_median_s: float = 4.0  # sources.md 1.10
    pause_log_sigma: float = 0.6  # ours: one pause in twenty is longer than 11 s
    accel_mps2: float = 0.9  # ours: free speed after about 1.5 s, two or three steps
    bend_accel_mps2: float = 1.2  # ours: comes into play below a radius of 0.6 to 0.9 m
    kink_m: float = 0.2  # ours: a third of a step


@dataclass(frozen=True, slots=True)
class Bout:
    """Walking from one standstill to the next, as knots that a body passes with constant acceleration between them.

    Attributes:
        t_s: (K,) increasing.
        s_m: (K,) way since the beginning of the bout, from 0.
        speed_mps: (K,) 0 at both ends.
        xy_m: (K, 2) of the body.
        polygon: (K,) floor polygon.
        heading_rad: (K,) course of the body, unwrapped within the bout.
        treads_s_m: (J,) way at which the body is in the middle of each tread it passes.
        climb_s_m: (L,) way at knots of the height that the body climbs evenly between.
        climb_z_m: (L,) floor height there: middles of treads, ends of floors.
    """

    t_s: FloatArray
    s_m: FloatArray
    speed_mps: FloatArray
    xy_m: FloatArray
    polygon: IntArray
    heading_rad: FloatArray
    treads_s_m: FloatArray
    climb_s_m: FloatArray
    climb_z_m: FloatArray

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
            share = ((s_m - self.s_m[knot]) / (self.s_m[knot + 1] - self.s_m[knot]))[:, None]
            chord = (1 - share) * self.xy_m[knot] + share * self.xy_m[knot + 1]
            xy_m = np.where(alive[:, None], xy_m, chord)
            polygon, _ = building.move(self.polygon[knot], self.xy_m[knot], xy_m)
        return xy_m, polygon, np.interp(s_m, self.s_m, self.heading_rad)


@dataclass(frozen=True, slots=True)
class Walk:
    """One person's way through a building: bouts of walking, standing still between them.

    Attributes:
        building: Where.
        person: Who.
        bouts: In order; the next begins where the last one ended, later.
    """

    building: Building
    person: Person
    bouts: tuple[Bout, ...]

    @property
    def end_s(self) -> float:
        """End of the last bout."""
        return float(self.bouts[-1].t_s[-1])


@dataclass(frozen=True, slots=True)
class BodyPath:
    """Where a body is, evenly in time.

    Attributes:
        t_s: (T,).
        xy_m: (T, 2).
        polygon: (T,) int.
        z_m: (T,) height of the floor under the body above level 0, smooth over stairs.
        heading_rad: (T,) course, unwrapped; turns while standing, too.
        speed_mps: (T,).
    """

    t_s: FloatArray
    xy_m: FloatArray
    polygon: IntArray
    z_m: FloatArray
    heading_rad: FloatArray
    speed_mps: FloatArray


def draw_place(
    rng: np.random.Generator, mesh: NavigationMesh, *, level: int | None = None, clearance_m: float = 0.5
) -> Place:
    """A place where somebody could have business: uniform over the floor, off stairs, away from walls.

    Args:
        rng: Draws places until one fits.
        mesh: Of the building.
        level: Only there; None for any.
        clearance_m: Least distance from a wall of its floor polygon; waived where a thousand places had less.
    """
    building = mesh.building
    for _ in range(16):
        polygon, xy_m = building.sample_uniform(rng, 64, level)
        floor = np.array([building.polygons[p].kind == "floor" for p in polygon])
        for i in np.flatnonzero(floor):
            near = walls_along(building, xy_m[i : i + 1], polygon[i : i + 1], clearance_m, 0)
            if not len(near.point):
                return Place(int(polygon[i]), xy_m[i])
    return Place(int(polygon[-1]), xy_m[-1])


def walk_through(
    rng: np.random.Generator,
    mesh: NavigationMesh,
    person: Person,
    places: Sequence[Place],
    params: WalkParams | None = None,
    *,
    until_s: float = math.inf,
) -> Walk:
    """Lets a person visit places in order, with a pause at each.

    Args:
        rng: Everything personal to this walk.
        mesh: Of the building.
        person: Who walks.
        places: Two or more; the walk begins at t = 0 at the first, standing.
        params: None for the defaults.
        until_s: A person who arrives later than this goes to no further place.

    Raises:
        RouteError: Nothing connects two of the places, or fewer than two are given.
    """
    if len(places) < 2:
        raise RouteError(f"a walk needs two places or more; got {len(places)}")
    params = params or WalkParams()
    walker = _Walker(mesh, person, params, rng.uniform(*params.corner_radius_m), rng.uniform(*params.clearance_m))
    keep_right_m = float(rng.uniform(*params.keep_right_m))
    bouts: list[Bout] = []
    now_s = 1.0  # stands for a second first, so that the start can be told before the first stride
    for start, goal in itertools.pairwise(places):
        if bouts and bouts[-1].t_s[-1] > until_s:
            break
        for bout in walker.leg(rng, start, goal, keep_right_m):
            if bouts:
                now_s = float(bouts[-1].t_s[-1]) + _draw_pause_s(rng, params, bouts[-1], bout)
            bouts.append(replace(bout, t_s=read_only(bout.t_s + now_s)))
    return Walk(mesh.building, person, tuple(bouts))


def body_path(walk: Walk, rate_hz: float = 50.0) -> BodyPath:
    """The body sampled evenly, from t = 0 to the end of the last bout."""
    t_s = np.arange(math.floor(walk.end_s * rate_hz) + 1) / rate_hz
    first = walk.bouts[0]
    xy_m = np.repeat(first.xy_m[:1], len(t_s), axis=0)
    polygon = np.full(len(t_s), first.polygon[0])
    z_m = np.repeat(walk.building.height(first.polygon[:1]), len(t_s))
    heading_rad = np.repeat(first.heading_rad[:1], len(t_s))
    speed_mps = np.zeros(len(t_s))
    for i, bout in enumerate(walk.bouts):
        during = (t_s >= bout.t_s[0]) & (t_s <= bout.t_s[-1])
        s_m = bout.way_m(t_s[during])
        xy_m[during], polygon[during], heading = bout.place(walk.building, s_m)
        offset_rad = _nearest_turn(heading_rad[np.flatnonzero(during)[0] - 1], bout.heading_rad[0])
        heading_rad[during] = heading + offset_rad
        z_m[during] = np.interp(s_m, bout.climb_s_m, bout.climb_z_m)
        speed_mps[during] = np.interp(t_s[during], bout.t_s, bout.speed_mps)
        after = t_s > bout.t_s[-1]
        xy_m[after], polygon[after] = bout.xy_m[-1], bout.polygon[-1]
        z_m[after] = walk.building.height(bout.polygon[-1:])[0]
        heading_rad[after] = bout.heading_rad[-1] + offset_rad
        if i + 1 < len(walk.bouts):
            _turn_standing(t_s, heading_rad, bout, walk.bouts[i + 1], offset_rad)
    return BodyPath(t_s, xy_m, polygon, z_m, heading_rad, speed_mps)


def standing_turn_rad(before: Bout, after: Bout) -> float:
    """By how much a person turns while standing between two bouts, the short way round."""
    return float(wrap_rad(after.heading_rad[0] - before.heading_rad[-1]))


def turn_steps(turn_rad: float) -> int:
    """In how many steps of each foot a person turns on the spot; small turns are made while walking off."""
    return 0 if abs(turn_rad) < math.radians(20) else math.ceil(abs(turn_rad) / TURN_STEP_RAD)


def _turn_standing(t_s: FloatArray, heading_rad: FloatArray, before: Bout, after: Bout, offset_rad: float) -> None:
    """Fills in the headings of a turn on the spot, made just before the next bout."""
    turn_rad = standing_turn_rad(before, after)
    end_s = after.t_s[0]
    start_s = end_s - TURN_STEP_S * max(turn_steps(turn_rad), 0.5)
    turning = (t_s >= start_s) & (t_s < end_s)
    share = (t_s[turning] - start_s) / (end_s - start_s)
    heading_rad[turning] = before.heading_rad[-1] + offset_rad + turn_rad * share**2 * (3 - 2 * share)


def _nearest_turn(heading_rad: float, wanted_rad: float) -> float:
    """The multiple of a full turn, plus nothing else, that brings `wanted_rad` nearest to `heading_rad`."""
    return 2 * math.pi * round((heading_rad - wanted_rad) / (2 * math.pi))


def _draw_pause_s(rng: np.random.Generator, params: WalkParams, before: Bout, after: Bout) -> float:
    """A pause, and on top of it the time that turning on the spot takes; both feet come to rest in it."""
    pause_s = params.pause_median_s * math.exp(params.pause_log_sigma * rng.standard_normal())
    return max(pause_s, 1.2) + TURN_STEP_S * turn_steps(standing_turn_rad(before, after))


@dataclass(frozen=True, slots=True)
class _Walker:
    """A person in a building: `leg` is all that the outside needs."""

    mesh: NavigationMesh
    person: Person
    params: WalkParams
    corner_radius_m: float
    clearance_m: float

    def leg(self, rng: np.random.Generator, start: Place, goal: Place, keep_right_m: float) -> list[Bout]:
        """Bouts from one place to the next, the first at time 0; they end where the next begins."""
        route = self.mesh.route(start, goal, self.clearance_m)
        xy_m, polygon = self._path(rng, route, keep_right_m)
        return self._timed(rng, xy_m, polygon)

    # Where.

    def _path(self, rng: np.random.Generator, route: Route, keep_right_m: float) -> tuple[FloatArray, IntArray]:
        """Points of a leg and their floor polygons: smooth, swaying, clear of walls."""
        noise = rng.standard_normal(math.ceil(route.length_m / 0.1) + 64)
        for spacing_m in _SPACINGS_M:
            base_xy_m, base_polygon = _resample(route, spacing_m)
            walls = self._walls(base_xy_m, base_polygon, spacing_m)
            wanted_xy_m = _relax(
                base_xy_m, walls, spacing_m, self.corner_radius_m, self.clearance_m, self.params.comfort_m
            )
            wanted_xy_m = self._sway(noise, wanted_xy_m, walls, keep_right_m)
            found = self._draw_back(base_xy_m, base_polygon, wanted_xy_m, walls)
            if found is not None:
                found = self._polish(*found, spacing_m)
            if found is not None:
                return found
        raise RouteError(
            f"the way from {route.xy_m[0]} to {route.xy_m[-1]} is too narrow to walk; check the floor polygons on it"
        )

    def _walls(self, xy_m: FloatArray, polygon: IntArray, spacing_m: float) -> NearWalls:
        reach_m = self.params.comfort_m + 0.7
        return walls_along(self.mesh.building, xy_m, polygon, reach_m, round(2.0 / spacing_m))

    def _draw_back(
        self, base_xy_m: FloatArray, base_polygon: IntArray, wanted_xy_m: FloatArray, walls: NearWalls
    ) -> tuple[FloatArray, IntArray] | None:
        near_m = walls.distance_m(base_xy_m, self.params.comfort_m)
        least_m = np.minimum(self.params.least_clearance_m, 0.9 * near_m)
        return _draw_back(self.mesh.building, base_xy_m, base_polygon, wanted_xy_m, walls, least_m)

    def _polish(self, xy_m: FloatArray, polygon: IntArray, spacing_m: float) -> tuple[FloatArray, IntArray] | None:
        """Evens out the spacing of a path and the kinks that walls and drawing back have left."""
        s_m = _arc_length_m(xy_m)
        even_m = np.linspace(0.0, s_m[-1], max(math.ceil(s_m[-1] / spacing_m), 4) + 1)
        knot = np.clip(np.searchsorted(s_m, even_m, side="right") - 1, 0, len(s_m) - 2)
        even_xy_m = np.column_stack([np.interp(even_m, s_m, xy_m[:, k]) for k in (0, 1)])
        even_polygon, _ = self.mesh.building.move(polygon[knot], xy_m[knot], even_xy_m)
        wanted_xy_m = _smooth_line(even_xy_m, self.params.kink_m / spacing_m)
        return self._draw_back(even_xy_m, even_polygon, wanted_xy_m, self._walls(even_xy_m, even_polygon, spacing_m))

    def _sway(self, noise: FloatArray, xy_m: FloatArray, walls: NearWalls, keep_right_m: float) -> FloatArray:
        """Adds the lateral deviation of somebody who walks without a ruler; less where walls are near."""
        s_m = _arc_length_m(xy_m)
        grid_m = np.arange(len(noise)) * 0.1 - 3.0
        deviation_m = self.params.sway_sigma_m * _smooth_process(noise, self.params.sway_length_m / 0.1, 8)
        lateral_m = np.interp(s_m, grid_m, deviation_m - keep_right_m)
        room_m = _moving_min(walls.distance_m(xy_m, self.params.comfort_m), 5)
        room = np.clip((room_m - self.clearance_m) / (self.params.comfort_m - self.clearance_m), 0.0, 1.0)
        room = _moving_mean(room, 9)
        ends = np.clip(np.minimum(s_m, s_m[-1] - s_m) / 1.5, 0.0, 1.0)
        ends = ends**2 * (3 - 2 * ends)
        heading_rad = _heading_rad(xy_m)
        left = np.column_stack([-np.sin(heading_rad), np.cos(heading_rad)])
        swayed: FloatArray = xy_m + (lateral_m * room * ends)[:, None] * left
        return swayed

    # When.

    def _timed(self, rng: np.random.Generator, xy_m: FloatArray, polygon: IntArray) -> list[Bout]:
        """Cuts a leg at pauses and puts every piece into time."""
        s_m = _arc_length_m(xy_m)
        heading_rad = _heading_rad(xy_m)
        runs = _runs(self.mesh.building, xy_m, polygon, s_m)
        wish_mps = self._wish(rng, s_m, heading_rad, runs)
        middles_m = np.array([run.middle_m for run in runs if run.is_tread])
        climb = [(run.middle_m, run.height_m) for run in runs if run.is_tread]
        climb += [(at_m, run.height_m) for run in runs if not run.is_tread for at_m in (run.start_m, run.end_m)]
        climb_s_m, climb_z_m = np.array(sorted(climb, key=lambda knot: knot[0])).T
        bouts = []
        cuts = [0, *self._draw_stops(rng, polygon, s_m, wish_mps), len(s_m) - 1]
        for first, last in itertools.pairwise(cuts):
            part = slice(first, last + 1)
            way_m = s_m[part] - s_m[first]
            speed_mps = _limit_accel(way_m, wish_mps[part], self.params.accel_mps2)
            passed_s = 2 * np.diff(way_m) / (speed_mps[1:] + speed_mps[:-1])
            on_way = (middles_m > s_m[first]) & (middles_m < s_m[last])
            bouts.append(
                Bout(
                    t_s=read_only(np.concatenate([[0.0], np.cumsum(passed_s)])),
                    s_m=read_only(way_m),
                    speed_mps=read_only(speed_mps),
                    xy_m=read_only(xy_m[part]),
                    polygon=read_only(polygon[part], np.int64),
                    heading_rad=read_only(heading_rad[part]),
                    treads_s_m=read_only(middles_m[on_way] - s_m[first]),
                    climb_s_m=read_only(climb_s_m - s_m[first]),
                    climb_z_m=read_only(climb_z_m),
                )
            )
        return bouts

    def _wish(
        self, rng: np.random.Generator, s_m: FloatArray, heading_rad: FloatArray, runs: Sequence[_Run]
    ) -> FloatArray:
        """(N,) the speed that suits each point, before acceleration has its say."""
        params = self.params
        length_m = params.speed_time_s * self.person.speed_mps
        noise = rng.standard_normal(math.ceil(s_m[-1] / 0.5) + 40)
        relative = params.speed_sigma * _smooth_process(noise, length_m / 0.5, 3)
        mood = np.exp(np.interp(s_m, np.arange(len(noise)) * 0.5 - 3, relative))
        turn_rad = np.abs(np.interp(s_m + 0.75, s_m, heading_rad) - np.interp(s_m - 0.75, s_m, heading_rad))
        mood *= 1 - (1 - params.turn_speed) * np.clip(turn_rad / params.sharp_turn_rad, 0, 1)
        bend_per_m = np.abs(_moving_mean(np.gradient(heading_rad, s_m), 1))
        speed = np.minimum(self.person.speed_mps, np.sqrt(params.bend_accel_mps2 / np.maximum(bend_per_m, 1e-3)))
        for run, after in itertools.pairwise(runs):
            if run.kind == after.kind == "floor" and run.exit_width_m <= DOOR_WIDTH_M:
                slow = 1 - rng.uniform(*params.door_speed)
                speed *= 1 - slow * np.exp(-((s_m - run.end_m) ** 2) / (2 * 0.4**2))
        for before, run in itertools.pairwise(runs):
            if run.is_tread:
                is_up = run.height_m > before.height_m
                cadence = params.stairs_cadence_up if is_up else params.stairs_cadence_down
                on_tread = (s_m >= run.start_m) & (s_m <= run.end_m)
                speed[on_tread] = (run.end_m - run.start_m) * cadence * self.person.cadence_hz
        return speed * mood

    def _draw_stops(
        self, rng: np.random.Generator, polygon: IntArray, s_m: FloatArray, wish_mps: FloatArray
    ) -> list[int]:
        """Points at which the person pauses: not on stairs, not within 2.5 m of the ends or of another stop."""
        hazard = np.gradient(s_m) / wish_mps / self.params.pause_every_s
        on_floor = np.array([self.mesh.building.polygons[p].kind == "floor" for p in polygon])
        stops: list[int] = []
        for i in np.flatnonzero(rng.random(len(s_m)) < hazard):
            from_m = s_m[stops[-1]] if stops else 0.0
            if on_floor[i] and s_m[i] - from_m > 2.5 and s_m[-1] - s_m[i] > 2.5:
                stops.append(int(i))
        return stops


# Paths as arrays.


def _arc_length_m(xy_m: FloatArray) -> FloatArray:
    return np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(xy_m, axis=0).T))])


def _heading_rad(xy_m: FloatArray) -> FloatArray:
    """(N,) course at the points of a path, unwrapped."""
    x, y = np.gradient(xy_m, axis=0).T
    return np.unwrap(np.arctan2(y, x))


def _moving_mean(values: FloatArray, half: int) -> FloatArray:
    padded = np.pad(values, half, mode="edge")
    return np.convolve(padded, np.full(2 * half + 1, 1 / (2 * half + 1)), mode="valid")


def _moving_min(values: FloatArray, half: int) -> FloatArray:
    padded = np.pad(values, half, mode="edge")
    lowest: FloatArray = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1).min(axis=1)
    return lowest


def _smooth_process(noise: FloatArray, length: float, smooth: float) -> FloatArray:
    """A stationary Ornstein-Uhlenbeck process of unit variance, smoothed so that it can be walked.

    Args:
        noise: (N,) standard normal.
        length: Correlation length in samples.
        smooth: Standard deviation of the Gaussian that smooths it, in samples.
    """
    from scipy.ndimage import gaussian_filter1d
    from scipy.signal import lfilter

    keep = math.exp(-1 / length)
    driven: FloatArray = noise * math.sqrt(1 - keep**2)
    driven[0] = noise[0]
    process = np.asarray(lfilter([1.0], [1.0, -keep], driven), dtype=np.float64)
    smoothed: FloatArray = np.array(gaussian_filter1d(process, smooth, mode="nearest"), dtype=np.float64)
    return smoothed


def _smooth_line(xy_m: FloatArray, sigma: float) -> FloatArray:
    """A path smoothed by a Gaussian of `sigma` points; the ends stay where they are."""
    from scipy.ndimage import gaussian_filter1d

    margin = min(math.ceil(4 * sigma), len(xy_m) - 1)
    before = 2 * xy_m[0] - xy_m[margin:0:-1]
    after = 2 * xy_m[-1] - xy_m[-2 : -margin - 2 : -1]
    smooth = gaussian_filter1d(np.vstack([before, xy_m, after]), sigma, axis=0)
    return np.array(smooth[margin : margin + len(xy_m)], dtype=np.float64)


def _resample(route: Route, spacing_m: float) -> tuple[FloatArray, IntArray]:
    """Evenly spaced points of a route and the floor polygon of each."""
    at_m = _arc_length_m(route.xy_m)
    count = max(math.ceil(at_m[-1] / spacing_m), 4)
    s_m = np.linspace(0.0, at_m[-1], count + 1)
    xy_m = np.column_stack([np.interp(s_m, at_m, route.xy_m[:, k]) for k in (0, 1)])
    leg = np.clip(np.searchsorted(at_m, s_m, side="right") - 1, 0, len(route.polygon) - 1)
    return xy_m, route.polygon[leg]


def _relax(
    base_xy_m: FloatArray, walls: NearWalls, spacing_m: float, radius_m: float, clearance_m: float, comfort_m: float
) -> FloatArray:
    """An elastic band along the route: every round smooths it a little and lets the walls push it sideways.

    A right angle smoothed by a Gaussian of width sigma has the smallest radius sigma sqrt(2 pi) / (pi / 2) = 1.6 sigma;
    n rounds of the kernel (1/4, 1/2, 1/4) make sigma = spacing sqrt(n / 2).
    """
    rounds = max(round(2 * (radius_m / 1.6 / spacing_m) ** 2), 8)
    xy_m = base_xy_m.copy()
    soft, hard = 4.0 / rounds, min(60.0 / rounds, 0.5)
    for _ in range(rounds):
        xy_m[1:-1] = (xy_m[:-2] + 2 * xy_m[1:-1] + xy_m[2:]) / 4
        xy_m[1:-1] += _push(xy_m, walls, clearance_m, comfort_m, soft, hard)[1:-1]
    return xy_m


def _push(
    xy_m: FloatArray, walls: NearWalls, clearance_m: float, comfort_m: float, soft: float, hard: float
) -> FloatArray:
    """(N, 2) sideways shift of every point: the strongest push from the right less the strongest from the left."""
    tangent = np.gradient(xy_m, axis=0)
    tangent /= np.maximum(np.hypot(*tangent.T), 1e-9)[:, None]
    left = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    offset = walls.offsets_m(xy_m)
    distance = np.maximum(np.hypot(*offset.T), 1e-9)
    sideways = (offset * left[walls.point]).sum(axis=1) / distance
    strength = hard * np.maximum(clearance_m - distance, 0) + soft * np.maximum(comfort_m - distance, 0)
    push = np.zeros((2, len(xy_m)))
    np.maximum.at(push, ((sideways > 0).astype(np.int64), walls.point), strength * np.abs(sideways))
    shift: FloatArray = (push[0] - push[1])[:, None] * left
    return shift


def _draw_back(
    building: Building,
    base_xy_m: FloatArray,
    base_polygon: IntArray,
    wanted_xy_m: FloatArray,
    walls: NearWalls,
    least_m: FloatArray,
) -> tuple[FloatArray, IntArray] | None:
    """The wanted path, drawn back to the route where it hits a wall or comes nearer to one than `least_m` (N,).

    Returns:
        Points and floor polygons, or None where even the route itself fails.
    """
    share = np.ones(len(base_xy_m))
    for attempt in range(24):
        xy_m = base_xy_m + share[:, None] * (wanted_xy_m - base_xy_m)
        polygon, is_bad = _violations(building, base_xy_m, base_polygon, xy_m, walls, least_m)
        if not is_bad.any():
            return xy_m, polygon
        # A smooth dip, so that the path bends back gently; after some rounds it covers all that fails.
        dip = _moving_mean(_moving_mean(_dilate(is_bad, 8 + attempt).astype(np.float64), 4), 4)
        share *= 1 - (0.3 if attempt < 16 else 1.0) * dip
    polygon, is_bad = _violations(building, base_xy_m, base_polygon, base_xy_m, walls, least_m)
    return None if is_bad.any() else (base_xy_m, polygon)


def _violations(
    building: Building,
    base_xy_m: FloatArray,
    base_polygon: IntArray,
    xy_m: FloatArray,
    walls: NearWalls,
    least_m: FloatArray,
) -> tuple[IntArray, BoolArray]:
    """Floor polygon of every point, and where a path is no way to walk.

    A point is good where the way to it from its place on the route is free, so that both lie on the same side of every
    wall; a step is good where it is free and ends in the polygon found for the next point.
    """
    polygon, alive = building.move(base_polygon, base_xy_m, xy_m)
    is_bad = ~alive | (walls.distance_m(xy_m, 1.0) < least_m)
    reached, alive = building.move(polygon[:-1], xy_m[:-1], xy_m[1:])
    bad_step = ~alive | (reached != polygon[1:])
    is_bad[:-1] |= bad_step
    is_bad[1:] |= bad_step
    return polygon, is_bad


def _dilate(flags: BoolArray, half: int) -> BoolArray:
    spread: BoolArray = np.convolve(flags, np.ones(2 * half + 1), mode="same") > 0.5
    return spread[: len(flags)] if len(spread) > len(flags) else spread


def _limit_accel(s_m: FloatArray, wish_mps: FloatArray, accel_mps2: float) -> FloatArray:
    """The fastest speed below the wish that starts and ends at rest and never changes faster than allowed."""
    square = (wish_mps**2).tolist()
    gain = (2 * accel_mps2 * np.diff(s_m)).tolist()
    square[0] = square[-1] = 0.0
    for i, more in enumerate(gain):
        square[i + 1] = min(square[i + 1], square[i] + more)
    for i in range(len(gain) - 1, -1, -1):
        square[i] = min(square[i], square[i + 1] + gain[i])
    speed: FloatArray = np.sqrt(np.array(square))
    return speed


@dataclass(frozen=True, slots=True)
class _Run:
    """The part of a path that lies in one floor polygon; `exit_width_m` is that of the connection at its end."""

    start_m: float
    end_m: float
    kind: str
    height_m: float
    exit_width_m: float

    @property
    def middle_m(self) -> float:
        return (self.start_m + self.end_m) / 2

    @property
    def is_tread(self) -> bool:
        return self.kind == "stairs" and self.end_m - self.start_m < LONGEST_TREAD_M


def _runs(building: Building, xy_m: FloatArray, polygon: IntArray, s_m: FloatArray) -> list[_Run]:
    """Cuts a path where it passes from one floor polygon to the next."""
    changes = np.flatnonzero(np.diff(polygon))
    crossings = [_crossing(building, polygon[i], polygon[i + 1], xy_m[i], xy_m[i + 1]) for i in changes]
    at_m = [float(s_m[i] + share * (s_m[i + 1] - s_m[i])) for i, (share, _) in zip(changes, crossings, strict=True)]
    owners = [building.polygons[i] for i in polygon[np.concatenate([changes, [len(polygon) - 1]])]]
    widths_m = [*(width_m for _, width_m in crossings), math.inf]
    return [
        _Run(start_m, end_m, owner.kind, owner.height_m, width_m)
        for start_m, end_m, owner, width_m in zip([0.0, *at_m], [*at_m, float(s_m[-1])], owners, widths_m, strict=True)
    ]


def _crossing(building: Building, one: int, other: int, a: FloatArray, b: FloatArray) -> tuple[float, float]:
    """Share of the step a to b at which it passes from one floor polygon to another, and the width of the passage.

    One half and infinity where the step passes a third polygon between them.
    """
    edges = np.arange(building.first_edge[one], building.first_edge[one + 1])
    edges = edges[building.edge_leads_to[edges] == other]
    start, end = building.edge_start_xy_m[edges], building.edge_end_xy_m[edges]
    along, step = end - start, b - a
    across = step[0] * along[:, 1] - step[1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        share = ((start - a)[:, 0] * along[:, 1] - (start - a)[:, 1] * along[:, 0]) / across
        where = ((start - a)[:, 0] * step[1] - (start - a)[:, 1] * step[0]) / across
    hit = np.flatnonzero((across > 0) & (where >= -1e-9) & (where <= 1 + 1e-9) & (share >= -1e-9) & (share <= 1 + 1e-9))
    if not len(hit):
        return 0.5, math.inf
    return float(np.clip(share[hit[0]], 0, 1)), float(np.hypot(*along[hit[0]]))


__all__ = [
    "BodyPath",
    "Bout",
    "Walk",
    "WalkParams",
    "body_path",
    "draw_place",
    "standing_turn_rad",
    "turn_steps",
    "walk_through",
]
