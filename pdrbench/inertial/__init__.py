"""Toolbox for inertial sensors: pure functions on arrays, and detectors that carry their state between observations."""

from __future__ import annotations

from pdrbench.inertial.attitude import phone_heading_rad
from pdrbench.inertial.steps import PeakStepDetector

__all__ = ["PeakStepDetector", "phone_heading_rad"]
