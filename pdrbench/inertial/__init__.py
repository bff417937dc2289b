"""Toolbox for inertial sensors: pure functions on arrays, and detectors and filters that carry their state.

What is named here stays as it is within a major version; the modules below it may change. Arrays count samples first;
units are SI, attitudes unit quaternions wxyz from body to world (see `quaternions`).
"""

from __future__ import annotations

from pdrbench.inertial.checks import check_units, clean_rows
from pdrbench.inertial.foot_filter import LITERAL, FootFilter, FootParams, FootStates, concatenate
from pdrbench.inertial.magnetometer import FieldParams
from pdrbench.inertial.navigate import navigate, navigate_smoothed
from pdrbench.inertial.pairing import SamplePairs
from pdrbench.inertial.phone_attitude import PhoneAttitude, PhoneAttitudeParams
from pdrbench.inertial.quaternions import from_yaw_pitch_roll, inverse, multiply, phone_heading_rad, to_world
from pdrbench.inertial.step_detection import GENTLE, STAGES, StepDetector, StepParams, Steps, find_steps
from pdrbench.inertial.steps import PeakStepDetector
from pdrbench.inertial.strides import StrideParams, Strides, StrideSegmenter, find_strides
from pdrbench.inertial.vertical import WAYS, LevelChange, LevelTracker, VerticalParams, level_heights
from pdrbench.inertial.zero_velocity import DETECTORS, Detector, Rest, RestDetector, detect

__all__ = [
    "DETECTORS",
    "GENTLE",
    "LITERAL",
    "STAGES",
    "WAYS",
    "Detector",
    "FieldParams",
    "FootFilter",
    "FootParams",
    "FootStates",
    "LevelChange",
    "LevelTracker",
    "PeakStepDetector",
    "PhoneAttitude",
    "PhoneAttitudeParams",
    "Rest",
    "RestDetector",
    "SamplePairs",
    "StepDetector",
    "StepParams",
    "Steps",
    "StrideParams",
    "StrideSegmenter",
    "Strides",
    "VerticalParams",
    "check_units",
    "clean_rows",
    "concatenate",
    "detect",
    "find_steps",
    "find_strides",
    "from_yaw_pitch_roll",
    "inverse",
    "level_heights",
    "multiply",
    "navigate",
    "navigate_smoothed",
    "phone_heading_rad",
    "to_world",
]
