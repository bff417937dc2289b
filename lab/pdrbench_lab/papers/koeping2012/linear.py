"""The straight walk of 14 m of Köping et al. 2012 with a simulated ADIS16405, integrated twice (K10).

The paper does not say where the unit was. Its Fig. 4 shows a distance found from accelerations that subtracting a
constant made usable. That is possible only if the unit kept its attitude: tilting by one degree moves 0.17 m/s2 of
gravity into the axis ahead, which in half a minute makes 80 m. A unit on a shoe turns by 90 degrees in every stride,
one held in the hand by several. So here the unit stands on a cart that a walker pushes; it takes part in the surge of
every step, and is tilted by a constant as it was put down. The same walk is also made with the unit in the hand and
with the unit on the shoe, for comparison.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline
from scipy.ndimage import binary_opening, uniform_filter1d

from pdrbench.building import Building
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.inertial import LITERAL, navigate
from pdrbench.inertial.quaternions import from_yaw_pitch_roll, inverse, to_world
from pdrbench_sim.buildings.assembly import Cell, assemble, rectangle
from pdrbench_sim.foot.foot import foot_motion
from pdrbench_sim.people.person import draw_person
from pdrbench_sim.people.route import Place, navigation_mesh
from pdrbench_sim.people.strides import NATURAL_GAIT, Stances, stances
from pdrbench_sim.people.walk import SimulatedWalk, body_path
from pdrbench_sim.people.walker import NATURAL_WALK, walk_through
from pdrbench_sim.phone.gait import COARSE_HZ, PATH_SMOOTH_S, GaitMotionParams, gait_of, smooth, trunk_of
from pdrbench_sim.phone.phone import phone_motion
from pdrbench_sim.units.device import draw_unit
from pdrbench_sim.units.motion import RigidMotion
from pdrbench_sim.units.profiles import imu_profile

STOPS_M: Final = (0.0, 4.0, 9.0, 14.0)  # [P] K10
PAUSE_S: Final = 6.0  # [P] K10
REST_S: Final = 10.0  # before the walk, from which the bias is known; ours
END_S: Final = 2.0  # of rest after the walk; ours
INTERNAL_HZ: Final = 500.0  # of ideal signals
TILT_RAD: Final = math.radians(2.0)  # of the unit on the cart, each axis, sigma; ours
STILL_S: Final = 0.5  # window in which the acceleration has to be still; ours
STILL_RATIO: Final = 1.4  # its spread over that of the rest before the walk, at most: four sigma of 51 samples; ours
ALIGNED: Final = math.cos(math.radians(15.0))  # the axis of a unit that is so near to ahead is taken for it; ours


@dataclass(frozen=True, slots=True, eq=False)
class LinearWalk:
    """One walk and what was found from it.

    Attributes:
        t_s: (n,) from the beginning of the walk.
        true_m: (n,) distance.
        raw_m: (n,) by integrating the acceleration ahead twice.
        corrected_m: (n,) with the constant of the rest before the walk subtracted.
        updated_m: (n,) with velocity set to zero where the unit is still, too.
        in_hand_m: (n,) corrected, with the unit in the hand.
        on_foot_m: At the end, with the unit on the shoe and the zero-velocity updates of `pdrbench.inertial`.
    """

    t_s: FloatArray
    true_m: FloatArray
    raw_m: FloatArray
    corrected_m: FloatArray
    updated_m: FloatArray
    in_hand_m: FloatArray
    on_foot_m: float

    def end_error_m(self, name: str) -> float:
        """How far the distance of that name is off at the end."""
        return abs(float(np.atleast_1d(getattr(self, name))[-1]) - STOPS_M[-1])


def linear_walk(rng: np.random.Generator) -> LinearWalk:
    """Walks 14 m with pauses after 4 m and 9 m, pushing the cart, then with the unit in the hand and on the shoe."""
    person_rng, walk_rng, feet_rng, surge_rng, cart_rng, hand_rng, foot_rng = rng.spawn(7)
    walk = _walk(person_rng, walk_rng)
    feet = stances(walk, feet_rng, NATURAL_GAIT)
    t_s, ahead, is_still = _measured(_on_cart(walk, feet, surge_rng), cart_rng)
    hand_s, in_hand, _ = _measured(phone_motion(walk, feet, hand_rng, rate_hz=INTERNAL_HZ), hand_rng)
    path = body_path(walk, COARSE_HZ)
    bias = float(ahead[t_s < 0.0].mean())
    walking = t_s[t_s >= 0.0]
    return LinearWalk(
        t_s=walking,
        true_m=np.interp(walking, path.t_s, path.xy_m[:, 0]),
        raw_m=_twice(t_s, ahead),
        corrected_m=_twice(t_s, ahead - bias),
        updated_m=_twice(t_s, ahead - bias, is_still),
        in_hand_m=_twice(hand_s, in_hand - float(in_hand[hand_s < 0.0].mean())),
        on_foot_m=_on_foot_m(walk.building, feet[0], walk.end_s, foot_rng),
    )


def corridor() -> Building:
    """20 m along x, 2.4 m wide."""
    return Building("corridor", assemble([Cell("corridor", rectangle(-3.0, -1.2, 17.0, 1.2), 0.0, 0)], []))


def _walk(person_rng: np.random.Generator, rng: np.random.Generator) -> SimulatedWalk:
    params = replace(
        NATURAL_WALK,
        pause_median_s=PAUSE_S,
        pause_log_sigma=0.05,  # "about 6 seconds"
        pause_every_s=1e9,
        u_turn_fraction=0.0,
        sway_sigma_m=0.02,
        keep_right_m=(0.0, 0.0),
    )
    places = [Place(0, np.array([x_m, 0.0])) for x_m in STOPS_M]
    return walk_through(rng, navigation_mesh(corridor()), draw_person(person_rng), places, params)


def _on_cart(walk: SimulatedWalk, feet: tuple[Stances, Stances], rng: np.random.Generator) -> RigidMotion:
    """A unit on a cart: it moves ahead as the trunk of the walker does, at one height and in one attitude."""
    for_trunk, for_tilt = rng.spawn(2)
    path = body_path(walk, COARSE_HZ)
    t_s = np.arange(math.floor(walk.end_s * INTERNAL_HZ) + 1) / INTERNAL_HZ
    even_m = CubicSpline(path.t_s, smooth(path.xy_m, PATH_SMOOTH_S))(t_s)
    trunk = trunk_of(gait_of(walk, feet, path), t_s, for_trunk, GaitMotionParams())
    xyz_m = np.column_stack([even_m[:, 0] + trunk.ahead_m, even_m[:, 1], np.full(len(t_s), 0.8)])
    attitude = from_yaw_pitch_roll(*(TILT_RAD * for_tilt.standard_normal((3, 1))))
    return RigidMotion(t_s, xyz_m, np.repeat(attitude, len(t_s), axis=0))


def _measured(motion: RigidMotion, rng: np.random.Generator) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Times, acceleration along the axis of the unit that points ahead at first, and whether the unit is still."""
    for_unit, for_noise = rng.spawn(2)
    unit = draw_unit(imu_profile("adis16405"), for_unit)
    rested = _with_rests(motion)
    t_s, accel, _ = unit.measure(rested.t_s, *rested.ideal_signals(), for_noise)
    into_body = inverse(rested.quaternion[:1])
    pointing = to_world(into_body, np.array([[1.0, 0.0, 0.0]]))[0]
    nearest = np.eye(3)[int(np.argmax(np.abs(pointing)))]
    ahead = accel @ (nearest * np.sign(pointing @ nearest) if abs(pointing @ nearest) > ALIGNED else pointing)
    width = round(STILL_S * unit.profile.rate_hz)
    mean = uniform_filter1d(ahead, width)
    spread = np.sqrt(np.maximum(uniform_filter1d(ahead**2, width) - mean**2, 0.0))
    resting = spread[t_s < -STILL_S]
    is_still = spread < STILL_RATIO * float(np.median(resting))
    # A moment between two pushes is not stillness.
    return t_s, ahead, binary_opening(is_still, np.ones(width, dtype=np.bool_))


