"""Where a phone is carried, and how it moves there: in a hand, a trouser pocket, a bag, at the ear, on a cart.

A place turns the motion of the body into that of the phone. Displacements are in the frame of the heading (ahead, left,
up), attitudes Hamilton quaternions from the phone to the building.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Final

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.inertial.quaternions import from_yaw_pitch_roll, multiply
from pdrbench_sim.phone.containers import (
    BagParams,
    CartParams,
    pendulum_rad,
    second_difference,
    stretched_m,
    wheel_vibration_m,
)
from pdrbench_sim.phone.gait import PATH_SMOOTH_S, Trunk, smooth, smooth_noise
from pdrbench_sim.phone.heading import held_yaw_rad

_DEG: Final = math.pi / 180


@dataclass(frozen=True, slots=True)
class CarryParams:
    """How phones are carried; pairs are mean and standard deviation from walk to walk, unless a line says otherwise."""

    hand_height: float = 0.70  # of a held phone, over body height; [R] 1.2 m
    hand_ahead_m: float = 0.30  # in front of the body; [R]
    hand_tilt_rad: tuple[float, float] = (5 * _DEG, 8 * _DEG)  # of the top edge, upwards; [R]; surveyors hold it flat
    hand_lean_rad: tuple[float, float] = (0.0, 3 * _DEG)  # to one side; [M]
    # By how much the wrist gives way to the vertical acceleration.
    hand_yield_rad_per_mps2: float = 0.0185  # [M] 1.0 rad/s at 5 m/s2
    hand_yield_log_sigma: float = 0.3  # its spread from walk to walk; [M]
    # Amplitude of the yaw at the stride rate.
    hand_turn_rad: float = 1.6 * _DEG  # [M] 0.2 rad/s about z at the stride rate
    # Amplitudes ahead, to the left and up with which a held phone shakes when a heel comes down.
    shake_mps2: tuple[float, float, float] = (0.7, 0.8, 1.5)  # [M] power between 6 and 12 Hz
    shake_radps: tuple[float, float, float] = (0.5, 0.43, 0.22)  # amplitudes about the phone's x, y and z; [M] the same
    # Frequency of the shaking, mean and standard deviation from step to step.
    shake_hz: tuple[float, float] = (6.3, 1.6)  # [M] the same
    shake_s: float = 0.05  # width of its envelope; ours: two swings
    shake_steady: float = 0.0  # part of its amplitudes and phases that is the same at every step; ours
    # What a heel strike does grows with this power of the rise; that of people who step gently is more than in
    # proportion.
    heel_power: float = 1.0  # ours
    ear_shakes: float = 0.0  # part of that shaking that reaches a phone at the ear; ours
    arm_shakes: float = 0.0  # part that reaches one in a swinging arm; ours
    # Of the attitude of a held phone about each axis, each walk another, uniform in this range.
    jitter_rad: tuple[float, float] = (1.2 * _DEG, 2.4 * _DEG)  # [M] rates between 0.3 and 5 Hz
    jitter_s: float = 0.5  # its correlation time; sources.md 1.4
    jitter_smooth_s: float = 0.04  # by which it is smoothed; ours: passes 4 Hz at -4 dB
    jitter_standing: float = 0.4  # part of it that is left while standing; ours
    hip_height: float = 0.53  # of the hip joint, over body height; [R]
    pocket_below_hip_m: tuple[float, float] = (0.08, 0.20)  # of a phone in a trouser pocket, uniform in this range; [R]
    pocket_aside_m: float = 0.13  # from the middle of the body; [R]
    pocket_ahead_m: tuple[float, float] = (0.0, 0.05)  # in front of the axis of the thigh, uniform in this range; [R]
    # Amplitude of the thigh at the stride rate, walking.
    thigh_rad: tuple[float, float] = (21 * _DEG, 3 * _DEG)  # sources.md 1.4: 20 to 25 degrees
    thigh_run_rad: float = 35 * _DEG  # the same, running; [R]
    thigh_second: float = 0.2  # of the second harmonic over the first; [R]
    pocket_loose_rad: float = 2 * _DEG  # of a phone that turns in its pocket, standard deviation; ours
    pocket_rise: float = 0.74  # part of the rise of a held phone that is left at the hip; [M]
    # Amplitude of the vertical acceleration at three times the stride rate.
    pocket_third_mps2: tuple[float, float] = (1.8, 0.4)  # [M] the line at 3/2 of the step rate
    pocket_shake_mps2: tuple[float, float, float] = (1.8, 1.2, 2.2)  # as `shake_mps2`, of a phone in a pocket; [M]
    heel_mps2: tuple[float, float] = (6.0, 2.0)  # acceleration at the heel strike of the pocket's side; [M]
    heel_other: float = 0.6  # that of the other side, as a part of it; [M]
    heel_log_sigma: float = 0.25  # spread from step to step; ours
    # From the strike to the blow at the pocket, uniform in this range.
    heel_late_s: tuple[float, float] = (0.02, 0.09)  # ours
    heel_s: float = 0.030  # width of the blow; [M] power between 5 and 15 Hz
    # Amplitude with which a phone in a pocket rings after each blow; 0: not at all, as in the walks of versions 0.
    rattle_mps2: float = 0.0
    rattle_hz: tuple[float, float] = (6.0, 9.5)  # at which it rings, uniform in this range; [M] pockets of one person
    rattle_s: float = 0.06  # width of its envelope; [M] the same: about two swings
    ear_height: float = 0.93  # of a phone at the ear, over body height; [R]
    shoulder_height: float = 0.82  # over body height; [R]
    arm_m: float = 0.65  # from the shoulder to a phone in a swinging hand; [R]
    arm_rad: tuple[float, float] = (18 * _DEG, 5 * _DEG)  # amplitude of the arm at the stride rate; [R]
    bag: BagParams = field(default_factory=BagParams)  # over the shoulder
    cart: CartParams = field(default_factory=CartParams)  # with the phone on its handle


@dataclass(frozen=True, slots=True, eq=False)
class BodyMotion:
    """What the motion of a phone depends on: the body."""

    t_s: FloatArray  # (n,) fine and even
    coarse_s: FloatArray  # (m,) at `COARSE_HZ`
    heading_rad: FloatArray  # (n,) heading of the body
    speed_mps: FloatArray  # (n,) of the body
    trunk: Trunk  # its oscillation, (n,)
    heel_s: FloatArray  # (k,) when heels come down, in order
    heel_is_left: BoolArray  # (k,) whether it is the left one
    heel_strength: FloatArray  # (k,) how hard, 1 at an ordinary walk
    height_m: float  # of the body
    params: CarryParams  # how phones are carried

    @property
    def rate_hz(self) -> float:
        """Of the fine samples."""
        return float((len(self.t_s) - 1) / (self.t_s[-1] - self.t_s[0]))

    def fine(self, coarse: FloatArray) -> FloatArray:
        """(n, ...) coarse samples at the fine times."""
        from scipy.interpolate import CubicSpline

        return np.asarray(CubicSpline(self.coarse_s, coarse)(self.t_s))

    def jitter(self, rng: np.random.Generator, sigma_rad: float, standing: float) -> FloatArray:
        """(n, 3) unsteadiness of an attitude, less while standing."""
        noise = smooth_noise(len(self.coarse_s), rng, self.params.jitter_s, self.params.jitter_smooth_s)
        gate = standing + (1 - standing) * self.trunk.going
        return sigma_rad * gate[:, None] * self.fine(noise)

    def held_yaw(self, rng: np.random.Generator) -> FloatArray:
        """(n,) yaw of the top edge in the building."""
        offset = smooth(held_yaw_rad(self.coarse_s, rng), PATH_SMOOTH_S)
        return np.asarray(self.heading_rad - np.pi / 2 + self.fine(offset))


PhonePose = tuple[FloatArray, FloatArray]  # (n, 3) ahead, left, up of the body's path; (n, 4) attitude


def in_hand(body: BodyMotion, rng: np.random.Generator) -> PhonePose:
    """Held before the body, screen up, top edge ahead; the wrist gives way to the ups and downs."""
    params, trunk = body.params, body.trunk
    personal, jitter, yaw, heels = rng.spawn(4)
    drawn = personal.standard_normal(3)
    shaken_m, shaken_rad = _shaking(body, heels, (*params.shake_mps2, *params.shake_radps))
    sigma_rad = personal.uniform(*params.jitter_rad)
    yields = params.hand_yield_rad_per_mps2 * math.exp(params.hand_yield_log_sigma * drawn[0])
    shake = body.jitter(jitter, sigma_rad, params.jitter_standing) + shaken_rad
    tilt = _drawn(params.hand_tilt_rad, drawn[1]) - yields * trunk.nod_mps2 + shake[:, 0]
    lean = _drawn(params.hand_lean_rad, drawn[2]) + shake[:, 1]
    turn = params.hand_turn_rad * trunk.going * np.sin(np.pi * trunk.step) + shake[:, 2]
    offset = np.column_stack(
        [trunk.ahead_m + params.hand_ahead_m, trunk.left_m, trunk.up_m + params.hand_height * body.height_m]
    )
    offset += shaken_m
    return offset, from_yaw_pitch_roll(body.held_yaw(yaw) + turn, lean, tilt)


def in_pocket(body: BodyMotion, rng: np.random.Generator) -> PhonePose:
    """In a front trouser pocket: it swings with the thigh about the hip and feels the heels."""
    params, trunk = body.params, body.trunk
    personal, jitter, blows, yaw, shocks, rattles = rng.spawn(6)
    is_left = bool(personal.integers(2))
    upside_down, inwards = personal.integers(2, size=2)
    drawn = personal.standard_normal(5)
    below_m = personal.uniform(*params.pocket_below_hip_m)
    before_m = personal.uniform(*params.pocket_ahead_m)
    stride = np.pi * trunk.step if is_left else np.pi * (trunk.step - 1)  # 0 when the body is over the pocket's foot
    walking_rad = _drawn(params.thigh_rad, drawn[0])
    swing = (walking_rad + trunk.running * (params.thigh_run_rad - walking_rad)) * trunk.going
    # Most flexed shortly before its heel comes down, a third of a stride before the body is over the foot.
    thigh = swing * (0.15 + np.cos(stride + 1.9) + params.thigh_second * np.cos(2 * stride + 1.0 + 0.4 * drawn[1]))
    blow_m = _heel_blows(body, blows, is_left, max(_drawn(params.heel_mps2, drawn[2]), 1.0))
    third = (
        _drawn(params.pocket_third_mps2, drawn[4])
        * trunk.strength
        * trunk.per_rate2
        / 1.5**2
        * np.cos(3 * stride + personal.uniform(-1, 1))
    )
    side = 1.0 if is_left else -1.0
    offset = np.column_stack(
        [
            trunk.ahead_m + below_m * np.sin(thigh) + before_m * np.cos(thigh),
            trunk.left_m + side * params.pocket_aside_m,
            params.pocket_rise * trunk.up_m
            + blow_m
            - third
            + params.hip_height * body.height_m
            - below_m * np.cos(thigh)
            + before_m * np.sin(thigh),
        ]
    )
    offset += _shaking(body, shocks, (*params.pocket_shake_mps2, 0.0, 0.0, 0.0))[0]
    if params.rattle_mps2:
        offset += _rattling(body, rattles, is_left)
    loose = body.jitter(jitter, params.pocket_loose_rad, 0.1)
    # Upright, screen away from the body: x to the left of the walker; then turned as it was slipped in.
    facing = body.heading_rad + 0.5 * (body.held_yaw(yaw) - body.heading_rad + np.pi / 2) + loose[:, 2]
    upright = from_yaw_pitch_roll(facing + np.pi / 2, 0.1 * drawn[3] + loose[:, 1], np.pi / 2 - thigh + loose[:, 0])
    slipped_in = from_yaw_pitch_roll(*np.array([[np.pi * upside_down], [np.pi * inwards], [0.0]]))[0]
    return offset, multiply(upright, slipped_in)


def at_ear(body: BodyMotion, rng: np.random.Generator) -> PhonePose:
    """Held to one ear: upright beside the head, which follows the trunk and keeps level."""
    params, trunk = body.params, body.trunk
    personal, jitter, yaw, heels = rng.spawn(4)
    side = 1.0 if personal.integers(2) else -1.0
    drawn = personal.standard_normal(2)
    shaken_m, shaken_rad = _shaking(body, heels, _times((*params.shake_mps2, *params.shake_radps), params.ear_shakes))
    shake = body.jitter(jitter, params.jitter_rad[0], params.jitter_standing) + shaken_rad
    offset = shaken_m + np.column_stack(
        [trunk.ahead_m + 0.03, trunk.left_m + 0.09 * side, trunk.up_m + params.ear_height * body.height_m]
    )
    # The screen looks at the ear: away from the side; the top edge leans back.
    facing = body.held_yaw(yaw) + side * np.pi / 2 + shake[:, 2]
    lean = side * (0.6 + 0.15 * drawn[0]) + shake[:, 1]
    return offset, multiply(
        from_yaw_pitch_roll(facing, np.zeros(len(facing)), np.full(len(facing), np.pi / 2) + shake[:, 0]),
        from_yaw_pitch_roll(lean, np.zeros(len(facing)), np.zeros(len(facing))),
    )


def in_swinging_arm(body: BodyMotion, rng: np.random.Generator) -> PhonePose:
    """In a hand that hangs down: the arm swings against the leg of its side."""
    params, trunk = body.params, body.trunk
    personal, jitter, yaw, heels = rng.spawn(4)
    is_left = bool(personal.integers(2))
    drawn = personal.standard_normal(2)
    shaken_m, shaken_rad = _shaking(body, heels, _times((*params.shake_mps2, *params.shake_radps), params.arm_shakes))
    stride = np.pi * trunk.step if is_left else np.pi * (trunk.step - 1)
    arm = max(_drawn(params.arm_rad, drawn[0]), 0.05) * (1 + trunk.running) * trunk.going * (0.3 - np.cos(stride + 1.9))
    shake = body.jitter(jitter, params.jitter_rad[1], params.jitter_standing) + shaken_rad
    offset = shaken_m + np.column_stack(
        [
            trunk.ahead_m + params.arm_m * np.sin(arm),
            trunk.left_m + (0.22 if is_left else -0.22),
            trunk.up_m + params.shoulder_height * body.height_m - params.arm_m * np.cos(arm),
        ]
    )
    # The top edge points ahead and down, the screen to the body.
    facing = body.held_yaw(yaw) + shake[:, 2]
    tilt = arm - 0.6 + 0.2 * drawn[1] + shake[:, 0]
    inwards = np.full(len(facing), 1.3 if is_left else -1.3) + shake[:, 1]
    turned = multiply(from_yaw_pitch_roll(facing, 0 * tilt, tilt), from_yaw_pitch_roll(0 * tilt, inwards, 0 * tilt))
    return offset, turned


def in_bag(body: BodyMotion, rng: np.random.Generator) -> PhonePose:
    """In a bag over one shoulder: a damped pendulum on an elastic strap; the phone lies in it as it was dropped."""
    params, bag, trunk = body.params, body.params.bag, body.trunk
    personal, turning, knocks = rng.spawn(3)
    side = 1.0 if personal.integers(2) else -1.0
    hang_m, damping = personal.uniform(*bag.hang_m), personal.uniform(*bag.swing_damping)
    strap_hz, strap_damping = personal.uniform(*bag.strap_hz), personal.uniform(*bag.strap_damping)
    rate_hz = body.rate_hz
    pull_mps2 = np.column_stack(
        [
            np.gradient(body.speed_mps) * rate_hz + second_difference(trunk.ahead_m, rate_hz),
            body.speed_mps * np.gradient(body.heading_rad) * rate_hz + second_difference(trunk.left_m, rate_hz),
        ]
    )
    pitch, roll = (pendulum_rad(pull, hang_m, damping, rate_hz) for pull in pull_mps2.T)
    up_m = stretched_m(trunk.up_m, strap_hz, strap_damping, rate_hz)
    offset = np.column_stack(
        [
            trunk.ahead_m + hang_m * np.sin(pitch),
            trunk.left_m + side * bag.aside_m + hang_m * np.sin(roll),
            up_m + params.shoulder_height * body.height_m - hang_m * np.cos(pitch) * np.cos(roll),
        ]
    )
    offset += _knocks(body, knocks)
    noise = smooth_noise(len(body.coarse_s), turning, bag.turn_s, params.jitter_smooth_s)
    loose = bag.turn_rad * body.fine(noise)
    hung = from_yaw_pitch_roll(body.heading_rad - np.pi / 2 + loose[:, 2], roll, pitch)
    dropped_in = from_yaw_pitch_roll(*personal.uniform(-np.pi, np.pi, (3, 1)))[0]
    return offset, multiply(hung, dropped_in)


def on_cart(body: BodyMotion, rng: np.random.Generator) -> PhonePose:
    """On the handle of a cart or a stroller that is pushed: no steps, but wheels, joints and steering."""
    params, cart, trunk = body.params, body.params.cart, body.trunk
    personal, wheels, steering = rng.spawn(3)
    tilt_rad, push_mps2 = personal.uniform(*cart.tilt_rad), personal.uniform(*cart.push_mps2)
    askew_rad = 0.1 * personal.standard_normal()
    height_m, pitch_rad = wheel_vibration_m(body.speed_mps, wheels, cart, body.rate_hz)
    push_m = -push_mps2 * trunk.going * trunk.per_rate2 * np.cos(2 * np.pi * trunk.step)
    offset = np.column_stack([cart.ahead_m + push_m, np.zeros(len(push_m)), cart.handle_m + height_m])
    noise = smooth_noise(len(body.coarse_s), steering, cart.steer_s, params.jitter_smooth_s)
    steer = cart.steer_rad * trunk.going * body.fine(noise)[:, 2]
    yaw = body.heading_rad - np.pi / 2 + askew_rad + steer
    return offset, from_yaw_pitch_roll(yaw, np.zeros(len(yaw)), tilt_rad + pitch_rad)


@dataclass(frozen=True, slots=True)
class CarryPlace:
    """One way of carrying a phone."""

    move: Callable[[BodyMotion, np.random.Generator], PhonePose]  # turns the motion of the body into that of the phone
    variation: float  # part of the variation between steps that arrives; most of it is the hand's
    overtones: float  # part of the harmonics of the rise that arrives; in part they are the arm's


PLACES: Final[Mapping[str, CarryPlace]] = MappingProxyType(
    {
        "hand": CarryPlace(in_hand, 1.0, 1.0),  # [M] what parameters are fitted to
        "pocket": CarryPlace(in_pocket, 0.35, 0.45),  # [M]
        "ear": CarryPlace(at_ear, 0.6, 0.6),  # ours
        "swing": CarryPlace(in_swinging_arm, 0.6, 0.6),  # ours
        "bag": CarryPlace(in_bag, 0.5, 0.8),  # ours
        "cart": CarryPlace(on_cart, 0.0, 0.0),  # no step of the body arrives
    }
)


def _times(sizes: tuple[float, ...], factor: float) -> tuple[float, ...]:
    return tuple(factor * size for size in sizes)


def _drawn(law: tuple[float, float], standard: float) -> float:
    return law[0] + law[1] * float(np.clip(standard, -2, 2))


def _bursts(
    body: BodyMotion, late_s: float, width_s: float, size: FloatArray, rate_hz: FloatArray, phase_rad: FloatArray
) -> FloatArray:
    """(n, c) bursts, one after every heel strike: size cos(2 pi f t + phase) under a Gaussian envelope.

    Args:
        body: Its heel strikes.
        late_s: From the strike to the middle of the envelope.
        width_s: Standard deviation of the envelope.
        size: (k, c).
        rate_hz: (k,) frequency f.
        phase_rad: (k, c).
    """
    fine_hz = body.rate_hz
    middle_s = body.heel_s + late_s - body.t_s[0]
    reach = math.ceil(5 * width_s * fine_hz)
    index = np.round(middle_s * fine_hz).astype(np.int64)[:, None] + np.arange(-reach, reach + 1)
    since_s = index / fine_hz - middle_s[:, None]
    envelope = np.exp(-((since_s / width_s) ** 2) / 2)
    angle = 2 * np.pi * rate_hz[:, None] * since_s
    cos, sin = envelope * np.cos(angle), envelope * np.sin(angle)
    inside = (index >= 0) & (index < len(body.t_s))
    where = index[inside]
    bursts = [
        np.bincount(where, (cos * a[:, None] - sin * b[:, None])[inside], minlength=len(body.t_s))
        for a, b in zip((size * np.cos(phase_rad)).T, (size * np.sin(phase_rad)).T, strict=True)
    ]
    return np.column_stack(bursts)


def _shaking(body: BodyMotion, rng: np.random.Generator, sizes: tuple[float, ...]) -> tuple[FloatArray, FloatArray]:
    """How a phone shakes after heel strikes: (n, 3) displacement ahead, left, up; (n, 3) turns about x, y, z.

    Sizes (6,) are amplitudes, of accelerations in m/s2 and of rates in rad/s, at an ordinary walk.
    """
    params, count = body.params, len(body.heel_s)
    mean_hz, sigma_hz = params.shake_hz
    rate_hz = np.clip(mean_hz + sigma_hz * rng.standard_normal(count), 0.5 * mean_hz, 2 * mean_hz)
    omega = 2 * np.pi * rate_hz[:, None]
    full = np.array(sizes) * np.hstack([omega**-2] * 3 + [omega**-1] * 3)
    steady = params.shake_steady
    size = full * (steady + (1 - steady) * rng.standard_normal((count, 6))) * body.heel_strength[:, None]
    phase_rad = 2 * np.pi * (1 - steady) * rng.random((count, 6))
    if steady:
        phase_rad += 2 * np.pi * rng.random(6)
    bursts = _bursts(body, 2 * params.shake_s, params.shake_s, size, rate_hz, phase_rad)
    return bursts[:, :3], bursts[:, 3:]


def _heel_blows(body: BodyMotion, rng: np.random.Generator, is_left: bool, amplitude_mps2: float) -> FloatArray:
    """(n,) displacement of the blows of the heels: Gaussian dents, whose acceleration peaks at the amplitude."""
    params, count = body.params, len(body.heel_s)
    size = amplitude_mps2 * np.exp(params.heel_log_sigma * rng.standard_normal(count)) * body.heel_strength
    size *= np.where(body.heel_is_left == is_left, 1.0, params.heel_other)
    dent_m = -size[:, None] * params.heel_s**2
    return _bursts(
        body, float(rng.uniform(*params.heel_late_s)), params.heel_s, dent_m, np.zeros(count), np.zeros((count, 1))
    )[:, 0]


def _rattling(body: BodyMotion, rng: np.random.Generator, is_left: bool) -> FloatArray:
    """(n, 3) displacement of a phone that rings in its pocket after the blow of a heel; most at its own side's."""
    params, count = body.params, len(body.heel_s)
    rate_hz = np.full(count, rng.uniform(*params.rattle_hz))
    ahead = rng.uniform(0.2, 0.7)
    size_mps2 = params.rattle_mps2 * np.exp(params.heel_log_sigma * rng.standard_normal(count)) * body.heel_strength
    size_mps2 *= np.where(body.heel_is_left == is_left, 1.0, params.heel_other)
    size_m = (size_mps2 / (2 * np.pi * rate_hz) ** 2)[:, None] * [ahead, 0.0, -1.0]
    phase_rad = 0.4 * rng.standard_normal((count, 1)) * np.ones(3)
    return _bursts(body, float(rng.uniform(*params.heel_late_s)), params.rattle_s, size_m, rate_hz, phase_rad)


def _knocks(body: BodyMotion, rng: np.random.Generator) -> FloatArray:
    """(n, 3) displacement of a phone that other things in a bag strike after heel strikes."""
    bag, count = body.params.bag, len(body.heel_s)
    rate_hz = rng.uniform(*bag.knock_hz, count)
    steps = np.exp(bag.knock_log_sigma * np.clip(rng.standard_normal(count), -2, 2))
    size = bag.knock_mps2 * steps * body.heel_strength
    ways = rng.standard_normal((count, 3)) / math.sqrt(3)
    phase_rad = 2 * np.pi * rng.random((count, 1)) * np.ones(3)
    return _bursts(body, 0.1, 0.04, ways * (size / (2 * np.pi * rate_hz) ** 2)[:, None], rate_hz, phase_rad)
