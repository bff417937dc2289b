"""The motion of a unit on a walking foot, from rest to rest (sources.md 1.2, 1.3)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline

from pdrbench.building import Building
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.inertial.quaternions import from_yaw_pitch_roll
from pdrbench_sim.foot.shake import add_knocks, standing
from pdrbench_sim.foot.shape import NUM_KNOTS, TOE_HIGH, TOE_LOW, GaitShape, gait_shape
from pdrbench_sim.foot.site import INSTEP, FootSite, plant
from pdrbench_sim.foot.style import FootStyle, SwingParams, draw_foot_style
from pdrbench_sim.people.strides import Stances
from pdrbench_sim.people.walk import LIFT_MPS, lifted_m
from pdrbench_sim.units.motion import MotionError, RigidMotion

UNIT_HEIGHT_M: Final = 0.08  # of the unit above the sole: [M] of surveyed strides, as in the adaptive foot filter
PIVOT_M: Final = 0.1  # from the unit ahead to where the foot turns about: [M] its speed to the side over its yaw rate
RUN_MPS: Final = 1.9  # a stride faster than this is run; ours
MAX_DURATION_S: Final = 1.6  # [R] of a stride; what is longer begins with standing. Cadences do not fall below 1.25 Hz
_PAUSE_S: Final = 0.8  # a rest longer by this than a stride is standing: the foot comes to rest, and starts from rest
_EASE: Final = 0.2  # phase over which a foot comes to rest
_STANDING_S: Final = 0.05  # between knots of a standing foot
_SHORT_M: Final = 0.8  # shorter strides lift and tilt the foot less; ours
_MIN_SCALE: Final = 0.25  # ours: of a foot set down where it stood
_STAIR_M: Final = 0.1  # a stride that rises or falls by more is on stairs
_STAIR_LEAD: Final = 0.06  # phase by which a foot rises early, or falls late, to clear the tread; ours
_STAIR_TILT: Final = 0.6  # of the tilt on the flat: the foot is set down nearly level; ours
_STANCE: Final = 0.22  # phase: half of the duration of a stance
_ROLLS: Final = 0.1  # phase from the middle of a stance up to which the foot lies on the floor; ours
_LOADING: Final = 0.1  # phase from the middle of a stance at which a shoe gives way fastest; ours


def foot_motion(
    building: Building,
    rests: Stances,
    rng: np.random.Generator,
    *,
    end_s: float,
    rate_hz: float = 500.0,
    style: FootStyle | None = None,
    params: SwingParams | None = None,
    gaits: tuple[GaitShape, GaitShape] | None = None,
    site: FootSite = INSTEP,
) -> RigidMotion:
    """The unit from t = 0 to `end_s`: x ahead, z up; on the instep `UNIT_HEIGHT_M` above the floor that it stands on.

    Between the middles of two rests the foot moves as recorded feet do at that speed, stretched to the way, the rise
    and the time there is. On the floor it rolls: a unit on the instep is never quite still. Where it rests for longer
    than a stride takes, the foot stands. In a lift it stands while the floor rises or falls.

    Args:
        building: Gives the heights of the floors.
        rests: Of one foot.
        rng: What differs from stride to stride, and `style` where that is None.
        end_s: Last time.
        rate_hz: Of the samples.
        style: Of the person and the shoe.
        params: None for the defaults.
        gaits: Shapes of walking and of running strides; None for those learned from recordings.
        site: Where on the shoe the unit sits.

    Raises:
        MotionError: `end_s` is not above 0.
    """
    if not (end_s > 0 and math.isfinite(end_s) and rate_hz > 0):
        raise MotionError(f"a foot needs a time to move in; got end_s {end_s:g} at {rate_hz:g} Hz, give both above 0")
    params = params or SwingParams()
    for_style, for_knots, for_knocks, for_standing = rng.spawn(4)
    style = style or draw_foot_style(for_style, params)
    rests, rides = _without_rides(building, rests)
    floor_m = building.height(rests.polygon) - _lifted_m(rides, rests.mid_s)
    strides = _Strides.between(rests, floor_m)
    for_shape, for_phase = for_knots.spawn(2)
    late = params.phase_sigma * np.clip(for_phase.standard_normal((len(strides.time_s), 2)), -2, 2)
    gaits = gaits or (gait_shape("walk"), gait_shape("run").with_slow_roll(params.run_roll_cycles))
    knot_s, poses = _knots(rests, floor_m, strides, late, end_s, style, params, gaits, site, for_shape)
    t_s = np.arange(math.floor(end_s * rate_hz + 1e-9) + 1) / rate_hz
    poses = CubicSpline(knot_s, poses)(t_s)
    poses[:, 2] += _lifted_m(rides, t_s)
    _turn_about_the_sole(poses, standing(t_s, for_standing, params, style.tremor))
    landmarks = {TOE_LOW: TOE_LOW + late[:, 0], TOE_HIGH: TOE_HIGH + late[:, 1]}
    slow = params.slow_at(strides.speed_mps)
    phases = [landmarks[knock.phase] + slow * _slow_delay(np.array(knock.phase)) for knock in params.knocks]
    landmark_s = np.array([strides.begin_s + when * strides.time_s for when in phases])
    hard_mps = strides.speed_mps * np.where(strides.is_run, params.run_knock, 1.0)
    add_knocks(t_s, poses, landmark_s, hard_mps, strides.yaw_rad, for_knocks, style.knock, params)
    return RigidMotion(t_s, poses[:, :3], from_yaw_pitch_roll(poses[:, 5], poses[:, 3], poses[:, 4])).at(site.lever_m)


@dataclass(frozen=True, slots=True)
class _Ride:
    """A lift that carries a standing foot."""

    start_s: float
    stop_s: float
    rise_m: float


def _without_rides(building: Building, rests: Stances) -> tuple[Stances, list[_Ride]]:
    """Rests without those that only mark a ride in a lift (`pdrbench_sim.people.strides`), and the rides."""
    is_lift = np.array([polygon.kind == "lift" for polygon in building.polygons])[rests.polygon]
    rise_m = np.diff(building.height(rests.polygon))
    ends = 1 + np.flatnonzero(is_lift[1:] & is_lift[:-1] & (rise_m != 0))
    if not len(ends):
        return rests, []
    rides = []
    for end in ends.tolist():
        # The rest counts to the lower level: it comes when a lift arrives there, or leaves it.
        up_m, at_s = float(rise_m[end - 1]), float(rests.mid_s[end])
        took_s = abs(up_m) / LIFT_MPS
        start_s = at_s - took_s if up_m > 0 else at_s
        rides.append(_Ride(start_s, start_s + took_s, up_m))
    kept = np.delete(np.arange(len(rests)), ends)
    return Stances(*(getattr(rests, column.name)[kept] for column in fields(rests))), rides


def _lifted_m(rides: Sequence[_Ride], t_s: FloatArray) -> FloatArray:
    """(N,) by how much lifts have carried the foot up until times (N,)."""
    total_m = np.zeros(len(t_s))
    for ride in rides:
        total_m += lifted_m(ride.rise_m, np.clip((t_s - ride.start_s) / (ride.stop_s - ride.start_s), 0.0, 1.0))
    return total_m


@dataclass(frozen=True, slots=True)
class _Strides:
    """What lies between the rests."""

    begin_s: FloatArray  # (S - 1,) the middle of the rest before, or later where the foot stood
    time_s: FloatArray  # (S - 1,) from there to the middle of the rest after
    length_m: FloatArray  # (S - 1,)
    rise_m: FloatArray  # (S - 1,)
    speed_mps: FloatArray  # (S - 1,)
    yaw_rad: FloatArray  # (S - 1,) where the foot points in the end
    is_run: BoolArray  # (S - 1,) planned as a run, or faster than `RUN_MPS`
    from_rest: BoolArray  # (S - 1,) the foot stood before
    to_rest: BoolArray  # (S - 1,) it will stand after

    @staticmethod
    def between(rests: Stances, floor_m: FloatArray) -> _Strides:
        between_s = np.diff(rests.mid_s)
        stands = between_s > MAX_DURATION_S + _PAUSE_S
        if len(stands):
            stands[0] |= True  # before the first stride
        time_s = np.where(stands, np.minimum(between_s, MAX_DURATION_S), between_s)
        length_m = np.hypot(*np.diff(rests.xy_m, axis=0).T)
        return _Strides(
            begin_s=rests.mid_s[1:] - time_s,
            time_s=time_s,
            length_m=length_m,
            rise_m=np.diff(floor_m),
            speed_mps=length_m / time_s,
            yaw_rad=rests.yaw_rad[1:],
            is_run=np.asarray(rests.is_run[1:] | (length_m > RUN_MPS * time_s)),
            from_rest=stands,
            to_rest=np.append(stands[1:], True)[: len(stands)],
        )


def _knots(
    rests: Stances,
    floor_m: FloatArray,
    strides: _Strides,
    late: FloatArray,
    end_s: float,
    style: FootStyle,
    params: SwingParams,
    gaits: tuple[GaitShape, GaitShape],
    site: FootSite,
    rng: np.random.Generator,
) -> tuple[FloatArray, FloatArray]:
    """(K,) times, increasing, and (K, 6) poses x, y, z, pitch, roll, yaw of the unit.

    `late` (S, 2) is by how much the landmarks of the swings come late.
    """
    for_modes, for_stances = rng.spawn(2)
    count = len(strides.time_s)
    stood = np.column_stack([rests.xy_m, floor_m + UNIT_HEIGHT_M])
    shape = _shapes(strides, style, math.sqrt(1 - params.person_fraction**2), gaits, for_modes)
    phase = np.linspace(0, 1, NUM_KNOTS)
    tau = (
        phase
        + late @ _phase_bumps(phase)
        + _lingering(phase, params.linger_at(style.linger, strides.speed_mps), params.linger_phase)
        + params.slow_at(strides.speed_mps)[:, None] * _slow_delay(phase)
    )
    tau = np.where(strides.from_rest[:, None] & (tau < _EASE), np.sqrt(4 * _EASE * np.maximum(tau, 0)) - _EASE, tau)
    is_last = strides.to_rest[:, None] & (tau > 1 - _EASE)
    tau = np.where(is_last, 1 + _EASE - np.sqrt(4 * _EASE * np.maximum(1 - tau, 0)), tau)
    when_s = strides.begin_s[:, None] + tau * strides.time_s[:, None]

    rolled = _on_the_floor(shape, phase)
    plant(shape, rolled, phase, site)
    turned, shifted = ((1 - site.planted) * part for part in _stance_motion(for_stances, strides, phase, style, params))
    along, lead = shape[:, :, 0], np.sign(strides.rise_m) * (np.abs(strides.rise_m) > _STAIR_M) * _STAIR_LEAD
    climbed = np.array([np.interp(phase + lead[k], phase, along[k]) for k in range(count)]).reshape(along.shape)
    moved = np.diff(stood, axis=0)
    unit = moved[:, :2] / np.maximum(strides.length_m, 1e-9)[:, None]
    poses = np.empty((count, NUM_KNOTS, 6))
    for axis, normal in ((0, -unit[:, 1]), (1, unit[:, 0])):
        poses[:, :, axis] = stood[:-1, axis, None] + along * moved[:, axis, None]
        poses[:, :, axis] += (rolled + shifted[:, :, 0]) * unit[:, axis, None] + (
            shape[:, :, 1] + shifted[:, :, 1]
        ) * normal[:, None]
    poses[:, :, 2] = stood[:-1, 2, None] + climbed * moved[:, 2, None] + shape[:, :, 2] + shifted[:, :, 2]
    ahead = np.cos(np.arctan2(moved[:, 1], moved[:, 0]) - (rests.yaw_rad[:-1] + rests.yaw_rad[1:]) / 2)
    ahead = np.where(strides.length_m > 0, ahead, 1.0)  # who walks backwards tilts the foot the other way
    poses[:, :, 3] = (shape[:, :, 3] + turned[:, :, 0]) * ahead[:, None]
    poses[:, :, 4] = shape[:, :, 4] + turned[:, :, 1]
    poses[:, :, 5] = (
        rests.yaw_rad[:-1, None] + along * np.diff(rests.yaw_rad)[:, None] + shape[:, :, 5] + turned[:, :, 2]
    )
    return _with_standing(rests, stood, when_s, poses, end_s)


def _with_standing(
    rests: Stances, stood: FloatArray, when_s: FloatArray, poses: FloatArray, end_s: float
) -> tuple[FloatArray, FloatArray]:
    """Knots of the strides and of a foot that stands still before, between and after them."""
    # The last knot of a stride is the first of the next, but where the foot stands in between.
    times, values = [], []
    last_s, last = -1.0, np.concatenate([stood[0], [0.0, 0.0, rests.yaw_rad[0]]])
    gaps = np.append(when_s[:, 0], max(end_s, float(when_s[-1, -1]) if len(when_s) else 0.0) + 1.0)
    for k, until_s in enumerate(gaps):
        if until_s - last_s > 2 * _STANDING_S:
            standing_s = np.arange(last_s + (_STANDING_S if k else 0.0), until_s - _STANDING_S / 2, _STANDING_S)
            times.append(standing_s)
            values.append(np.repeat(last[None], len(standing_s), axis=0))
        if k < len(when_s):
            is_joined = k + 1 < len(when_s) and when_s[k + 1, 0] - when_s[k, -1] < 1e-6
            rows = slice(None, -1 if is_joined else None)
            times.append(when_s[k, rows])
            values.append(poses[k, rows])
            last_s, last = float(when_s[k, -1]), poses[k, -1]
    return np.concatenate(times), np.concatenate(values)


def _shapes(
    strides: _Strides,
    style: FootStyle,
    stride_fraction: float,
    gaits: tuple[GaitShape, GaitShape],
    rng: np.random.Generator,
) -> FloatArray:
    """(S, NUM_KNOTS, 6) of all strides: channels of the learned shapes, in metres and radians."""
    count = len(strides.time_s)
    runs = strides.is_run
    draws = style.modes + stride_fraction * np.clip(rng.standard_normal((count, len(style.modes))), -2.5, 2.5)
    shape = np.empty((count, NUM_KNOTS, 6))
    for gait, chosen in zip(gaits, (~runs, runs), strict=True):
        modes = gait.modes
        varied = draws[chosen, : len(modes)] @ modes.reshape(len(modes), -1)
        shape[chosen] = gait.at(strides.length_m[chosen]) + varied.reshape(-1, NUM_KNOTS, 6)
    stairs = np.abs(strides.rise_m) > _STAIR_M
    scale = np.clip(strides.length_m / _SHORT_M, _MIN_SCALE, 1.0) * style.lift
    shape[:, :, 1:] *= scale[:, None, None]
    shape[:, :, 3] *= np.where(stairs, _STAIR_TILT, 1.0)[:, None]
    if style.is_mirrored:
        shape[:, :, [1, 4, 5]] *= -1
    return shape


def _on_the_floor(shape: FloatArray, phase: FloatArray) -> FloatArray:
    """(S, NUM_KNOTS) metres ahead by which the foot rolls; strides (S, NUM_KNOTS, 6) are changed in place.

    Around the middle of a stance a foot is rigid and turns about its sole: the unit goes where that takes it, and
    not where the mean of many strides, each of which did so, happens to lie.
    """
    off = np.where(phase < 0.5, phase, phase - 1)
    fraction = np.exp(-0.5 * (off / _ROLLS) ** 2)
    turned = shape[:, :, 3:] - shape[:, :1, 3:]
    shape[:, :, 0] += fraction * ((phase > 0.5) - shape[:, :, 0])
    shape[:, :, 1] += fraction * (-UNIT_HEIGHT_M * turned[:, :, 1] - PIVOT_M * turned[:, :, 2] - shape[:, :, 1])
    return np.asarray(fraction * UNIT_HEIGHT_M * turned[:, :, 0])


def _lingering(phase: FloatArray, fraction: FloatArray, width: float) -> FloatArray:
    """(S, NUM_KNOTS) delay of feet that pass the middle of a stance 1 + `fraction` (S,) times as slowly."""
    off = np.where(phase < 0.5, phase, phase - 1)
    return np.asarray(fraction[:, None] * off * np.exp(-((off / width) ** 2)))


def _slow_delay(phase: FloatArray) -> FloatArray:
    """Delay, per unit of how much longer a stance is, of a foot that takes as much time for the whole stride."""
    return np.asarray(np.sin(2 * math.pi * phase) / (2 * math.pi))


def _stance_motion(
    rng: np.random.Generator, strides: _Strides, phase: FloatArray, style: FootStyle, params: SwingParams
) -> tuple[FloatArray, FloatArray]:
    """(S, NUM_KNOTS, 3) by which feet on the floor turn (pitch, roll, yaw) beyond the learned mean, and where the unit
    is meanwhile: ahead, to the left, up.

    Around the middle of each stance the foot turns with a rate of its own about a point on the floor. While it takes
    the load, and while it hands it on, shoe and strap give way, and the unit shifts. Nothing is left of either in the
    middle of the swings. A foot that stands does not roll.
    """
    for_turns, for_shifts = rng.spawn(2)
    count = len(strides.time_s)
    rolls = np.append(~strides.from_rest * np.clip(strides.length_m / _SHORT_M, 0.0, 1.0), 0.0)[:, None]
    rate = rolls * np.clip(for_turns.standard_normal((count + 1, 3)), -3, 3) * np.array(params.roll_sigma_rad)
    moved = [UNIT_HEIGHT_M * rate[:, 0], -UNIT_HEIGHT_M * rate[:, 1] - PIVOT_M * rate[:, 2], np.zeros(count + 1)]
    give = np.array(params.give_sigma_m) * np.clip(for_shifts.standard_normal((2, count + 1, 3)), -3, 3)
    give[:, :, 0] += style.creep_m
    unloading, loading = rolls * give

    off = np.where(phase < 0.5, phase, phase - 1)
    fades = np.cos(np.pi * off) ** 2
    turning = off * np.exp(-0.5 * (off / _STANCE) ** 2) * fades
    shifting = off * (off / _LOADING) ** 2 * np.exp(-0.5 * (off / _LOADING) ** 2) * fades

    def both(shape: FloatArray, after: FloatArray, before: FloatArray) -> FloatArray:
        is_early = (phase < 0.5)[:, None]
        return np.where(is_early, after[:-1, None], before[1:, None]) * shape[:, None]

    arc = np.column_stack(moved)
    return both(turning, rate, rate), both(turning, arc, arc) + both(shifting, unloading, loading)


def _turn_about_the_sole(poses: FloatArray, tilt: FloatArray) -> None:
    """Adds pitch and roll (n, 2) to poses (n, 6), in place, and what they move the unit by."""
    cos, sin = np.cos(poses[:, 5]), np.sin(poses[:, 5])
    ahead, left = UNIT_HEIGHT_M * tilt[:, 0], -UNIT_HEIGHT_M * tilt[:, 1]
    poses[:, 0] += cos * ahead - sin * left
    poses[:, 1] += sin * ahead + cos * left
    poses[:, 3:5] += tilt


def _phase_bumps(phase: FloatArray) -> FloatArray:
    """(2, NUM_KNOTS) how a shift of either landmark moves the others: smooth, 0 at mid-stance."""
    early = np.where(phase < TOE_LOW, phase / TOE_LOW, (TOE_HIGH - phase) / (TOE_HIGH - TOE_LOW))
    late = np.where(phase < TOE_HIGH, (phase - TOE_LOW) / (TOE_HIGH - TOE_LOW), (1 - phase) / (1 - TOE_HIGH))
    fraction = np.clip(np.stack([early, late]), 0, 1)
    return np.asarray(fraction**2 * (3 - 2 * fraction))
