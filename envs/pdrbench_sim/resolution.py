"""The smallest steps that devices and surveyors say, and walks rounded to them.

The last bit of a computed sine or sum follows the processor. A device delivers whole numbers of its step, and so does
every generated walk: what differs in the last bit is the same number then, but for a value in some hundred millions
that lies on an edge.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.recording import RadioMap, Recording, SensorStream
from pdrbench.trajectory import Start, Trajectory

TIME_STEP_S: Final = 1e-6  # Android stamps scans in microseconds
PLACE_STEP_M: Final = 1e-3  # a total station reads to the millimetre
ANGLE_STEP_RAD: Final = math.pi / 2**15  # 16 bits of a turn; ours
MAG_STEP_UT: Final = 0.06  # [M] of phones of `ipin2023_track3`
MAG_STEP_ON_FOOT_UT: Final = 75.0 / 2**15  # [V] 750 mG in 16 bits, of an MTx
# By column of a stream. Inertial units have a step each, see `SensorErrors.step`. Identifiers and counts are whole.
STEPS: Final[Mapping[str, float]] = MappingProxyType(
    {
        "t_s": TIME_STEP_S,
        **dict.fromkeys(("x_ut", "y_ut", "z_ut"), MAG_STEP_UT),
        **dict.fromkeys(("qw", "qx", "qy", "qz"), 2.0**-14),  # [V] rotation vectors of SH-2 sensor hubs: 16 bits, Q14
        "pressure_hpa": 2.0**-12,  # [V] LPS22HB: 4096 steps; [M] of phones of `ipin2023_track3`
        **dict.fromkeys(("rssi_dbm", "tx_power_dbm", "frequency_mhz"), 1.0),  # both radios report whole ones
        "age_s": TIME_STEP_S,
        **dict.fromkeys(
            ("x_m", "y_m", "z_m", "length_m", "height_m", "rise_m"), PLACE_STEP_M
        ),  # ours: their errors are 20 times as large
        "turn_rad": ANGLE_STEP_RAD,
    }
)
_CLEAR: Final = (
    6  # decimals of a step: a value this close to an edge is taken to lie on it, and goes one way everywhere
)


def whole(values: FloatArray, step: float) -> FloatArray:
    """Values as whole numbers of steps; a tie goes to the even number, also where rounding has moved it off the tie.

    >>> whole(np.array([0.0014, 0.0025, 0.0025 + 1e-12, -0.0001]), 0.001).tolist()
    [1.0, 2.0, 2.0, 0.0]
    """
    return np.rint(np.round(np.asarray(values) / step, _CLEAR)) + 0.0  # without a negative zero


def in_steps(values: FloatArray, step: float) -> FloatArray:
    """Values rounded to whole numbers of a step; decimals where that is a decimal fraction.

    >>> in_steps(np.array([0.30004, 1e-4]), 0.001).tolist()
    [0.3, 0.0]
    """
    parts = round(1 / step)
    is_fraction = parts > 0 and abs(parts * step - 1) < 1e-9
    return whole(values, step) / parts if is_fraction else whole(values, step) * step


def mag_step_ut(mounting: str) -> float:
    """Of the magnetometer of what is carried there: a unit on the foot, or a phone."""
    return MAG_STEP_ON_FOOT_UT if mounting == "foot" else MAG_STEP_UT


def rounded(recording: Recording, steps: Mapping[str, float] | None = None) -> Recording:
    """A walk as its devices and its surveyor say it.

    Args:
        recording: Its building is left as it is.
        steps: Of the values of a sensor, by its name, where `STEPS` has none or its device has another.
    """
    steps = steps or {}
    streams = {name: rounded_stream(stream, steps.get(name)) for name, stream in recording.streams.items()}
    return dataclasses.replace(recording, streams=streams, reference=rounded_reference(recording.reference))


def rounded_stream(stream: SensorStream, own_step: float | None = None) -> SensorStream:
    """A stream in whole steps: those of `STEPS`, or one for all its values, but not for its times."""
    rows = stream.rows.copy()
    for number, column in enumerate(stream.spec.columns):
        step = own_step if own_step is not None and column != "t_s" else STEPS.get(column)
        if step:
            rows[:, number] = in_steps(rows[:, number], step)
    return SensorStream(stream.spec, rows)


def rounded_reference(reference: Trajectory) -> Trajectory:
    """Times to the microsecond, places to the millimetre."""
    heading_rad, z_m = reference.heading_rad, reference.z_m
    return dataclasses.replace(
        reference,
        t_s=in_steps(reference.t_s, TIME_STEP_S),
        xy_m=in_steps(reference.xy_m, PLACE_STEP_M),
        heading_rad=None if heading_rad is None else in_steps(heading_rad, ANGLE_STEP_RAD),
        z_m=None if z_m is None else in_steps(z_m, PLACE_STEP_M),
    )


def rounded_start(start: Start) -> Start:
    """A place to the millimetre, its radius likewise, and its heading."""
    heading_rad = start.heading_rad
    return dataclasses.replace(
        start,
        xy_m=in_steps(start.xy_m, PLACE_STEP_M),
        radius_m=round(start.radius_m, 3),
        heading_rad=None if heading_rad is None else float(in_steps(np.array(heading_rad), ANGLE_STEP_RAD)),
    )


def rounded_survey(radio_map: RadioMap) -> RadioMap:
    """Places to the millimetre, strengths to the dBm, ages to the microsecond."""
    return dataclasses.replace(
        radio_map,
        xy_m=in_steps(radio_map.xy_m, PLACE_STEP_M),
        rssi_dbm=in_steps(radio_map.rssi_dbm, STEPS["rssi_dbm"]),
        age_s=in_steps(radio_map.age_s, STEPS["age_s"]),
    )
