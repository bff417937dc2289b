"""Rows of a phone, or of a unit on a foot, as the network wants them: with an attitude, z up.

A phone reports one, of which only the yaw is made steady. A unit on a foot reports none: it gets that of the
error-state filter of `pdrbench.inertial`, which finds the vertical while the foot rests and keeps it by zero
velocities. Behind this, both are treated alike.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import BoolArray, FloatArray, path_heading_rad
from pdrbench.inertial import (
    FootFilter,
    FootParams,
    FootStates,
    PhoneAttitude,
    StrideSegmenter,
    check_units,
    phone_heading_rad,
    to_world,
)
from pdrbench.inertial.pairing import SamplePairs
from pdrbench.inertial.quaternions import about_vertical, inverse, multiply, twist_rad
from pdrbench.localizer import Briefing
from pdrbench_baselines.learned.signals import MAX_GAP_S, MIN_RATE_HZ
from pdrbench_baselines.learned.yaw_stabiliser import YawStabiliser

PHONE: Final = "phone"
FOOT: Final = "foot"
FOOT_MIN_RATE_HZ: Final = 80.0  # ours: heel strikes ring at 40 Hz, and the filter was made for 100 Hz and more
USUAL_FOOT_HZ: Final = 200.0  # as foot_ins, where the briefing gives none
ALIGNED_AFTER_M: Final = 0.5  # likewise
# Ours: a twelfth of the prior of the filter, by 60 training people: over 110 s headings drift by 2.3 degrees in the
# median, 5.1 of 90 %; with three times as much by 3.5 and 9.7: what a gyroscope reads at rest is not
# what it adds in a swing.
FILTER: Final = FootParams(gyro_bias_radps=math.radians(0.05 / 3.0))
BEHIND_S: Final = 0.75  # ours: the foot goes from where it was in the mean of so long, about a stride
GOES_M: Final = 0.3  # ours: from there; a foot that stands or shuffles keeps its heading
KEPT_S: Final = 60.0  # of times of rates, for accelerations that wait for one
# Of the earth's field between steel; magnets of a phone that are not taken out are stronger. Rotation vectors of some
# phones are off by tens of degrees where the field is not; the trust is by seven sets, see the notebook.
USUAL_FIELD_UT: Final = (20.0, 80.0)
FIELD_TRUST: Final = 0.5
CHECKED_AT_S: Final = (5.0, 30.0)  # as foot_ins: a foot that stands says nothing of the unit of its rate


class PhoneSource:
    """Rotation vectors with a steady yaw; their frame is that of the building.

    Attributes:
        sensors: That are needed.
        min_rate_hz: At which they are needed.
        turn_rad: From the frame of the attitudes to that of the building; None as long as it is unknown.
        rise_m: By how much the bearer is higher than at the start; 0 of a phone.
    """

    sensors: Final = ("accel", "gyro", "rotation")
    min_rate_hz: Final = MIN_RATE_HZ
    turn_rad: Final[float | None] = 0.0
    rise_m: Final = 0.0

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
        briefing: Gives the sensors, and the heading of the start. Without a magnetometer the yaw begins so that the top
            edge of the phone points there; without both the frame is that of the first attitude.

    Attributes as of `PhoneSource`.
    """

    min_rate_hz: Final = MIN_RATE_HZ
    rise_m: Final = 0.0

    def __init__(self, briefing: Briefing) -> None:
        has_field = "mag" in briefing.sensors
        self.sensors = ("accel", "gyro", "mag") if has_field else ("accel", "gyro")
        self._heading_rad = None if briefing.start is None or has_field else briefing.start.heading_rad
        self.turn_rad: float | None = 0.0 if self._heading_rad is None else None
        self._attitude, self._steady = PhoneAttitude(), YawStabiliser()

    def update(self, rows: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Takes the next rows, finite, in the order of time; gives accel, gyro, rotation and, with a compass, that."""
        rotation = self._attitude.update(rows["accel"], rows["gyro"], rows.get("mag"))
        if len(rotation) and self.turn_rad is None and self._heading_rad is not None:
            self.turn_rad = self._heading_rad - float(phone_heading_rad(rotation[0, 1:5]))
        steadied = _steadied(self._steady, rotation, rows["gyro"])
        if "mag" not in self.sensors:
            del steadied["compass"]
        return {**rows, **steadied}


class FootSource:
    """Attitudes of a foot. Nothing is given until the foot has rested for a tenth of a second.

    Units are strapped on anyhow. What is given is what a unit would record that was level when the filter began, and
    whose x axis points to where the foot has lately gone: how it is strapped on does not matter then.

    The filter begins with a yaw of its own. Where the briefing has a heading, the line through the places at which
    the foot stood is turned to it, once that line is half a metre long.

    Args:
        rate_hz: Of the accelerometer.
        heading_rad: Of the walker at the start, or None: then the frame stays that of the filter.

    Attributes as of `PhoneSource`.
    """

    sensors: Final = ("accel", "gyro")
    min_rate_hz: Final = FOOT_MIN_RATE_HZ

    def __init__(self, rate_hz: float, heading_rad: float | None = None) -> None:
        self._heading_rad = heading_rad
        self.turn_rad: float | None = 0.0 if heading_rad is None else None
        self._filter, self._segmenter, self._pairs = FootFilter(rate_hz, FILTER), StrideSegmenter(), SamplePairs()
        self._flat: FloatArray | None = None  # (4,) from level axes to those of the unit
        self._behind_m: FloatArray = np.zeros(2)
        self._gain, self._travel_rad, self.rise_m = min(1.0 / (BEHIND_S * rate_hz), 1.0), 0.0, 0.0
        self._rates_s: FloatArray = np.zeros(0)
        self._stood_m: FloatArray = np.zeros((1, 2))
        self._last_s = dict.fromkeys(self.sensors, -np.inf)
        self._seen: list[FloatArray] = []
        self._to_check_s = list(CHECKED_AT_S)

    def update(self, rows: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
        """Takes the next rows, finite; gives accel, gyro and rotation.

        Raises:
            RecordingError: Other units than m/s2 and rad/s, or times that go back.
        """
        _, out = self.navigated(rows)
        return out

    def navigated(self, rows: Mapping[str, FloatArray]) -> tuple[FootStates | None, dict[str, FloatArray]]:
        """The same, with the states of the filter, None where no sample was complete."""
        for name in self.sensors:
            self._check_times(name, rows[name][:, 0])
        is_sampled = self._between_samples(rows["gyro"][:, 0])
        pairs = self._pairs.update(rows["accel"], rows["gyro"])
        self._check_units(pairs)
        out = {"accel": np.zeros((0, 4)), "gyro": np.zeros((0, 4)), "rotation": np.zeros((0, 5))}
        if not len(pairs):
            return None, out
        states = self._filter.update(pairs[:, 0], pairs[:, 1:4], pairs[:, 4:7])
        known = np.isfinite(states.x[:, 0])
        if not known.any():
            return states, out
        t_s, place_m, quaternion = states.t_s[known], states.position_m[known], states.quaternion[known]
        ahead = self._ahead(place_m[:, :2], quaternion)
        back = inverse(ahead)
        own = to_world(back, to_world(quaternion, pairs[known, 1:7].reshape(-1, 2, 3).swapaxes(0, 1)))
        is_known = is_sampled(t_s)
        out["accel"], out["gyro"] = np.column_stack([t_s, own[0]]), np.column_stack([t_s, own[1]])[is_known]
        out["rotation"] = np.column_stack([t_s, ahead])
        self.rise_m = float(place_m[-1, 2])
        self._align(states)
        return states, out

    def _ahead(self, place_m: FloatArray, quaternion: FloatArray) -> FloatArray:
        """(n, 4) attitudes of a unit that is strapped on level, its x axis ahead, at places (n, 2)."""
        from scipy.signal import lfilter  # 37 MB and half a second, which no phone needs

        if self._flat is None:
            self._flat, self._behind_m = inverse(quaternion[0]), place_m[0]
        flat = multiply(quaternion, self._flat)
        behind_m, _ = lfilter(
            [self._gain], [1.0, self._gain - 1.0], place_m, axis=0, zi=[(1.0 - self._gain) * self._behind_m]
        )
        self._behind_m = behind_m[-1]
        way_m = place_m - behind_m
        goes = np.hypot(*way_m.T) > GOES_M
        headings_rad = np.concatenate([[self._travel_rad], np.arctan2(way_m[:, 1], way_m[:, 0])])
        last = np.maximum.accumulate(np.where(goes, np.arange(1, len(goes) + 1), 0))
        self._travel_rad = float(headings_rad[last[-1]])
        ahead = multiply(flat, about_vertical(headings_rad[last] - twist_rad(flat)))
        return np.clip(ahead, -1.0, 1.0)  # 1 + 2e-16 is none

    def _between_samples(self, t_s: FloatArray) -> Callable[[FloatArray], BoolArray]:
        """Says of times whether rates of the gyroscope were sampled around them, and not made up over a gap."""
        times_s = np.concatenate([self._rates_s, t_s])
        self._rates_s = times_s[times_s >= times_s[-1] - KEPT_S] if len(times_s) else times_s

        def is_sampled(at_s: FloatArray) -> BoolArray:
            after = np.searchsorted(times_s, at_s).clip(1, max(len(times_s) - 1, 1))
            return np.asarray(times_s[after] - times_s[after - 1] <= MAX_GAP_S)

        return is_sampled

    def _align(self, states: FootStates) -> None:
        if self.turn_rad is not None or self._heading_rad is None:
            return
        self._stood_m = np.concatenate([self._stood_m, self._segmenter.update(states).end_xyz_m[:, :2]])
        track_rad = path_heading_rad(self._stood_m, ALIGNED_AFTER_M)
        if track_rad is not None:
            self.turn_rad = self._heading_rad - track_rad

    def _check_times(self, name: str, t_s: FloatArray) -> None:
        if len(t_s):
            if np.any(np.diff(t_s, prepend=self._last_s[name]) < 0):
                raise RecordingError(f"{name}: rows in the order of time are expected; sort or repair the recording")
            self._last_s[name] = float(t_s[-1])

    def _check_units(self, pairs: FloatArray) -> None:
        if not self._to_check_s or not len(pairs):
            return
        self._seen.append(pairs)
        if pairs[-1, 0] >= self._to_check_s[0]:
            seen = np.concatenate(self._seen)
            check_units(seen[:, 1:4], seen[:, 4:7])
            apart_s = float(np.median(np.diff(seen[:, 0])))
            if apart_s > 1.5 / FOOT_MIN_RATE_HZ:
                raise RecordingError(
                    f"accel: comes at {1 / apart_s:.3g} Hz; {FOOT_MIN_RATE_HZ:g} Hz or more are needed of a foot"
                )
            self._to_check_s.pop(0)
            if not self._to_check_s:
                self._seen = []


def _steadied(steady: YawStabiliser, rotation: FloatArray, gyro: FloatArray) -> dict[str, FloatArray]:
    rotation = steady.update(rotation, gyro)
    return {"rotation": rotation, "compass": np.column_stack([rotation[:, 0], steady.means_rad])}


def rows_of(briefing: Briefing) -> PhoneSource | OwnAttitudeSource | FootSource:
    """What makes rows with an attitude of those that a briefing names."""
    if briefing.carrier == PHONE:
        return PhoneSource() if "rotation" in briefing.sensors else OwnAttitudeSource(briefing)
    heading_rad = None if briefing.start is None else briefing.start.heading_rad
    accel = briefing.sensors.get("accel")
    return FootSource((accel.rate_hz if accel else None) or USUAL_FOOT_HZ, heading_rad)
