"""Compiles every kernel of foot-mounted navigation, or loads it from the cache of compiled code."""

from __future__ import annotations

from pdrbench.inertial.foot_filter import ADAPTIVE, LITERAL
from pdrbench.inertial.foot_motion import walk
from pdrbench.inertial.navigate import navigate, navigate_many, navigate_smoothed
from pdrbench.inertial.zero_velocity import DETECTORS, detect


def warm_up() -> None:
    """Runs every kernel once on a second or two of a foot that rests and walks."""
    motion = walk(1, still_s=0.5)
    measured = (motion.t_s, motion.accel, motion.gyro)
    for detector in DETECTORS.values():
        detect(*measured, detector)
    for params in (LITERAL, ADAPTIVE):
        navigate(*measured, params)
        navigate_smoothed(*measured, params)
        navigate_many([measured], params)
