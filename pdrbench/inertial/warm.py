"""Compiles every kernel of foot-mounted navigation and of step detection, or loads it from the cache."""

from __future__ import annotations

import numpy as np

from pdrbench.inertial.foot_filter import FOOT, LITERAL
from pdrbench.inertial.navigate import navigate, navigate_smoothed
from pdrbench.inertial.phone_attitude import PhoneAttitude
from pdrbench.inertial.step_detection import find_steps
from pdrbench.inertial.zero_velocity import DETECTORS, detect

WARM_UPS = {"pdrbench.inertial": "pdrbench.inertial.warm:warm_up"}


def warm_up() -> None:
    """Runs every kernel once on a second of a foot that rests and swings, and on a few steps of a phone."""
    t_s = np.arange(0.0, 1.0, 0.005)
    swing = np.where(t_s < 0.5, 0.0, np.sin(4 * np.pi * t_s))
    measured = (t_s, np.array([0.0, 0.0, 9.81]) + swing[:, None], np.outer(swing, [0.0, 3.0, 0.0]))
    for detector in DETECTORS.values():
        detect(*measured, detector)
    for params in (LITERAL, FOOT):
        navigate(*measured, params)
        navigate_smoothed(*measured, params)
    t_s = np.arange(0.0, 5.0, 0.02)
    length = 9.81 + 3.0 * np.sin(4 * np.pi * t_s)
    PhoneAttitude().update(np.column_stack([t_s, length, np.zeros((len(t_s), 2))]), np.zeros((len(t_s), 4)))
    find_steps(np.column_stack([t_s, length, np.zeros((len(t_s), 2))]), 50.0)
