"""Where and when the feet of a walking person rest, and the stride events of one of them (W3)."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import PdrbenchError
from pdrbench.geometry import BoolArray, FloatArray, IntArray, read_only, wrap_rad
from pdrbench.simulate.walker import TURN_STEP_S, Bout, Walk, standing_turn_rad, turn_steps

LEFT: Final = 0
RIGHT: Final = 1
SHORT_STRIDE_M: Final = 0.1  # W3: below it the course says nothing, the turn of the foot counts


class GaitError(PdrbenchError):
    """The feet find no way that does not pass through a wall."""


@dataclass(frozen=True, slots=True)
class GaitParams:
    """How feet follow the body.

    Attributes:
        foot_offset_m: Of a foot's middle from the line of the body.
        step_sigma: Relative variation of steps, long-range correlated.
        step_beta: Its spectrum falls with frequency to this power.
        rest_share: Part of a stride for which the foot rests.
        closing_s: Time after the body stops at which the second foot is beside the first.
    """

    foot_offset_m: float = 0.065  # half of a step width of 0.13 m; ours, within the usual 0.05 to 0.08
    step_sigma: float = 0.03  # sources.md 1.2: CV of stride time 2.6 to 4 %
    step_beta: float = 0.66  # sources.md 1.2: DFA alpha 0.83
    rest_share: float = 0.35  # sources.md 1.2: foot slower than 0.15 m/s
    closing_s: float = 0.45  # ours: a slow step


@dataclass(frozen=True, slots=True)
class Stances:
    """Rests of one foot in order, the first at the beginning of the walk.

    Attributes:
        mid_s: (S,) middle of the rest, when the body passes over the foot; 0 for the first.
        begin_s: (S,) since when the foot has rested.
        end_s: (S,) until when it rests; infinite for the last.
        xy_m: (S, 2).
        polygon: (S,) int.
        yaw_rad: (S,) where the foot points, unwrapped.
    """

    mid_s: FloatArray
    begin_s: FloatArray
    end_s: FloatArray
    xy_m: FloatArray
    polygon: IntArray
    yaw_rad: FloatArray

    def __len__(self) -> int:
        return len(self.mid_s)

    def until(self, t_s: float) -> Stances:
        """The rests whose middle is not later than `t_s`."""
        keep = self.mid_s <= t_s
        return Stances(*(getattr(self, field.name)[keep] for field in fields(self)))


@dataclass(frozen=True, slots=True)
class Strides:
    """What lies between the rests of one foot (W3).

    The heading is the course of the horizontal displacement. The first stride turns by 0, so that its course is the
    heading at the start; a stride shorter than `SHORT_STRIDE_M` turns by as much as the foot does. The foot is never
    moved by such a stride here: it is set down where it stood, so that adding up strides gives its path exactly.

    Attributes:
        length_m: (S - 1,) horizontal.
        height_m: (S - 1,) change of floor height.
        turn_rad: (S - 1,) change of heading, in [-pi, pi).
        heading_rad: (S,) heading at each rest, the first that of the start.
    """

    length_m: FloatArray
    height_m: FloatArray
    turn_rad: FloatArray
    heading_rad: FloatArray


def stances(walk: Walk, rng: np.random.Generator, params: GaitParams | None = None) -> tuple[Stances, Stances]:
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
    feet = (_Foot(walk.building, LEFT, params), _Foot(walk.building, RIGHT, params))
    for foot in feet:
        foot.stand(walk.bouts[0])
    for i, bout in enumerate(walk.bouts):
        first = int(rng.integers(2))
        noise = _long_range_noise(rng, 64 + 4 * math.ceil(bout.s_m[-1] / walk.person.step_length_m), params.step_beta)
        _walk_bout(feet, walk, bout, first, params.step_sigma * noise, params)
        if i + 1 < len(walk.bouts):
            for foot in feet:
                foot.turn(bout, walk.bouts[i + 1])
    return feet[LEFT].stances(), feet[RIGHT].stances()


def strides(building: Building, rests: Stances) -> Strides:
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
    return Strides(
        length_m=read_only(length_m),
        height_m=read_only(np.diff(building.height(rests.polygon))),
        turn_rad=read_only(wrap_rad(np.diff(heading_rad))),
        heading_rad=read_only(wrap_rad(heading_rad)),
    )


class _Foot:
    """The rests of one foot as they come about."""

    def __init__(self, building: Building, side: int, params: GaitParams) -> None:
        self.building, self.side, self.params = building, side, params
        self.mid_s: list[float] = []
        self.xy_m: list[FloatArray] = []
        self.polygon: list[int] = []
        self.yaw_rad: list[float] = []

    def stand(self, bout: Bout) -> None:
        """Puts the foot down at the beginning of the walk."""
        xy_m, polygon, yaw_rad = self.place(bout, np.zeros(1), self.params.foot_offset_m)
        self.add(0.0, xy_m[0], int(polygon[0]), float(yaw_rad[0]))

    def add(self, mid_s: float, xy_m: FloatArray, polygon: int, yaw_rad: float) -> None:
        """One more rest."""
        self.mid_s.append(mid_s)
        self.xy_m.append(xy_m)
        self.polygon.append(polygon)
        self.yaw_rad.append(yaw_rad)

    def place(self, bout: Bout, s_m: FloatArray, offset_m: float) -> tuple[FloatArray, IntArray, FloatArray]:
        """Foot beside the body at ways (N,): xy_m (N, 2), polygon (N,), yaw_rad (N,); nearer where a wall is."""
        body_xy_m, body_polygon, yaw_rad = bout.place(self.building, s_m)
        side = 1.0 if self.side == LEFT else -1.0
        lateral = side * offset_m * np.column_stack([-np.sin(yaw_rad), np.cos(yaw_rad)])
        polygon, free = self.building.move(body_polygon, body_xy_m, body_xy_m + lateral)
        xy_m = np.where(free[:, None], body_xy_m + lateral, body_xy_m)
        polygon = np.where(free, polygon, body_polygon)
        # A shift too short to tell its course is none: the foot is set down where it stood.
        last_xy_m, last_polygon = (self.xy_m[-1], self.polygon[-1]) if self.xy_m else (xy_m[0], polygon[0])
        for i in range(len(s_m)):
            if math.hypot(*(xy_m[i] - last_xy_m)) < SHORT_STRIDE_M:
                xy_m[i], polygon[i] = last_xy_m, last_polygon
            last_xy_m, last_polygon = xy_m[i], int(polygon[i])
        return xy_m, polygon, yaw_rad

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
        mid_s = np.array(self.mid_s)
        share = self.params.rest_share / 2
        begin_s, end_s = mid_s.copy(), np.full(len(mid_s), np.inf)
        begin_s[1:] -= share * np.diff(mid_s)
        end_s[:-1] = mid_s[:-1] + share * np.diff(mid_s)
        return Stances(
            mid_s=read_only(mid_s),
            begin_s=read_only(begin_s),
            end_s=read_only(end_s),
            xy_m=read_only(np.array(self.xy_m)),
            polygon=read_only(self.polygon, np.int64),
            yaw_rad=read_only(np.unwrap(self.yaw_rad)),
        )


@dataclass(frozen=True, slots=True)
class _Steps:
    """Rests planned for one bout, both feet.

    Attributes:
        s_m: (J,) way of the body over each.
        mid_s: (J,).
        foot: (J,) which foot.
        xy_m: (J, 2).
        polygon: (J,) int.
        yaw_rad: (J,).
    """

    s_m: FloatArray
    mid_s: FloatArray
    foot: IntArray
    xy_m: FloatArray
    polygon: IntArray
    yaw_rad: FloatArray


def _walk_bout(
    feet: tuple[_Foot, _Foot], walk: Walk, bout: Bout, first: int, noise: FloatArray, params: GaitParams
) -> None:
    """Adds the rests of one bout, with shorter steps where a stride would hit a wall."""
    crowding = np.ones(len(bout.s_m))
    for attempt in range(16):
        # Late attempts put the feet on the line of the body, which runs free of walls.
        offset_m = params.foot_offset_m if attempt < 10 else 0.0
        steps = _plan(feet, walk, bout, first, noise, crowding, offset_m, params)
        blocked_m = _blocked(feet, walk.building, steps)
        if not len(blocked_m):
            for i in range(len(steps.s_m)):
                foot = feet[steps.foot[i]]
                foot.add(float(steps.mid_s[i]), steps.xy_m[i], int(steps.polygon[i]), float(steps.yaw_rad[i]))
            return
        for from_m, to_m in blocked_m:
            crowding[(bout.s_m >= from_m - 0.3) & (bout.s_m <= to_m + 0.3)] *= 1.3
    raise GaitError(
        f"a stride between {bout.xy_m[0]} and {bout.xy_m[-1]} of building {walk.building.name!r} hits a wall however "
        f"short the steps are; check the floor polygons there"
    )


def _plan(
    feet: tuple[_Foot, _Foot],
    walk: Walk,
    bout: Bout,
    first: int,
    noise: FloatArray,
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
    xy_m, polygon, yaw_rad = np.zeros((len(s_m), 2)), np.zeros(len(s_m), dtype=np.int64), np.zeros(len(s_m))
    for side in (LEFT, RIGHT):
        own = foot == side
        xy_m[own], polygon[own], yaw_rad[own] = feet[side].place(bout, s_m[own], offset_m)
    return _Steps(s_m, mid_s, foot, xy_m, polygon, yaw_rad)


def _step_ways_m(walk: Walk, bout: Bout, first: int, noise: FloatArray, crowding: FloatArray) -> FloatArray:
    """Way of the body at each step: the middles of treads, and between them as many steps as suit the speed.

    Between two fixed rests a phase grows by one a step, dphi/ds = 1 / L(v(s)). Steps come where it passes 1 + noise,
    2 + noise, ..., all stretched so that the last comes at the fixed rest.
    """
    step_m = walk.person.step_at(bout.speed_mps) / crowding
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


def _blocked(feet: tuple[_Foot, _Foot], building: Building, steps: _Steps) -> list[tuple[float, float]]:
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


def told_s(rests: Stances, hold_s: float) -> FloatArray:
    """(S,) when a foot-mounted unit tells of a rest: at its middle, or earlier so that `hold_s` of rest remain.

    A rest shorter than `hold_s` is told of at its beginning.
    """
    return np.maximum(np.minimum(rests.mid_s, rests.end_s - hold_s), rests.begin_s)


def walkable_strides(building: Building, rests: Stances) -> BoolArray:
    """(S - 1,) True where a stride runs free of walls and ends in the polygon of its rest."""
    reached, free = building.move(rests.polygon[:-1], rests.xy_m[:-1], rests.xy_m[1:])
    walkable: BoolArray = free & (reached == rests.polygon[1:])
    return walkable
