"""Where and when the feet of a walking person rest, and the stride events of one of them (W3)."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import PdrbenchError
from pdrbench.geometry import BoolArray, FloatArray, IntArray, read_only, wrap_rad
from pdrbench_sim.people.walk import (
    TURN_STEP_S,
    Bout,
    SimulatedWalk,
    lift_ride_m,
    lift_times_s,
    standing_turn_rad,
    turn_steps,
)

LEFT: Final = 0
RIGHT: Final = 1
RUN_MPS: Final = 2.2  # speed of the recorded runs
SHORT_STRIDE_M: Final = 0.1  # W3: below it the direction of travel is not defined, the turn of the foot counts


class GaitError(PdrbenchError):
    """The feet find no way that does not pass through a wall."""


@dataclass(frozen=True, slots=True)
class GaitParams:
    """How feet follow the body."""

    # Of a foot's middle from the line of the body.
    foot_offset_m: float = 0.065  # half of a step width of 0.13 m; ours, within the usual 0.05 to 0.08
    # Relative variation of steps, long-range correlated.
    step_sigma: float = 0.03  # sources.md 1.2: CV of stride time 2.6 to 4 %
    step_beta: float = 0.66  # its spectrum falls with frequency to this power; sources.md 1.2: DFA alpha 0.83
    # Of where a foot is set down along the way, independent from step to step; takes no time.
    placing_sigma_m: float = 0.0
    unsteady_log_sigma: float = 0.0  # standard deviation of the logarithm of a factor of both, from walk to walk
    # Part of a stride for which the foot rests, walking at 1 m/s.
    rest_fraction: float = 0.35  # sources.md 1.2: foot slower than 0.15 m/s
    rest_slope_per_mps: float = 0.0  # change of that fraction with the speed of the stride
    rest_range: tuple[float, float] = (0.2, 0.5)  # least and most of it
    run_rest_fraction: float = 0.16  # the same, running at `RUN_MPS`; sources.md 1.2: 13 to 18 %
    run_rest_slope_per_mps: float = -0.07  # likewise; measured: 0.19 at 1.9 m/s, 0.13 at 2.4 m/s
    run_rest_range: tuple[float, float] = (0.1, 0.2)  # likewise
    # Who takes longer from one rest to the next stands first; the stride itself then takes `waited_s`.
    waits_from_s: float = math.inf
    waited_s: float = 1.25  # see there; ours: a slow stride
    closing_s: float = 0.45  # time after the body stops at which the second foot is beside the first; ours: a slow step

    def __post_init__(self) -> None:
        fractions = (self.rest_fraction, self.run_rest_fraction, *self.rest_range, *self.run_rest_range)
        if not all(0 < fraction < 1 for fraction in fractions):
            raise GaitError(f"a foot rests for a fraction of a stride between 0 and 1; got {fractions}")
        if not (0 <= self.step_sigma < 0.3 and 0 <= self.placing_sigma_m < 0.1 and 0 <= self.foot_offset_m < 0.5):
            raise GaitError(f"step_sigma is 0 to 0.3, placing_sigma_m 0 to 0.1, foot_offset_m 0 to 0.5; got {self}")
        if not 0 < self.waited_s <= self.waits_from_s:
            raise GaitError(f"waited_s is more than 0 and at most waits_from_s; got {self}")


# As feet rest. The defaults stay as they are for the walks drawn with them: there a foot rests for the same fraction of
# every stride, and is on its way for two thirds of a pause.
NATURAL_GAIT: Final = GaitParams(
    step_sigma=0.0155,  # measured: steady strides of three recorded walks vary by 1.5 to 2.8 % in time, median 1.6,
    unsteady_log_sigma=0.35,  # what navigation adds included; as these and young adults differ (1.5 to 3 %)
    placing_sigma_m=0.014,  # measured: and by 2.1 % in length, median, what navigation adds included
    rest_slope_per_mps=-0.16,  # measured: 0.43 at 1.0 m/s, 0.33 at 1.6 m/s, smoothed; level as rest_fraction
    waits_from_s=2.0,  # ours: no stride of a walk takes so long
)


@dataclass(frozen=True, slots=True)
class Stances:
    """Rests of one foot in order, the first at the beginning of the walk."""

    mid_s: FloatArray  # (S,) middle of the rest, when the body passes over the foot; 0 for the first
    begin_s: FloatArray  # (S,) since when the foot has rested
    end_s: FloatArray  # (S,) until when it rests; infinite for the last
    xy_m: FloatArray  # (S, 2)
    polygon: IntArray  # (S,) int
    yaw_rad: FloatArray  # (S,) where the foot points, unwrapped
    # (S,) True where the stride to the rest is run; none where left out.
    is_run: BoolArray = field(default_factory=lambda: np.zeros(0, dtype=np.bool_))

    def __post_init__(self) -> None:
        if not len(self.is_run):
            object.__setattr__(self, "is_run", read_only(np.zeros(len(self.mid_s)), np.bool_))

    def __len__(self) -> int:
        return len(self.mid_s)

    def until(self, t_s: float) -> Stances:
        """The rests whose middle is not later than `t_s`."""
        keep = self.mid_s <= t_s
        return Stances(*(getattr(self, column.name)[keep] for column in fields(self)))


@dataclass(frozen=True, slots=True)
class TrueStrides:
    """What lies between the rests of one foot (W3).

    The heading is the direction of the horizontal displacement. The first stride turns by 0: its direction is the
    heading at the start; a stride shorter than `SHORT_STRIDE_M` turns by as much as the foot does. The foot is never
    moved by such a stride here: it is set down where it stood, so that adding up strides gives its path exactly.
    """

    length_m: FloatArray  # (S - 1,) horizontal
    height_m: FloatArray  # (S - 1,) change of floor height
    turn_rad: FloatArray  # (S - 1,) change of heading, in [-pi, pi)
    heading_rad: FloatArray  # (S,) heading at each rest, the first that of the start


def stances(walk: SimulatedWalk, rng: np.random.Generator, params: GaitParams | None = None) -> tuple[Stances, Stances]:
    """Rests of the left and of the right foot.

    Feet alternate; on stairs each tread gets one foot, elsewhere steps have the length that suits the speed. A turn on
    the spot turns each foot where it stands. Every stride of either foot runs free of walls: where a bend is so tight
    that it would not, steps get shorter.

    Args:
        walk: Where the body is.
        rng: Varies the steps.
        params: None for the defaults.

    Raises:
        GaitError: A stride hits a wall however short the steps are.
    """
    params = params or GaitParams()
    feet = (_FootRests(walk.building, LEFT, params), _FootRests(walk.building, RIGHT, params))
    for foot in feet:
        foot.stand(walk.bouts[0])
    placing, steadiness = rng.spawn(2)
    unsteady = math.exp(params.unsteady_log_sigma * float(np.clip(steadiness.standard_normal(), -2, 2)))
    for i, bout in enumerate(walk.bouts):
        first = int(rng.integers(2))
        noise = _long_range_noise(rng, 64 + 4 * math.ceil(bout.s_m[-1] / walk.person.step_length_m), params.step_beta)
        placed_m = unsteady * params.placing_sigma_m * placing.standard_normal(len(noise))
        _walk_bout(feet, walk, bout, first, unsteady * params.step_sigma * noise, placed_m, params)
        if i + 1 < len(walk.bouts):
            for foot in feet:
                foot.ride(bout, walk.bouts[i + 1])
                foot.turn(bout, walk.bouts[i + 1])
    return feet[LEFT].stances(), feet[RIGHT].stances()


def strides(building: Building, rests: Stances) -> TrueStrides:
    """True strides between the rests of one foot."""
    step = np.diff(rests.xy_m, axis=0)
    length_m = np.hypot(*step.T)
    course_rad = np.arctan2(step[:, 1], step[:, 0])
    foot_turn_rad = np.diff(rests.yaw_rad)
    long = np.flatnonzero(length_m >= SHORT_STRIDE_M)
    heading_rad = np.zeros(len(rests))
    heading_rad[0] = course_rad[long[0]] if len(long) else rests.yaw_rad[0]
    for i, turn in enumerate(foot_turn_rad):
        is_long = length_m[i] >= SHORT_STRIDE_M
        heading_rad[i + 1] = course_rad[i] if is_long else heading_rad[i] + turn
    return TrueStrides(
        length_m=read_only(length_m),
        height_m=read_only(np.diff(building.height(rests.polygon))),
        turn_rad=read_only(wrap_rad(np.diff(heading_rad))),
        heading_rad=read_only(wrap_rad(heading_rad)),
    )


class _FootRests:
    """The rests of one foot as they come about."""

    def __init__(self, building: Building, side: int, params: GaitParams) -> None:
        self.building, self.side, self.params = building, side, params
        self.mid_s: list[float] = []
        self.xy_m: list[FloatArray] = []
        self.polygon: list[int] = []
        self.yaw_rad: list[float] = []
        self.is_run: list[bool] = []

    def stand(self, bout: Bout) -> None:
        """Puts the foot down at the beginning of the walk."""
        xy_m, polygon, yaw_rad = self.place(bout, np.zeros(1), self.params.foot_offset_m)
        self.add(0.0, xy_m[0], int(polygon[0]), float(yaw_rad[0]))

    def add(self, mid_s: float, xy_m: FloatArray, polygon: int, yaw_rad: float, is_run: bool = False) -> None:
        """One more rest."""
        self.mid_s.append(mid_s)
        self.xy_m.append(xy_m)
        self.polygon.append(polygon)
        self.yaw_rad.append(yaw_rad)
        self.is_run.append(is_run)

    def place(self, bout: Bout, s_m: FloatArray, offset_m: float) -> tuple[FloatArray, IntArray, FloatArray]:
        """Foot beside the body at ways (N,): xy_m (N, 2), polygon (N,), yaw_rad (N,); nearer where a wall is."""
        body_xy_m, body_polygon, yaw_rad = bout.place(self.building, s_m)
        side = 1.0 if self.side == LEFT else -1.0
        lateral = side * offset_m * np.column_stack([-np.sin(yaw_rad), np.cos(yaw_rad)])
        polygon, free = self.building.move(body_polygon, body_xy_m, body_xy_m + lateral)
        xy_m = np.where(free[:, None], body_xy_m + lateral, body_xy_m)
        polygon = np.where(free, polygon, body_polygon)
        # A shift too short to have a direction is none: the foot is set down where it stood.
        last_xy_m, last_polygon = (self.xy_m[-1], self.polygon[-1]) if self.xy_m else (xy_m[0], polygon[0])
        for i in range(len(s_m)):
            if math.hypot(*(xy_m[i] - last_xy_m)) < SHORT_STRIDE_M:
                xy_m[i], polygon[i] = last_xy_m, last_polygon
            last_xy_m, last_polygon = xy_m[i], int(polygon[i])
        return xy_m, polygon, yaw_rad

    def ride(self, before: Bout, after: Bout) -> None:
        """Lets a lift carry the foot, where one goes between two bouts; on the way it counts to the lower level."""
        rise_m = lift_ride_m(self.building, before, after)
        if rise_m:
            start_s, stop_s = lift_times_s(rise_m, before, after)
            self.add(stop_s if rise_m > 0 else start_s, self.xy_m[-1], int(after.polygon[0]), self.yaw_rad[-1])

    def turn(self, before: Bout, after: Bout) -> None:
        """Turns the foot on the spot while the person stands, in steps that end before the next bout."""
        turn_rad = standing_turn_rad(before, after)
        count = turn_steps(turn_rad)
        # The foot on the inside of the turn goes first.
        late_s = 0.15 if (turn_rad > 0) == (self.side == RIGHT) else 0.45
        from_rad = self.yaw_rad[-1]
        for i in range(count):
            mid_s = float(after.t_s[0]) - TURN_STEP_S * (count - i) + late_s
            self.add(mid_s, self.xy_m[-1], self.polygon[-1], from_rad + turn_rad * (i + 1) / count)

    def stances(self) -> Stances:
        mid_s, xy_m, is_run = np.array(self.mid_s), np.array(self.xy_m), np.array(self.is_run)
        stride_s = np.diff(mid_s)
        fraction = _rest_fraction(np.hypot(*np.diff(xy_m, axis=0).T) / stride_s, is_run[1:], self.params) / 2
        moving_s = np.where(stride_s < self.params.waits_from_s, stride_s, self.params.waited_s)
        begin_s, end_s = mid_s.copy(), np.full(len(mid_s), np.inf)
        begin_s[1:] -= fraction * moving_s
        end_s[:-1] = mid_s[:-1] + (stride_s - moving_s) + fraction * moving_s
        return Stances(
            mid_s=read_only(mid_s),
            begin_s=read_only(begin_s),
            end_s=read_only(end_s),
            xy_m=read_only(xy_m),
            polygon=read_only(self.polygon, np.int64),
            yaw_rad=read_only(np.unwrap(self.yaw_rad)),
            is_run=read_only(is_run, np.bool_),
        )


def _rest_fraction(speed_mps: FloatArray, is_run: BoolArray, params: GaitParams) -> FloatArray:
    """(N,) part of strides of these speeds for which the foot rests, half of it before and half after."""
    walking = np.clip(params.rest_fraction + params.rest_slope_per_mps * (speed_mps - 1.0), *params.rest_range)
    running = params.run_rest_fraction + params.run_rest_slope_per_mps * (speed_mps - RUN_MPS)
    return np.where(is_run, np.clip(running, *params.run_rest_range), walking)


@dataclass(frozen=True, slots=True)
class _Steps:
    """Rests planned for one bout, both feet."""

    s_m: FloatArray  # (J,) way of the body over each
    mid_s: FloatArray  # (J,)
    foot: IntArray  # (J,) which foot
    xy_m: FloatArray  # (J, 2)
    polygon: IntArray  # (J,) int
    yaw_rad: FloatArray  # (J,)


def _walk_bout(
    feet: tuple[_FootRests, _FootRests],
    walk: SimulatedWalk,
    bout: Bout,
    first: int,
    noise: FloatArray,
    placed_m: FloatArray,
    params: GaitParams,
) -> None:
    """Adds the rests of one bout, with shorter steps where a stride would hit a wall."""
    crowding = np.ones(len(bout.s_m))
    for attempt in range(16):
        # Late attempts put the feet on the line of the body, which runs free of walls.
        free = 1.0 if attempt < 10 else 0.0
        offset_m = free * params.foot_offset_m
        steps = _plan(feet, walk, bout, first, noise, free * placed_m, crowding, offset_m, params)
        blocked_m = _blocked(feet, walk.building, steps)
        if not len(blocked_m):
            for i in range(len(steps.s_m)):
                foot = feet[steps.foot[i]]
                at = (float(steps.mid_s[i]), steps.xy_m[i], int(steps.polygon[i]), float(steps.yaw_rad[i]))
                foot.add(*at, is_run=bout.is_run)
            return
        for from_m, to_m in blocked_m:
            crowding[(bout.s_m >= from_m - 0.3) & (bout.s_m <= to_m + 0.3)] *= 1.3
    raise GaitError(
        f"a stride between {bout.xy_m[0]} and {bout.xy_m[-1]} of building {walk.building.name!r} hits a wall however "
        f"short the steps are; check the floor polygons there"
    )


def _plan(
    feet: tuple[_FootRests, _FootRests],
    walk: SimulatedWalk,
    bout: Bout,
    first: int,
    noise: FloatArray,
    placed_m: FloatArray,
    crowding: FloatArray,
    offset_m: float,
    params: GaitParams,
) -> _Steps:
    """Rests of both feet from the first step of a bout until both stand beside each other."""
    s_m = _step_ways_m(walk, bout, first, noise, crowding)
    foot = (first + np.arange(len(s_m))) % 2
    mid_s = bout.time_s(s_m)
    s_m, foot = np.append(s_m, bout.s_m[-1]), np.append(foot, 1 - foot[-1])
    mid_s = np.append(mid_s, mid_s[-1] + params.closing_s)
    set_down_m = np.clip(s_m + np.resize(placed_m, len(s_m)), 0.0, bout.s_m[-1])
    xy_m, polygon, yaw_rad = np.zeros((len(s_m), 2)), np.zeros(len(s_m), dtype=np.int64), np.zeros(len(s_m))
    for side in (LEFT, RIGHT):
        own = foot == side
        xy_m[own], polygon[own], yaw_rad[own] = feet[side].place(bout, set_down_m[own], offset_m)
    return _Steps(s_m, mid_s, foot, xy_m, polygon, yaw_rad)


def _step_ways_m(walk: SimulatedWalk, bout: Bout, first: int, noise: FloatArray, crowding: FloatArray) -> FloatArray:
    """Way of the body at each step: the middles of treads, and between them as many steps as suit the speed.

    Between two fixed rests a phase grows by one a step, dphi/ds = 1 / L(v(s)). Steps come where it passes 1 + noise,
    2 + noise, ..., all stretched so that the last comes at the fixed rest.
    """
    step_m = (bout.runner or walk.person).step_at(bout.speed_mps) / crowding
    grown = np.concatenate([[0.0], np.cumsum(np.diff(bout.s_m) * (1 / step_m[1:] + 1 / step_m[:-1]) / 2)])
    ways: list[FloatArray] = []
    from_m, done = 0.0, 0
    for to_m in (*bout.treads_s_m, bout.s_m[-1]):
        begin, end = np.interp([from_m, to_m], bout.s_m, grown)
        step = done + np.arange(max(1, round(end - begin)))
        is_right = (first + step) % 2 == RIGHT
        uneven = 1 + np.take(noise, step, mode="wrap") + np.where(is_right, 0.5, -0.5) * walk.person.asymmetry
        at = begin + (end - begin) * np.cumsum(uneven) / uneven.sum()
        ways.append(np.interp(at, grown, bout.s_m))
        from_m, done = to_m, done + len(step)
    return np.concatenate(ways)


def _blocked(feet: tuple[_FootRests, _FootRests], building: Building, steps: _Steps) -> list[tuple[float, float]]:
    """Ways between which a stride of a foot hits a wall or ends in another polygon than its rest."""
    blocked = []
    for side, foot in enumerate(feet):
        own = steps.foot == side
        xy_m = np.vstack([foot.xy_m[-1][None], steps.xy_m[own]])
        polygon = np.concatenate([[foot.polygon[-1]], steps.polygon[own]])
        s_m = np.concatenate([[0.0], steps.s_m[own]])
        reached, free = building.move(polygon[:-1], xy_m[:-1], xy_m[1:])
        for i in np.flatnonzero(~free | (reached != polygon[1:])):
            blocked.append((float(s_m[i]), float(s_m[i + 1])))
    return blocked


def _long_range_noise(rng: np.random.Generator, count: int, beta: float) -> FloatArray:
    """(count,) unit variance, spectrum 1 / f^beta."""
    count += count % 2
    spectrum = np.fft.rfft(rng.standard_normal(count))
    frequency = np.fft.rfftfreq(count)
    frequency[0] = np.inf
    noise = np.fft.irfft(spectrum * frequency ** (-beta / 2), count)
    scaled: FloatArray = noise / noise.std()
    return scaled


def report_times_s(rests: Stances, hold_s: float) -> FloatArray:
    """(S,) when a foot-mounted unit reports a rest: at its middle, or earlier so that `hold_s` of rest remain.

    A rest shorter than `hold_s` is reported at its beginning.
    """
    return np.maximum(np.minimum(rests.mid_s, rests.end_s - hold_s), rests.begin_s)
