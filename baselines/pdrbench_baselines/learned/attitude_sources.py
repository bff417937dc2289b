"""Rows of a phone as the network wants them: with an attitude, z up, whose yaw is steady."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.inertial import PhoneAttitude, to_world
from pdrbench.inertial.quaternions import about_vertical, multiply
from pdrbench.localizer import Briefing
from pdrbench_baselines.learned.signals import MIN_RATE_HZ
from pdrbench_baselines.learned.yaw_stabiliser import YawStabiliser

PHONE: Final = "phone"
FOOT: Final = "foot"
# Of the earth's field between steel; magnets of a phone that are not taken out are stronger. Rotation vectors of some
# phones are off by tens of degrees where the field is not; the trust is by seven sets, see the notebook.
USUAL_FIELD_UT: Final = (20.0, 80.0)
FIELD_TRUST: Final = 0.5


class PhoneSource:
    """Rotation vectors with a steady yaw; their frame is that of the building.

    Attributes:
        sensors: That are needed.
        min_rate_hz: At which they are needed.
        turn_rad: From the frame of the attitudes to that of the building; None until the reckoner has found it.
    """

    sensors: Final = ("accel", "gyro", "rotation")
    min_rate_hz: Final = MIN_RATE_HZ
    turn_rad: Final[float | None] = 0.0

    def __init__(self) -> None:
        self._steady, self._north = YawStabiliser(), 0j

    def update(self, rows: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Takes the next rows, finite, in the order of time; gives accel, gyro, rotation and compass.

        Rows of compass are (r, 2): t_s, and by how much, in rad, the yaw is turned to the mean of the compass from one
        that follows the gyroscope alone. Where there are rows of mag, the compass is half of the rotation vector, half
        of the mean of the field so far.
        """
        found = _steadied(self._steady, rows["rotation"], rows["gyro"])
        if len(found["rotation"]) and "mag" in rows:
            turn_rad = self._turns_rad(found["rotation"], rows["mag"])
            found["rotation"][:, 1:] = multiply(about_vertical(turn_rad), found["rotation"][:, 1:])
            found["compass"][:, 1] += turn_rad
        return {**rows, **found}

    def _turns_rad(self, rotation: FloatArray, mag: FloatArray) -> FloatArray:
        """(r,) by how much attitudes (r, 5) are turned towards the mean so far of a magnetic field (m, 4)."""
        before = (np.searchsorted(rotation[:, 0], mag[:, 0], side="right") - 1).clip(0)
        x, y, _ = to_world(rotation[before, 1:], mag[:, 1:]).T
        strength_ut = np.sqrt((mag[:, 1:] ** 2).sum(axis=1))
        is_usual = (strength_ut > USUAL_FIELD_UT[0]) & (strength_ut < USUAL_FIELD_UT[1])
        north = np.append(self._north, self._north + np.cumsum((y - 1j * x) * is_usual))
        self._north = complex(north[-1])
        return np.asarray(-FIELD_TRUST * np.angle(north[np.searchsorted(mag[:, 0], rotation[:, 0], side="right")]))


class OwnAttitudeSource:
    """A phone without a rotation vector: the filter of the house makes one, with a magnetometer where there is one.

    Args:
        briefing: Gives the sensors, and the heading of the start. With that and no magnetometer the frame is not known
            until displacements have led somewhere, wherever a phone is carried; without both it is that of the first
            attitude.

    Attributes as of `PhoneSource`.
    """

    min_rate_hz: Final = MIN_RATE_HZ

    def __init__(self, briefing: Briefing) -> None:
        has_field = "mag" in briefing.sensors
        self.sensors = ("accel", "gyro", "mag") if has_field else ("accel", "gyro")
        is_given = briefing.start is not None and briefing.start.heading_rad is not None
        self.turn_rad: float | None = None if is_given and not has_field else 0.0
        self._attitude, self._steady = PhoneAttitude(), YawStabiliser()

    def update(self, rows: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Takes the next rows, finite, in the order of time; gives accel, gyro, rotation and, with a compass, that."""
        rotation = self._attitude.update(rows["accel"], rows["gyro"], rows.get("mag"))
        steadied = _steadied(self._steady, rotation, rows["gyro"])
        if "mag" not in self.sensors:
            del steadied["compass"]
        return {**rows, **steadied}


def _steadied(steady: YawStabiliser, rotation: FloatArray, gyro: FloatArray) -> dict[str, FloatArray]:
    rotation = steady.update(rotation, gyro)
    return {"rotation": rotation, "compass": np.column_stack([rotation[:, 0], steady.means_rad])}


def rows_of(briefing: Briefing) -> PhoneSource | OwnAttitudeSource:
    """What makes rows with an attitude of those that a briefing names."""
    return PhoneSource() if "rotation" in briefing.sensors else OwnAttitudeSource(briefing)
