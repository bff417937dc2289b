"""The attitude of a phone from accelerometer and gyroscope, and from the magnetometer where its field can be trusted.

Gravity levels, the gyroscope turns, less the rate that it shows at rest. Steel bends the field of a building by tens of
degrees within metres, and a compass that is always followed bends the track with it. So the field only counts
while the pedestrian walks through it and its strength and dip stay as they are, and it only turns the yaw slowly.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray, wrap_rad
from pdrbench.inertial import PhoneAttitude, multiply, phone_heading_rad, to_world
from pdrbench.inertial.quaternions import about_vertical

BLOCK_S: Final = 0.5  # the field is judged, and the yaw corrected, at the end of each
WINDOW_S: Final = 8.0  # over which the field has to be steady
MAX_STRENGTH_UT: Final = 2.0  # standard deviation of its strength over the window; sources.md 1.7: 4 within a building
MAX_DIP_RAD: Final = math.radians(3.0)  # the same of its dip
EARTH_UT: Final = (22.0, 67.0)  # of the World Magnetic Model at the surface
MIN_WALKING_MPS2: Final = 0.8  # standard deviation of |a| over the window: any field is steady at rest
COMPASS_S: Final = 60.0  # in which a trusted field turns the yaw, as `learned` found: 30 to 100 s are equally good
DOUBT: Final = 0.2  # weight of a field that is not trusted, where nothing else gives a heading
STILL_RADPS: Final = 0.01  # a gyroscope whose axes vary by less over a second is at rest, ...
STILL_MPS2: Final = 0.2  # ... if the length of the specific force varies by less, too, ...
BIAS_RADPS: Final = 0.05  # ... and it shows less than this, which is then its bias


def attitude(
    accel: FloatArray, gyro: FloatArray, mag: FloatArray | None = None, heading_rad: float | None = None
) -> FloatArray:
    """Attitudes at the samples of the gyroscope, each from samples that are not later.

    The yaw begins so that the top edge of the phone points to the given heading; else to where a magnetometer has
    north; else along x. With a given heading the magnetometer only keeps the yaw where it was against the field.

    Args:
        accel: (n, 4) t_s, specific force in m/s2.
        gyro: (m, 4) t_s, rates in rad/s.
        mag: (k, 4) t_s, field in microtesla; None where there is none.
        heading_rad: Of the walker at the start, counter-clockwise from +x.

    Returns:
        (j, 5) t_s and unit Hamilton wxyz, device to building, as the sensor `rotation` has them.
    """
    rotation = PhoneAttitude().update(accel, _without_bias(accel, gyro))
    rotation = turned_to_heading(rotation, 0.0 if heading_rad is None else heading_rad)
    if mag is None or not len(mag) or not len(rotation):
        return rotation
    end_s, correction_rad = _corrections(accel, mag, rotation, heading_rad is not None)
    block = np.searchsorted(end_s, rotation[:, 0], side="right") - 1
    turn_rad = np.where(block >= 0, correction_rad[np.maximum(block, 0)], 0.0)
    turned = multiply(about_vertical(turn_rad), rotation[:, 1:5])
    return np.column_stack([rotation[:, 0], np.clip(turned, -1.0, 1.0)])


def turned_to_heading(rotation: FloatArray, heading_rad: float) -> FloatArray:
    """(n, 5) attitudes (n, 5) turned about the vertical so that at first the top edge points to the given heading.

    For an attitude whose yaw counts from anywhere, as that of Android's game rotation vector.
    """
    if not len(rotation):
        return rotation
    turn_rad = heading_rad - float(phone_heading_rad(rotation[0, 1:5]))
    turned = multiply(np.broadcast_to(about_vertical(turn_rad), (len(rotation), 4)), rotation[:, 1:5])
    return np.column_stack([rotation[:, 0], np.clip(turned, -1.0, 1.0)])


def _without_bias(accel: FloatArray, gyro: FloatArray) -> FloatArray:
    """(m, 4) rates less the mean rate of the seconds at rest before them, the last ten of these."""
    if not len(gyro):
        return gyro
    second = np.floor(gyro[:, 0] - gyro[0, 0]).astype(np.int64)
    first = np.flatnonzero(np.diff(second, prepend=-1))
    count = np.diff(np.append(first, len(gyro)))[:, None]
    mean = np.add.reduceat(gyro[:, 1:4], first) / count
    square = np.add.reduceat(gyro[:, 1:4] ** 2, first) / count
    spread = np.sqrt(np.maximum(square - mean**2, 0.0)).max(axis=1)
    rests = (spread < STILL_RADPS) & (np.abs(mean).max(axis=1) < BIAS_RADPS) & (count[:, 0] >= 8)
    edges = np.searchsorted(accel[:, 0], np.append(gyro[first, 0], np.inf))
    force_mps2 = np.linalg.norm(accel[:, 1:4], axis=1)
    bias, biases, num_rests = np.zeros(3), np.zeros((len(first), 3)), 0
    for i in range(len(first)):
        biases[i] = bias  # of the seconds before this one
        force = force_mps2[edges[i] : edges[i + 1]]
        if rests[i] and len(force) >= 8 and force.std() < STILL_MPS2:
            num_rests += 1
            bias = bias + (mean[i] - bias) / min(num_rests, 10)
    corrected = gyro.copy()
    corrected[:, 1:4] -= np.repeat(biases, count[:, 0], axis=0)
    return corrected


def _corrections(
    accel: FloatArray, mag: FloatArray, rotation: FloatArray, has_heading: bool
) -> tuple[FloatArray, FloatArray]:
    """From when (b,) to turn attitudes by how much (b,): the end of each block of the magnetometer."""
    latest = np.searchsorted(rotation[:, 0], mag[:, 0], side="right") - 1
    mag, latest = mag[latest >= 0], latest[latest >= 0]
    if not len(mag):
        return np.zeros(1), np.zeros(1)
    field_ut = to_world(rotation[latest, 1:5], mag[:, 1:4])
    level_ut = np.hypot(field_ut[:, 0], field_ut[:, 1])
    strength_ut, dip_rad = np.hypot(level_ut, field_ut[:, 2]), np.arctan2(field_ut[:, 2], level_ut)
    off_rad = np.arctan2(field_ut[:, 0], field_ut[:, 1])  # by which the field has to be turned to point north
    force_mps2 = np.linalg.norm(accel[:, 1:4], axis=1)
    first_s = float(mag[0, 0])
    end_s = np.append(first_s, first_s + BLOCK_S * np.arange(1, 1 + int((mag[-1, 0] - first_s) / BLOCK_S)))
    turn_rad = np.zeros(len(end_s))
    if not has_heading:
        turn_rad[0] = off_rad[0]
    mean, weight_s = np.exp(1j * off_rad[0]), BLOCK_S * DOUBT  # of the direction, and for how long it was seen
    reference_rad: float | None = None if has_heading else 0.0
    for i in range(1, len(end_s)):
        block = slice(*np.searchsorted(mag[:, 0], [end_s[i - 1], end_s[i]]))
        window = slice(*np.searchsorted(mag[:, 0], [end_s[i] - WINDOW_S, end_s[i]]))
        force = force_mps2[slice(*np.searchsorted(accel[:, 0], [end_s[i] - WINDOW_S, end_s[i]]))]
        turn_rad[i] = turn_rad[i - 1]
        if block.stop == block.start:
            continue
        is_trusted = (
            end_s[i] - first_s >= WINDOW_S
            and EARTH_UT[0] < strength_ut[window].mean() < EARTH_UT[1]
            and strength_ut[window].std() < MAX_STRENGTH_UT
            and dip_rad[window].std() < MAX_DIP_RAD
            and len(force) > 1
            and force.std() > MIN_WALKING_MPS2
        )
        part_s = BLOCK_S * (1.0 if is_trusted else 0.0 if has_heading else DOUBT)
        if not part_s:
            continue
        weight_s += part_s
        direction = np.exp(1j * off_rad[block]).mean()
        mean += (direction - mean) * min(part_s / min(weight_s, COMPASS_S), 1.0)
        if reference_rad is None:
            reference_rad, mean, weight_s = float(np.angle(direction)), direction, part_s
        elif has_heading and weight_s < WINDOW_S:
            reference_rad = float(np.angle(mean))  # where the field points against the given heading
        turn_rad[i] = float(wrap_rad(np.angle(mean) - reference_rad))
    return end_s, turn_rad
