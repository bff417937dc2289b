"""A phone carried by a walking person: its pose at every moment (sources.md 1.4)."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Final

import numpy as np

from pdrbench.errors import unknown_name
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.inertial.quaternions import multiply
from pdrbench_sim.people.strides import LEFT, Stances
from pdrbench_sim.people.walk import SimulatedWalk, body_path
from pdrbench_sim.phone.carry import PLACES, BodyMotion, CarryParams, PhonePose
from pdrbench_sim.phone.gait import (
    CLOSING_S,
    COARSE_HZ,
    PATH_SMOOTH_S,
    GaitMotionParams,
    ease,
    gait_of,
    smooth,
    trunk_of,
)
from pdrbench_sim.units.motion import MotionError, RigidMotion

SWITCH_S: Final = 1.0  # that a phone takes from one place to the next
FLAT_S: Final = 0.08  # from the strike of a heel until its foot rests (sources.md 1.3)


def phone_motion(
    walk: SimulatedWalk,
    feet: tuple[Stances, Stances],
    rng: np.random.Generator,
    *,
    carry: Sequence[tuple[float, str]] = ((0.0, "hand"),),
    rate_hz: float = 200.0,
    gait: GaitMotionParams | None = None,
    carried: CarryParams | None = None,
) -> RigidMotion:
    """The pose of a phone from the beginning of a walk to its end.

    Args:
        walk: Where the body is.
        feet: Rests of the left and of the right foot, to which the ups and downs are locked.
        rng: What is personal, and what differs from walk to walk and from step to step.
        carry: Since when the phone is carried where, by a name of `PLACES`, in order of time. A switch is half done at
            its time and takes `SWITCH_S`.
        rate_hz: Of the samples.
        gait: How the trunk moves; None for the defaults.
        carried: How phones are carried; None for the defaults.

    Raises:
        UnknownNameError: There is no such place to carry a phone.
        MotionError: No place, or switches nearer to each other than `SWITCH_S`.
    """
    from scipy.interpolate import CubicSpline

    _check_carry(carry)
    carried = carried or CarryParams()
    oscillation, _, *own = rng.spawn(2 + len(PLACES))
    streams = dict(zip(PLACES, own, strict=True))
    path = body_path(walk, COARSE_HZ)
    coarse_gait = gait_of(walk, feet, path)
    t_s = np.arange(math.floor(walk.end_s * rate_hz) + 1) / rate_hz  # splines reach the one coarse sample beyond
    even = smooth(np.column_stack([path.xy_m, path.z_m, path.heading_rad]), PATH_SMOOTH_S)
    x_m, y_m, z_m, heading_rad = CubicSpline(path.t_s, even)(t_s).T
    heel_s, heel_is_left = _heel_strikes(walk, feet)
    places = {}
    for name in dict.fromkeys(name for _, name in carry):
        # Everywhere the same steps, which differ in how much of their variation arrives.
        place = PLACES[name]
        trunk = trunk_of(
            coarse_gait,
            t_s,
            copy.deepcopy(oscillation),
            gait or GaitMotionParams(),
            variation=place.variation,
            overtones=place.overtones,
        )
        body = BodyMotion(
            t_s=t_s,
            coarse_s=path.t_s,
            heading_rad=heading_rad,
            speed_mps=np.hypot(np.gradient(x_m), np.gradient(y_m)) * rate_hz,
            trunk=trunk,
            heel_s=heel_s,
            heel_is_left=heel_is_left,
            heel_strength=np.interp(heel_s, t_s, trunk.strength) ** carried.heel_power,
            height_m=walk.person.height_m,
            params=carried,
        )
        places[name] = place.move(body, streams[name])
    (ahead_m, left_m, up_m), quaternion = _switched(t_s, carry, places)
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    xyz_m = np.column_stack([x_m + cos * ahead_m - sin * left_m, y_m + sin * ahead_m + cos * left_m, z_m + up_m])
    return RigidMotion(t_s, xyz_m, _continuous(quaternion))


def _check_carry(carry: Sequence[tuple[float, str]]) -> None:
    if not carry:
        raise MotionError('a phone is carried somewhere: give carry=((0.0, "hand"),)')
    for _, name in carry:
        if name not in PLACES:
            raise unknown_name("place to carry a phone", name, PLACES)
    for (one_s, _), (other_s, name) in pairwise(carry):
        if not other_s - one_s >= SWITCH_S:
            raise MotionError(
                f"the phone goes to {name!r} at {other_s:g} s, less than {SWITCH_S:g} s after {one_s:g} s; "
                "a switch takes that long: list them in order, further apart"
            )


def _heel_strikes(walk: SimulatedWalk, feet: tuple[Stances, Stances]) -> tuple[FloatArray, BoolArray]:
    """When a heel comes down, shortly before its foot rests, and whether it is the left one."""
    at_s, of_left = [], []
    for side, foot in enumerate(feet):
        for bout in walk.bouts:
            own = (foot.mid_s > bout.t_s[0]) & (foot.mid_s <= bout.t_s[-1] + CLOSING_S)
            at_s.append(foot.begin_s[own] - FLAT_S)
            of_left.append(np.full(int(own.sum()), side == LEFT))
    when_s, is_left = np.concatenate(at_s), np.concatenate(of_left)
    order = np.argsort(when_s, kind="stable")
    return when_s[order], is_left[order]


def _switched(
    t_s: FloatArray, carry: Sequence[tuple[float, str]], places: dict[str, PhonePose]
) -> tuple[FloatArray, FloatArray]:
    """(3, n) displacement and (n, 4) attitude of a phone that goes from place to place."""
    offset, quaternion = (values.copy() for values in places[carry[0][1]])
    for (_, before), (at_s, name) in pairwise(carry):
        if before == name:
            continue
        next_offset, next_quaternion = places[name]
        during = slice(*np.searchsorted(t_s, [at_s - SWITCH_S / 2, at_s + SWITCH_S / 2]))
        fraction = ease((t_s[during] - at_s) / SWITCH_S + 0.5)
        offset[during] += fraction[:, None] * (next_offset[during] - offset[during])
        quaternion[during] = _between(quaternion[during], next_quaternion[during], fraction)
        offset[during.stop :], quaternion[during.stop :] = next_offset[during.stop :], next_quaternion[during.stop :]
    return offset.T, quaternion


def _between(one: FloatArray, other: FloatArray, fraction: FloatArray) -> FloatArray:
    """(n, 4) from the first attitude to the second along the short way, as it is in the middle."""
    if not len(fraction):
        return one
    apart = _continuous(multiply(one * [1.0, -1.0, -1.0, -1.0], other))
    apart *= 1.0 if apart[len(apart) // 2, 0] >= 0 else -1.0
    length = np.linalg.norm(apart[:, 1:], axis=1)
    angle = np.arctan2(length, apart[:, 0]) * fraction
    axis = apart[:, 1:] / np.maximum(length, 1e-12)[:, None]
    return multiply(one, np.column_stack([np.cos(angle), axis * np.sin(angle)[:, None]]))


def _continuous(quaternion: FloatArray) -> FloatArray:
    """(n, 4) with signs such that neighbours are near each other."""
    flips = np.where(np.einsum("ij,ij->i", quaternion[1:], quaternion[:-1]) < 0, -1.0, 1.0)
    return np.asarray(quaternion * np.concatenate([[1.0], np.cumprod(flips)])[:, None])
