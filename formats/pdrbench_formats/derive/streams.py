"""Which streams can be computed from which others, and `derive`, which does it."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.inertial import (
    WAYS,
    LevelTracker,
    PeakStepDetector,
    SamplePairs,
    find_strides,
    level_heights,
    navigate,
    phone_heading_rad,
    to_world,
)
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.sensors.checks import rate_of
from pdrbench.trajectory import Start
from pdrbench_formats.derive.attitude import attitude

FOOT: Final = "foot"
FOOT_MIN_RATE_HZ: Final = 80.0  # heel strikes ring at 40 Hz
PHONE_MIN_RATE_HZ: Final = 15.0  # five samples in the shortest step
STEP_LENGTH_M: Final = 0.63  # as dead_reckoning
POSITION_S: Final = 1.0
UPRIGHT_S: Final = 2.0
# Of computed attitudes of phones 0.96 or more (simulated offices, MallPhone-v2, IpinPhone-v1, nine walks of each), of
# shoes 0.62 to 0.76 but for one walk of ten (FootWalks-v1, FootVicon-v1, FootLoops-v1, FootShort-v1): 0.95.
MIN_UPRIGHT: Final = 0.85


@dataclass(frozen=True, slots=True)
class _Walk:
    """What there is to compute from."""

    streams: Mapping[str, SensorStream]
    mounting: str
    start: Start | None
    building: Building | None

    def rows(self, name: str) -> FloatArray:
        return self.streams[name].rows

    def rate_hz(self, name: str) -> float:
        """Measured; 0 where there are too few rows."""
        return rate_of(self.streams[name].t_s[:2000])


@dataclass(frozen=True, slots=True)
class _Recipe:
    """How one stream is computed."""

    needs: tuple[str, ...]  # streams without which there is none
    compute: Callable[[_Walk], FloatArray | str]  # rows, or why what comes out cannot be meant
    obstacle: Callable[[_Walk], str]  # why it cannot be, though the streams are there; empty if it can
    what: str  # how it was computed, for the spec


def derive(
    streams: Mapping[str, SensorStream],
    mounting: str,
    wanted: Collection[str],
    *,
    start: Start | None = None,
    building: Building | None = None,
) -> dict[str, SensorStream]:
    """The streams of a recording, and those of `wanted` that it lacks and that can be computed.

    Args:
        streams: By sensor name, as recorded.
        mounting: Where the device was carried, as in `Recording`.
        wanted: Names of sensors. What is recorded stays as it is; what cannot be computed is left out, see
            `missing_reason`.
        start: What a localizer is given of the start; its heading gives a yaw its direction.
        building: Its levels have the heights that changes of level are counted by.

    Returns:
        By sensor name, recorded ones first. Specs of computed streams have `derived=True`.

    Raises:
        UnknownNameError: A sensor that is not registered.
        RecordingError: Units or clocks of the streams cannot be meant.

    >>> t_s = np.arange(0.0, 2.0, 0.02)
    >>> still = np.column_stack([t_s, 0 * t_s, 0 * t_s, 0 * t_s + 9.81])
    >>> accel = SensorStream(sensor_spec("accel"), still)
    >>> gyro = SensorStream(sensor_spec("gyro"), still * [1, 0, 0, 0])
    >>> derive({"accel": accel, "gyro": gyro}, "hand", ["rotation"])["rotation"].spec.derived
    True
    """
    for name in wanted:
        sensor_spec(name)
    out = dict(streams)
    for name in DERIVED:  # in an order in which each is computed from those before it
        needed = name in wanted or (name == "rotation" and "position" in wanted)
        walk = _Walk(out, mounting, start, building)
        if not needed or name in out or _obstacle(walk, name):
            continue
        rows = DERIVED[name].compute(walk)
        if isinstance(rows, str):
            continue
        spec = sensor_spec(name)
        source = out[DERIVED[name].needs[-1]].spec
        out[name] = SensorStream(
            dataclasses.replace(
                spec,
                rate_hz=source.rate_hz if name == "rotation" else spec.rate_hz,
                what=f"{spec.what} {DERIVED[name].what}",
                derived=True,
            ),
            rows,
        )
    return {name: stream for name, stream in out.items() if name in streams or name in wanted}


def derived_streams(recording: Recording, start: Start | None) -> dict[str, SensorStream]:
    """The streams of a recording and all that can be computed from them; see `derive`."""
    return derive(recording.streams, recording.mounting, tuple(DERIVED), start=start, building=recording.building)


def missing_reason(streams: Mapping[str, SensorStream], mounting: str, name: str, *, start: Start | None = None) -> str:
    """Why a stream is not recorded and cannot be computed, in one line; empty where it is or can be.

    Raises:
        UnknownNameError: A sensor that is not registered.
    """
    if name in streams:
        return ""
    sensor_spec(name)
    if name not in DERIVED:
        return f"{name!r} is measured or missing: nothing computes it from other sensors"
    walk = _Walk(streams, mounting, start, None)
    if obstacle := _obstacle(walk, name):
        return obstacle
    rows = DERIVED[name].compute(walk)
    return rows if isinstance(rows, str) else ""


def _obstacle(walk: _Walk, name: str) -> str:
    """Why a stream is not computed, before any is; empty where nothing speaks against it."""
    recipe = DERIVED[name]
    lacking = [need for need in recipe.needs if need not in walk.streams or not len(walk.rows(need))]
    if lacking:
        return (
            f"{name!r} is computed from {' and '.join(recipe.needs)}; this recording has no {' and no '.join(lacking)}"
        )
    return recipe.obstacle(walk)


def _on_phone(walk: _Walk) -> str:
    if walk.mounting == FOOT:
        return "the attitude of a phone is computed for phones; a unit on a foot gets strides"
    return _too_slow(walk, PHONE_MIN_RATE_HZ)


def _on_foot(walk: _Walk) -> str:
    if not walk.mounting:
        return "strides are computed for a unit on a foot; where this one is carried is not stated"
    if walk.mounting != FOOT:
        return f"strides are computed for a unit on a foot; this one is carried in {walk.mounting!r}"
    return _too_slow(walk, FOOT_MIN_RATE_HZ)


def _too_slow(walk: _Walk, min_hz: float) -> str:
    for name in ("accel", "gyro"):
        rate_hz = walk.rate_hz(name)
        if rate_hz < min_hz:
            return f"{name!r} comes at {rate_hz:.3g} Hz; {min_hz:g} Hz or more are needed"
    return ""


def _placed(walk: _Walk) -> str:
    if walk.start is None:
        return "a position is counted from a known start; none is given"
    if walk.mounting == FOOT and walk.start.heading_rad is None:
        return "a position by strides needs the heading of the start; none is given"
    return _too_slow(walk, FOOT_MIN_RATE_HZ if walk.mounting == FOOT else PHONE_MIN_RATE_HZ)


def _rotation(walk: _Walk) -> FloatArray | str:
    heading_rad = None if walk.start is None else walk.start.heading_rad
    mag = walk.rows("mag") if "mag" in walk.streams else None
    rows = attitude(walk.rows("accel"), walk.rows("gyro"), mag, heading_rad)
    upright = _upright(rows, walk.rows("accel")) if len(rows) else 1.0
    if upright >= MIN_UPRIGHT:
        return rows
    return (
        f"'rotation' is computed for what is carried in hand or pocket; here {100 * upright:.0f} % of gravity comes "
        f"out upright, as of a unit on a foot"
    )


def _upright(rotation: FloatArray, accel: FloatArray) -> float:
    """Fraction of the mean specific force that an attitude turns upwards, over `UPRIGHT_S`: the lower quartile."""
    row = (np.searchsorted(rotation[:, 0], accel[:, 0], side="right") - 1).clip(0)
    block = ((accel[:, 0] - accel[0, 0]) // UPRIGHT_S).astype(np.int64)
    first = np.flatnonzero(np.diff(block, prepend=-1))
    count = np.diff(np.append(first, len(block)))[:, None]
    up = np.add.reduceat(to_world(rotation[row, 1:5], accel[:, 1:4]), first) / count
    force = np.add.reduceat(accel[:, 1:4], first) / count
    fraction = up[:, 2] / np.maximum(np.linalg.norm(force, axis=1), 1e-9)
    return float(np.quantile(fraction, 0.25))


def _strides(walk: _Walk) -> FloatArray:
    """Strides of the newest foot filter, that of `foot_ins_robust`; what no foot does is left out."""
    pairs = SamplePairs().update(walk.rows("accel"), walk.rows("gyro"))
    try:
        states = navigate(pairs[:, 0], pairs[:, 1:4], pairs[:, 4:7])
    except RecordingError as error:
        raise RecordingError(f"stream 'stride' cannot be computed: {error}") from error
    rows, spec = find_strides(states).rows(), sensor_spec("stride")
    return rows[((rows >= spec.low) & (rows <= spec.high)).all(axis=1)]


def _position(walk: _Walk) -> FloatArray | str:
    """Places once a second: strides of a foot, or steps of one length along the top edge of a phone, from the start."""
    assert walk.start is not None
    if walk.mounting == FOOT:
        strides = walk.rows("stride") if "stride" in walk.streams else _strides(walk)
        t_s, length_m = strides[:, 0], strides[:, 1]
        heading_rad = (walk.start.heading_rad or 0.0) + np.cumsum(strides[:, 3])
    else:
        rotation = walk.rows("rotation") if "rotation" in walk.streams else _rotation(walk)
        if isinstance(rotation, str):
            return rotation
        t_s = _step_times_s(walk)
        t_s = t_s[t_s >= (rotation[0, 0] if len(rotation) else math.inf)]
        row = np.searchsorted(rotation[:, 0], t_s, side="right") - 1
        heading_rad, length_m = phone_heading_rad(rotation[row, 1:5]), np.full(len(t_s), STEP_LENGTH_M)
    moves_m = length_m[:, None] * np.column_stack([np.cos(heading_rad), np.sin(heading_rad)])
    places_m = walk.start.xy_m + np.concatenate([np.zeros((1, 2)), np.cumsum(moves_m, axis=0)])
    at_s = np.arange(1, 1 + math.floor(float(walk.rows("accel")[-1, 0]) / POSITION_S)) * POSITION_S
    return np.column_stack([at_s, places_m[np.searchsorted(t_s, at_s, side="right")]])


def _level_changes(walk: _Walk) -> FloatArray:
    heights_m = None if walk.building is None or walk.start is None else level_heights(walk.building)
    level = 0 if walk.start is None else walk.start.level
    tracker = LevelTracker(level, heights_m if heights_m and level in heights_m else None)
    changes = tracker.update(walk.rows("baro"), _step_times_s(walk))
    rows = [(change.t_s, change.levels, change.rise_m, WAYS.index(change.way)) for change in changes]
    return np.array(rows, dtype=np.float64).reshape(-1, 4)


def _step_times_s(walk: _Walk) -> FloatArray:
    """When steps become known: a peak is one when the sample after it has come."""
    rate_hz = walk.rate_hz("accel")
    if rate_hz <= 2 * PHONE_MIN_RATE_HZ / 5:  # the filter of the detector ends at 3 Hz
        return np.zeros(0)
    times_s: FloatArray = PeakStepDetector(rate_hz).update(walk.rows("accel")) + 2.0 / rate_hz
    return times_s


DERIVED: Final[Mapping[str, _Recipe]] = {
    "rotation": _Recipe(
        ("accel", "gyro"),
        _rotation,
        _on_phone,
        "Computed from accelerometer and gyroscope, from the magnetometer where its field is steady; the yaw begins "
        "with the heading of the start, else with magnetic north, else along x.",
    ),
    "stride": _Recipe(("accel", "gyro"), _strides, _on_foot, "Computed by a filter with zero-velocity updates."),
    "position": _Recipe(
        ("accel", "gyro"), _position, _placed, "Computed from the strides of a shoe, or the steps of a phone."
    ),
    "level_change": _Recipe(
        ("accel", "baro"), _level_changes, lambda walk: "", "Computed from pressure and steps; see LevelTracker."
    ),
}
