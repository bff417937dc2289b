"""A person who walks a route: where the body is at every moment (sources.md 1.10).

A leg leads from one place to the next. Its route is resampled and relaxed like an elastic band that walls push away, so
that corners get round and corridors are walked near their middle; sway is added; and wherever the result would touch a
wall or come too near to one it is drawn back towards the route, which never does. Then speed: slower in turns, through
doors and on stairs, with limited acceleration and pauses.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.building.connectivity import lift_shafts
from pdrbench.geometry import BoolArray, FloatArray, IntArray, read_only
from pdrbench_sim.buildings.passages import DOOR_WIDTH_M, Passage, passages
from pdrbench_sim.buildings.walls import NearWalls, walls_along
from pdrbench_sim.people.body_line import (
    arc_length_m,
    draw_back,
    heading_along_rad,
    limit_accel,
    moving_mean,
    moving_min,
    relax,
    resample,
    smooth_line,
    smooth_process,
)
from pdrbench_sim.people.person import Person
from pdrbench_sim.people.route import NavigationMesh, Place, Route, RouteError
from pdrbench_sim.people.walk import (
    LIFT_DOORS_S,
    LIFT_MPS,
    TURN_STEP_S,
    Bout,
    SimulatedWalk,
    WalkError,
    lift_ride_m,
    standing_turn_rad,
    turn_steps,
)

_SPACINGS_M: Final = (0.1, 0.05, 0.025)  # of the points of a leg; a finer one where the way is too tight
FREE_M: Final = 0.5  # of places from walls; ours
MIN_LEG_M: Final = 0.05  # between two places; ours
_MAX_PASSED_TURN_RAD: Final = math.radians(120.0)  # ours
_MIN_U_TURN_M: Final = 6.0  # a shorter way is not turned round on; ours


@dataclass(frozen=True, slots=True)
class WalkParams:
    """How people walk through buildings; pairs are ranges of a uniform draw."""

    # Kept from corners, jambs and walls where there is room.
    clearance_m: tuple[float, float] = (0.3, 0.5)  # sources.md 1.10
    # Walls nearer than this push softly; keeps people near the middle of a corridor.
    comfort_m: float = 0.9  # ours: half a corridor of 1.8 m
    # Of the body's middle; in a gap narrower than twice this, 0.9 of what the route has.
    min_clearance_m: float = 0.22  # half of BODY_WIDTH_M, less a tilt of the shoulders
    corner_radius_m: tuple[float, float] = (0.6, 1.2)  # of turns; sources.md 1.10
    sway_sigma_m: float = 0.25  # of the lateral deviation, where there is room; sources.md 1.10
    sway_length_m: float = 6.0  # its correlation length along the way; ours: bends the heading by about 3 degrees
    keep_right_m: tuple[float, float] = (0.1, 0.2)  # mean deviation to the right, where there is room; sources.md 1.10
    turn_speed: float = 0.7  # fraction of the speed left in a turn by `sharp_turn_rad` or more; sources.md 1.10
    sharp_turn_rad: float = math.radians(60)  # turn within 1.5 m that slows a walker down fully; sources.md 1.10
    door_speed: tuple[float, float] = (0.5, 0.8)  # fraction of the speed left in a door; sources.md 1.10
    # Cadence on stairs, relative to the flat; one tread a step.
    stairs_cadence_up: float = 0.85  # sources.md 1.3: 10 to 20 % below
    stairs_cadence_down: float = 0.9  # the same, downstairs; sources.md 1.3: 10 to 20 % below
    speed_sigma: float = 0.08  # of the relative speed; sources.md 1.10
    speed_time_s: float = 10.0  # its correlation time; sources.md 1.10
    # Mean time between pauses on the way, where they are possible.
    pause_every_s: float = 150.0  # ours: with the stops at places, one in about 45 s (sources.md 1.10)
    pause_median_s: float = 4.0  # of pauses, log-normal; sources.md 1.10
    pause_log_sigma: float = 0.6  # standard deviation of the logarithm; ours: one pause in twenty is longer than 11 s
    accel_mps2: float = 0.9  # speeding up and slowing down; ours: free speed after about 1.5 s, two or three steps
    # Towards the inside of a bend, at most.
    bend_accel_mps2: float = 1.2  # ours: comes into play below a radius of 0.6 to 0.9 m
    kink_m: float = 0.2  # bends shorter than this are smoothed away; ours: a third of a step
    bout_speed_sigma: float = 0.0  # standard deviation of the logarithm of the pace of a bout of walking
    # Of the ways between places, those on which the person turns round, goes back and turns again.
    u_turn_fraction: float = 0.0
    # Of the places on the way, those at which the person stops; the others are passed in a bend, unless that would be
    # too sharp.
    stop_fraction: float = 1.0
    run_fraction: float = 0.0  # of the bouts on the flat of at least `run_min_m`, those that are run
    run_min_m: float = 10.0  # see there; ours: a few steps to get going and to stop
    run_cadence_hz: tuple[float, float] = (2.5, 2.75)  # steps per second of a running person; sources.md 1.2
    run_step_m: tuple[float, float] = (0.85, 1.05)  # their length; measured: 0.84 and 1.03 m in two recorded runs
    # Growth of a running step with the cadence.
    run_step_slope_m_per_hz: float = 1.2  # ours: a person at half the speed takes 2.2 steps a second
    run_accel_mps2: float = 1.5  # as `accel_mps2`; ours

    def __post_init__(self) -> None:
        for name in ("u_turn_fraction", "stop_fraction", "run_fraction", "turn_speed"):
            if not 0 <= getattr(self, name) <= 1:
                raise WalkError(f"{name} is a fraction, 0 to 1; got {getattr(self, name):g}")
        for name in ("accel_mps2", "bend_accel_mps2", "run_accel_mps2", "pause_every_s", "speed_time_s"):
            if not getattr(self, name) > 0:
                raise WalkError(f"{name} has to be positive; got {getattr(self, name):g}")


# As people walk. Where stride times are to vary as measured, speed cannot vary by 8 % within 10 s, as the defaults have
# it: the pace then changes from one bout to the next. The defaults stay as they are for the walks drawn with them.
NATURAL_WALK: Final = WalkParams(
    speed_sigma=0.01,  # ours: leaves stride times the variation measured and their long-range correlation
    bout_speed_sigma=0.079,  # with the above 8 % together (sources.md 1.10)
    u_turn_fraction=0.05,  # ours
)


def draw_place(rng: np.random.Generator, mesh: NavigationMesh, *, level: int | None = None) -> Place:
    """A place where a person could have business: uniform over the floor, off stairs, away from walls.

    Where a thousand places are nearer than `FREE_M` to a wall of their floor polygon, that is waived.

    Args:
        rng: Draws places until one fits.
        mesh: Of the building.
        level: Only there; None for any.
    """
    building = mesh.building
    for _ in range(16):
        polygon, xy_m = building.sample_uniform(rng, 64, level)
        floor = np.array([building.polygons[p].kind == "floor" for p in polygon])
        for i in np.flatnonzero(floor):
            near = walls_along(building, xy_m[i : i + 1], polygon[i : i + 1], FREE_M, 0)
            if not len(near.point):
                return Place(int(polygon[i]), xy_m[i])
    return Place(int(polygon[-1]), xy_m[-1])


def lift_ride(building: Building, here_xy_m: FloatArray, levels: tuple[int, int]) -> list[Place]:
    """The cabin of the nearest lift that stops at both levels, on the one and on the other; empty where none does."""
    by_level = [{building.polygons[i].level: i for i in shaft} for shaft in lift_shafts(building)]
    stops = [tuple(shaft[level] for level in levels) for shaft in by_level if shaft.keys() >= set(levels)]
    middles_m = [building.polygons[first].outline_xy_m.mean(axis=0) for first, _ in stops]
    if not stops:
        return []
    nearest = min(range(len(stops)), key=lambda k: float(np.hypot(*(middles_m[k] - here_xy_m))))
    return [Place(stop, middles_m[nearest]) for stop in stops[nearest]]


def walk_through(
    rng: np.random.Generator,
    mesh: NavigationMesh,
    person: Person,
    places: Sequence[Place],
    params: WalkParams | None = None,
    *,
    until_s: float = math.inf,
) -> SimulatedWalk:
    """Lets a person visit places in order, with a pause at each that is not passed (`WalkParams.stop_fraction`).

    Args:
        rng: Everything personal to this walk.
        mesh: Of the building.
        person: Who walks.
        places: Two or more; the walk begins at t = 0 at the first, standing. Between two that lie one above the
            other in polygons of kind "lift", on different levels, the person is carried.
        params: None for the defaults.
        until_s: A person who arrives later than this goes to no further place.

    Raises:
        RouteError: Nothing connects two of the places, a place is in a wall, or fewer than two are given.
        WalkError: No time to walk.
    """
    if len(places) < 2:
        raise RouteError(f"a walk needs two places or more; got {len(places)}")
    if not until_s > 0:
        raise WalkError(f"a walk takes some seconds; got until_s={until_s:g}")
    params = params or WalkParams()
    # Each has a generator of its own: a person who runs, or turns round, walks the same ways as one who does not.
    running, pacing, turning, passing = rng.spawn(4)
    walker = _Walker(
        mesh,
        person,
        params,
        rng.uniform(*params.corner_radius_m),
        rng.uniform(*params.clearance_m),
        replace(  # slower runs have shorter steps at nearly the same cadence, hence a steep slope
            person,
            cadence_hz=running.uniform(*params.run_cadence_hz),
            step_length_m=running.uniform(*params.run_step_m),
            step_slope_m_per_hz=params.run_step_slope_m_per_hz,
        ),
        running,
        pacing,
    )
    keep_right_m = float(rng.uniform(*params.keep_right_m))
    bouts: list[Bout] = []
    now_s = 1.0  # stands for a second first, so that the start is known before the first stride
    for way in walker.ways(passing, places):
        if bouts and bouts[-1].t_s[-1] > until_s:
            break
        for part in walker.parts(turning, way):
            for bout in walker.leg(rng, part, keep_right_m):
                if bouts:
                    now_s = float(bouts[-1].t_s[-1]) + _draw_pause_s(rng, params, bouts[-1], bout)
                    ride_m = lift_ride_m(mesh.building, bouts[-1], bout)
                    now_s += abs(ride_m) / LIFT_MPS + sum(LIFT_DOORS_S) if ride_m else 0.0
                bouts.append(replace(bout, t_s=read_only(bout.t_s + now_s)))
    return SimulatedWalk(mesh.building, person, tuple(bouts))


def _draw_pause_s(rng: np.random.Generator, params: WalkParams, before: Bout, after: Bout) -> float:
    """A pause, and on top of it the time that turning on the spot takes; both feet come to rest in it."""
    pause_s = params.pause_median_s * math.exp(params.pause_log_sigma * rng.standard_normal())
    return max(pause_s, 1.2) + TURN_STEP_S * turn_steps(standing_turn_rad(before, after))


@dataclass(frozen=True, slots=True)
class _Walker:
    """A person in a building: `ways`, `parts` and `leg` are all that the outside needs."""

    mesh: NavigationMesh
    person: Person
    params: WalkParams
    corner_radius_m: float
    clearance_m: float
    runner: Person
    running: np.random.Generator
    pacing: np.random.Generator

    def ways(self, rng: np.random.Generator, places: Sequence[Place]) -> Iterator[list[Place]]:
        """Places from one stop to the next: the first and the last are stops, those between are passed."""
        stops = rng.random(len(places)) < self.params.stop_fraction
        way = [places[0]]
        for i, place in enumerate(places[1:], start=1):
            if self._rides(places[i - 1], place):
                way = [place]
                continue
            way.append(place)
            if (
                i == len(places) - 1
                or stops[i]
                or self._rides(place, places[i + 1])
                or self._turns_back(way[-2], place, places[i + 1])
            ):
                yield way
                way = [place]

    def _rides(self, before: Place, after: Place) -> bool:
        """Whether a lift carries the person from one place to the next: both lie in it, on different levels."""
        one, other = (self.mesh.building.polygons[place.polygon] for place in (before, after))
        return one.kind == other.kind == "lift" and one.level != other.level

    def _turns_back(self, before: Place, here: Place, after: Place) -> bool:
        """Whether the way bends so much at a place that people stop there."""
        into, out = (self.mesh.route(*ends, self.clearance_m).xy_m for ends in ((before, here), (here, after)))
        one, other = into[-1] - into[-2], out[1] - out[0]
        turn_rad = math.atan2(one[0] * other[1] - one[1] * other[0], float(one @ other))
        return abs(turn_rad) > _MAX_PASSED_TURN_RAD

    def parts(self, rng: np.random.Generator, way: list[Place]) -> list[list[Place]]:
        """A way in one part, or in three where the person turns round on it and turns again."""
        turns = rng.random() < self.params.u_turn_fraction
        there, back = rng.uniform(0.4, 0.8), rng.uniform(0.1, 0.5)
        if not turns:
            return [way]
        xy_m, polygon = resample(self._route(way), _SPACINGS_M[0])
        on_floor = np.flatnonzero(self._on_floor(polygon))
        if len(way) > 2 or len(on_floor) * _SPACINGS_M[0] < _MIN_U_TURN_M:
            return [way]
        rows = (int(on_floor[int(fraction * len(on_floor))]) for fraction in (there, there * back))
        stations = [way[0], *(Place(int(polygon[row]), xy_m[row]) for row in rows), way[-1]]
        return [list(part) for part in itertools.pairwise(stations)]

    def _route(self, way: Sequence[Place]) -> Route:
        """The shortest way past all places, in order."""
        routes = [self.mesh.route(*ends, self.clearance_m) for ends in itertools.pairwise(way)]
        if len(routes) == 1:
            return routes[0]
        xy_m = [routes[0].xy_m, *(route.xy_m[1:] for route in routes[1:])]
        return Route(np.concatenate(xy_m), np.concatenate([route.polygon for route in routes]))

    def _on_floor(self, polygon: IntArray) -> BoolArray:
        """(N,) True where a path is not on stairs."""
        is_floor = np.array([p.kind == "floor" for p in self.mesh.building.polygons])
        return is_floor[polygon]

    def leg(self, rng: np.random.Generator, way: Sequence[Place], keep_right_m: float) -> list[Bout]:
        """Bouts from the first place past the others to the last, from time 0; they end where the next begin."""
        route = self._route(way)
        if route.length_m < MIN_LEG_M:
            raise RouteError(f"the way from {way[0].xy_m} to {way[-1].xy_m} has no length; leave one of the places out")
        xy_m, polygon = self._path(rng, route, keep_right_m)
        return self._timed(rng, xy_m, polygon)

    # Where.

    def _path(self, rng: np.random.Generator, route: Route, keep_right_m: float) -> tuple[FloatArray, IntArray]:
        """Points of a leg and their floor polygons: smooth, swaying, clear of walls."""
        noise = rng.standard_normal(math.ceil(route.length_m / 0.1) + 64)
        for spacing_m in _SPACINGS_M:
            base_xy_m, base_polygon = resample(route, spacing_m)
            walls = self._walls(base_xy_m, base_polygon, spacing_m)
            wanted_xy_m = relax(
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
        min_m = np.minimum(self.params.min_clearance_m, 0.9 * near_m)
        return draw_back(self.mesh.building, base_xy_m, base_polygon, wanted_xy_m, walls, min_m)

    def _polish(self, xy_m: FloatArray, polygon: IntArray, spacing_m: float) -> tuple[FloatArray, IntArray] | None:
        """Evens out the spacing of a path and the kinks that walls and drawing back have left."""
        s_m = arc_length_m(xy_m)
        even_m = np.linspace(0.0, s_m[-1], max(math.ceil(s_m[-1] / spacing_m), 4) + 1)
        knot = np.clip(np.searchsorted(s_m, even_m, side="right") - 1, 0, len(s_m) - 2)
        even_xy_m = np.column_stack([np.interp(even_m, s_m, xy_m[:, k]) for k in (0, 1)])
        even_polygon, _ = self.mesh.building.move(polygon[knot], xy_m[knot], even_xy_m)
        wanted_xy_m = smooth_line(even_xy_m, self.params.kink_m / spacing_m)
        return self._draw_back(even_xy_m, even_polygon, wanted_xy_m, self._walls(even_xy_m, even_polygon, spacing_m))

    def _sway(self, noise: FloatArray, xy_m: FloatArray, walls: NearWalls, keep_right_m: float) -> FloatArray:
        """Adds the lateral deviation of a person who walks without a ruler; less where walls are near."""
        s_m = arc_length_m(xy_m)
        grid_m = np.arange(len(noise)) * 0.1 - 3.0
        deviation_m = self.params.sway_sigma_m * smooth_process(noise, self.params.sway_length_m / 0.1, 8)
        lateral_m = np.interp(s_m, grid_m, deviation_m - keep_right_m)
        room_m = moving_min(walls.distance_m(xy_m, self.params.comfort_m), 5)
        room = np.clip((room_m - self.clearance_m) / (self.params.comfort_m - self.clearance_m), 0.0, 1.0)
        room = moving_mean(room, 9)
        ends = np.clip(np.minimum(s_m, s_m[-1] - s_m) / 1.5, 0.0, 1.0)
        ends = ends**2 * (3 - 2 * ends)
        heading_rad = heading_along_rad(xy_m)
        left = np.column_stack([-np.sin(heading_rad), np.cos(heading_rad)])
        swayed: FloatArray = xy_m + (lateral_m * room * ends)[:, None] * left
        return swayed

    # When.

    def _timed(self, rng: np.random.Generator, xy_m: FloatArray, polygon: IntArray) -> list[Bout]:
        """Cuts a leg at pauses and puts every piece into time."""
        s_m = arc_length_m(xy_m)
        heading_rad = heading_along_rad(xy_m)
        passed = passages(self.mesh.building, xy_m, polygon, s_m)
        wish_mps = self._wish(rng, self.person, s_m, heading_rad, passed)
        middles_m = np.array([part.middle_m for part in passed if part.is_tread])
        climb = [(part.middle_m, part.height_m) for part in passed if part.is_tread]
        climb += [(at_m, part.height_m) for part in passed if not part.is_tread for at_m in (part.start_m, part.end_m)]
        climb_s_m, climb_z_m = np.array(sorted(climb, key=lambda knot: knot[0])).T
        bouts = []
        cuts = [0, *self._draw_stops(rng, polygon, s_m, wish_mps), len(s_m) - 1]
        for first, last in itertools.pairwise(cuts):
            part = slice(first, last + 1)
            way_m = s_m[part] - s_m[first]
            runs = self._runs(polygon[part], way_m)
            pace_mps = self._wish(self.running, self.runner, s_m, heading_rad, passed) if runs else wish_mps
            accel_mps2 = self.params.run_accel_mps2 if runs else self.params.accel_mps2
            pace = math.exp(self.params.bout_speed_sigma * float(self.pacing.standard_normal()))
            speed_mps = limit_accel(way_m, pace_mps[part] * pace, accel_mps2)
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
                    runner=self.runner if runs else None,
                )
            )
        return bouts

    def _runs(self, polygon: IntArray, way_m: FloatArray) -> bool:
        """Draws whether a bout is run; people do not run on stairs or for a few steps."""
        drawn = bool(self.running.random() < self.params.run_fraction)
        is_flat = bool(self._on_floor(polygon).all()) and not np.ptp(self.mesh.building.height(polygon))
        return drawn and is_flat and bool(way_m[-1] >= self.params.run_min_m)

    def _wish(
        self,
        rng: np.random.Generator,
        person: Person,
        s_m: FloatArray,
        heading_rad: FloatArray,
        passed: Sequence[Passage],
    ) -> FloatArray:
        """(N,) the speed that suits each point, before acceleration has its say."""
        params = self.params
        length_m = params.speed_time_s * person.speed_mps
        noise = rng.standard_normal(math.ceil(s_m[-1] / 0.5) + 40)
        relative = params.speed_sigma * smooth_process(noise, length_m / 0.5, 3)
        mood = np.exp(np.interp(s_m, np.arange(len(noise)) * 0.5 - 3, relative))
        turn_rad = np.abs(np.interp(s_m + 0.75, s_m, heading_rad) - np.interp(s_m - 0.75, s_m, heading_rad))
        mood *= 1 - (1 - params.turn_speed) * np.clip(turn_rad / params.sharp_turn_rad, 0, 1)
        bend_per_m = np.abs(moving_mean(np.gradient(heading_rad, s_m), 1))
        speed = np.minimum(person.speed_mps, np.sqrt(params.bend_accel_mps2 / np.maximum(bend_per_m, 1e-3)))
        for part, after in itertools.pairwise(passed):
            if part.kind == after.kind == "floor" and part.exit_width_m <= DOOR_WIDTH_M:
                slow = 1 - rng.uniform(*params.door_speed)
                speed *= 1 - slow * np.exp(-((s_m - part.end_m) ** 2) / (2 * 0.4**2))
        for before, part in itertools.pairwise(passed):
            if part.is_tread:
                is_up = part.height_m > before.height_m
                cadence = params.stairs_cadence_up if is_up else params.stairs_cadence_down
                on_tread = (s_m >= part.start_m) & (s_m <= part.end_m)
                speed[on_tread] = (part.end_m - part.start_m) * cadence * person.cadence_hz
        return speed * mood

    def _draw_stops(
        self, rng: np.random.Generator, polygon: IntArray, s_m: FloatArray, wish_mps: FloatArray
    ) -> list[int]:
        """Points at which the person pauses: not on stairs, not within 2.5 m of the ends or of another stop."""
        hazard = np.gradient(s_m) / wish_mps / self.params.pause_every_s
        on_floor = self._on_floor(polygon)
        stops: list[int] = []
        for i in np.flatnonzero(rng.random(len(s_m)) < hazard):
            from_m = s_m[stops[-1]] if stops else 0.0
            if on_floor[i] and s_m[i] - from_m > 2.5 and s_m[-1] - s_m[i] > 2.5:
                stops.append(int(i))
        return stops
