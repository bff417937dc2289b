"""A bag that hangs from a shoulder and a cart that is pushed: what they make of the motion of the person with them.

A bag is a damped pendulum under a strap that stretches; its pivot is the shoulder. A cart has no steps but those of the
hands that push it: it shakes with the roughness of the floor and where its wheels cross the joints between tiles.
Everything is linear, causal and driven by smooth motion or by noise that is integrated, so that positions can be
differentiated twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench_sim.units.motion import GRAVITY_MPS2


@dataclass(frozen=True, slots=True)
class BagParams:
    """Bags over a shoulder; pairs are ranges of a uniform draw for each walk. [R] where no line says otherwise."""

    hang_m: tuple[float, float] = (0.35, 0.60)  # from the shoulder to the phone in the bag
    aside_m: float = 0.20  # from the middle of the body
    swing_damping: tuple[float, float] = (0.15, 0.40)  # of the pendulum over the critical one: it rubs at the hip
    strap_hz: tuple[float, float] = (5.0, 9.0)  # at which the bag bounces on its strap
    strap_damping: tuple[float, float] = (0.25, 0.50)  # over the critical one
    turn_rad: float = 0.12  # standard deviation of the yaw of the bag against the body
    turn_s: float = 1.5  # its correlation time
    # Median amplitude with which things in the bag strike the phone after a heel strike at an ordinary walk.
    knock_mps2: float = 2.2  # [M] power between 6 and 25 Hz in the purse of one person
    knock_log_sigma: float = 0.7  # its spread from step to step; ours
    knock_hz: tuple[float, float] = (2.0, 8.0)  # [M] the same


@dataclass(frozen=True, slots=True)
class CartParams:
    """Shopping carts and strollers with a phone on the handle; pairs are ranges of a uniform draw for each walk. [R]"""

    handle_m: float = 1.0  # above the floor
    ahead_m: float = 0.45  # of the body
    tilt_rad: tuple[float, float] = (0.2, 0.9)  # of the top edge, upwards
    # Root mean square of the vertical acceleration by the roughness of the floor, at 1 m/s; it grows with the root of
    # the speed: wheels roll over twice as much floor in half of the time.
    rough_mps2: tuple[float, float] = (0.4, 1.6)
    frame_hz: tuple[float, float] = (8.0, 18.0)  # at which the frame resonates
    frame_damping: tuple[float, float] = (0.10, 0.30)  # over the critical one
    joint_m: tuple[float, float] = (0.30, 1.20)  # between the joints of the tiles
    joint_mps2: tuple[float, float] = (0.0, 2.5)  # peak of the acceleration at a joint
    wheelbase_m: float = 0.6  # from the front wheels to the rear ones, which cross each joint later
    push_mps2: tuple[float, float] = (0.1, 0.4)  # amplitude to and fro at the step rate, as hands push
    steer_rad: float = 0.03  # standard deviation of the yaw against the way, from steering and casters
    steer_s: float = 0.4  # its correlation time


def resonance(driving: FloatArray, hz: float, damping: float, rate_hz: float) -> FloatArray:
    """(n,) response y'' + 2 z w y' + w^2 y = driving (n,), at rest before the first sample.

    Args:
        driving: Acceleration.
        hz: Natural frequency, w = 2 pi hz.
        damping: z, over the critical one.
        rate_hz: Of the samples.
    """
    from scipy.signal import bilinear, lfilter  # takes half a second, and walks without a phone need none of it

    omega = 2 * np.pi * hz
    numerator, denominator = bilinear([1.0], [1.0, 2 * damping * omega, omega**2], rate_hz)
    response: FloatArray = lfilter(numerator, denominator, driving)
    return response


def pendulum_rad(pivot_mps2: FloatArray, hang_m: float, damping: float, rate_hz: float) -> FloatArray:
    """(n,) angle of a pendulum from the vertical, towards where its pivot accelerates to: theta'' + ... = -a / l."""
    natural_hz = float(np.sqrt(GRAVITY_MPS2 / hang_m)) / (2 * np.pi)
    return -resonance(pivot_mps2, natural_hz, damping, rate_hz) / hang_m


def stretched_m(pivot_m: FloatArray, hz: float, damping: float, rate_hz: float) -> FloatArray:
    """(n,) height of a weight on an elastic strap, its rest at 0, whose upper end is at `pivot_m` (n,)."""
    pull = second_difference(pivot_m, rate_hz)
    return np.asarray(pivot_m - resonance(pull, hz, damping, rate_hz))


def second_difference(values: FloatArray, rate_hz: float) -> FloatArray:
    """(n, ...) second derivative of even samples; that of the ends is 0."""
    found = np.zeros_like(values)
    found[1:-1] = (values[2:] - 2 * values[1:-1] + values[:-2]) * rate_hz**2
    return found


def wheel_vibration_m(
    speed_mps: FloatArray, rng: np.random.Generator, params: CartParams, rate_hz: float
) -> tuple[FloatArray, FloatArray]:
    """Height of a cart's frame above its mean, (n,), and the angle by which it pitches, (n,) rad.

    The floor is a random walk along the way, so that its vertical velocity under a wheel is white with a power that
    grows with the speed; front and rear wheels pass over the same floor. Each joint of the tiles adds an impulse. The
    frame passes them as a damped resonance.

    Args:
        speed_mps: (n,) of the cart.
        rng: What differs from walk to walk, and the floor.
        params: Of the cart.
        rate_hz: Of the samples.
    """
    drawn, floor = rng.spawn(2)
    hz, damping = drawn.uniform(*params.frame_hz), drawn.uniform(*params.frame_damping)
    rough_mps2, joint_mps2 = drawn.uniform(*params.rough_mps2), drawn.uniform(*params.joint_mps2)
    joint_m = drawn.uniform(*params.joint_m)
    impulse = np.zeros(round(4 * rate_hz))
    impulse[1] = 1.0
    ring_mps2 = second_difference(_frame_m(impulse, hz, damping, rate_hz), rate_hz)
    way_m = np.cumsum(np.maximum(speed_mps, 0.0)) / rate_hz
    grain = floor.standard_normal((2, len(way_m)))
    rough = rough_mps2 / np.sqrt(np.sum(ring_mps2**2)) * np.sqrt(np.maximum(speed_mps, 0.0))
    size = joint_mps2 / np.abs(ring_mps2).max()
    axles = []
    for axle, behind_m in enumerate((0.0, params.wheelbase_m)):
        crossed = np.diff(np.floor((way_m - behind_m) / joint_m), prepend=np.floor(-behind_m / joint_m)) > 0
        axles.append(_frame_m(rough * grain[axle] + size * crossed, hz, damping, rate_hz))
    front_m, rear_m = axles
    return (front_m + rear_m) / np.sqrt(2), (front_m - rear_m) / params.wheelbase_m


def _frame_m(push: FloatArray, hz: float, damping: float, rate_hz: float) -> FloatArray:
    """(n,) height of a frame for vertical velocities (n,) of the floor under its wheels; slow ones leak away."""
    from scipy.signal import lfilter

    keep = np.exp(-2 * np.pi * 1.0 / rate_hz)  # ours: below 1 Hz a floor is even
    floor_m = lfilter([1 / rate_hz], [1.0, -keep], push)
    return resonance((2 * np.pi * hz) ** 2 * floor_m, hz, damping, rate_hz)