def _with_rests(motion: RigidMotion) -> RigidMotion:
    """The motion with rests in its first and in its last pose; the first one before t = 0."""
    before, after = (round(rest_s * motion.rate_hz) for rest_s in (REST_S, END_S))
    t_s = np.arange(-before, len(motion) + after) / motion.rate_hz
    xyz_m, quaternion = (
        np.concatenate([np.repeat(values[:1], before, axis=0), values, np.repeat(values[-1:], after, axis=0)])
        for values in (motion.xyz_m, motion.quaternion)
    )
    return RigidMotion(t_s, xyz_m, quaternion)


def _twice(t_s: FloatArray, accel: FloatArray, is_still: BoolArray | None = None) -> FloatArray:
    """Distances from t = 0 on: the acceleration integrated twice, with no velocity where the unit is still."""
    walking = t_s >= 0.0
    speed_mps: FloatArray = cumulative_trapezoid(accel[walking], t_s[walking], initial=0)
    if is_still is not None:
        still = is_still[walking]
        last = np.maximum.accumulate(np.where(still, np.arange(len(still)), 0))
        speed_mps = speed_mps - speed_mps[last]
    distance_m: FloatArray = cumulative_trapezoid(speed_mps, t_s[walking], initial=0)
    return distance_m


def _on_foot_m(building: Building, rests: Stances, end_s: float, rng: np.random.Generator) -> float:
    """Distance at the end, found by a unit on the shoe with zero-velocity updates."""
    for_motion, for_unit, for_noise = rng.spawn(3)
    motion = _with_rests(foot_motion(building, rests, for_motion, end_s=end_s, rate_hz=INTERNAL_HZ))
    unit = draw_unit(imu_profile("adis16405"), for_unit)
    t_s, accel, gyro = unit.measure(motion.t_s, *motion.ideal_signals(), for_noise)
    gyro = gyro - gyro[t_s < 0.0].mean(axis=0)
    states = navigate(t_s, accel, gyro, LITERAL)
    known = states.position_m[np.isfinite(states.x[:, 0]), :2]
    walked_m = float(np.hypot(*(known[-1] - known[0])))
    return walked_m * STOPS_M[-1] / float(np.hypot(*(rests.xy_m[-1] - rests.xy_m[0])))
