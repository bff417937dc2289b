"""People with a unit on a foot who walk for training only, and places in the frame that the unit's attitude has."""

from __future__ import annotations

import functools
from dataclasses import replace
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Trajectory
from pdrbench_baselines.learned.attitude_sources import USUAL_FOOT_HZ, FootSource

if TYPE_CHECKING:
    from pdrbench.inertial import FootStates
    from pdrbench_sim.record import BuildingScene

SEED: Final = 20260722  # of all people here; no environment has it
GROUPS: Final = {"train": 0, "val": 1, "test": 2}
PEOPLE_PER_BUILDING: Final = 10
NUM_LEVELS: Final = 3  # as in CampusFoot-v1: stairs are walked on
AREA_M2: Final = (1500.0, 4200.0)
WALK_S: Final = 150.0
RATES_HZ: Final = (100.0, 120.0, 120.0, 200.0)  # ours: half of the units as in CampusFoot-v1
BODY_S: Final = 0.1
DRIFT_S: Final = 20.0  # ours: over which yaw is taken to drift by little; a sway of a step is short beside it
STILL_M2: Final = 1e-6


def train_foot(number: int, *, group: str = "train", walk_s: float = WALK_S) -> Recording:
    """The walk of one person with a unit on a foot.

    Args:
        number: Whose.
        group: One of `GROUPS`: people and buildings of two of them have no seed in common.
        walk_s: How long it takes.

    Returns:
        Accelerometer and gyroscope of the foot; the reference is the body every `BODY_S`, which passes over the foot
        while it rests: half as far from side to side as a foot, and on the way when the foot is not.
    """
    from pdrbench_sim.people.person import draw_person
    from pdrbench_sim.record import IN_HAND, ON_FOOT, simulate_walk

    root = [SEED, GROUPS[group]]
    rng = np.random.default_rng([*root, 0, number])
    person, rate_hz = draw_person(rng), float(rng.choice(RATES_HZ))
    scene = _scene(group, number // PEOPLE_PER_BUILDING)
    foot = replace(ON_FOOT, rate_hz=rate_hz, sensors=("accel", "gyro"))
    body = replace(IN_HAND, sensors=(), reference_s=BODY_S)  # the same seed walks the same way
    shod, carried = (
        simulate_walk(scene, [*root, 2, number], setup, duration_s=walk_s, person=person, name=f"foot-{number}")
        for setup in (foot, body)
    )
    return replace(shod, reference=carried.reference)


@functools.lru_cache(maxsize=2)
def _scene(group: str, number: int) -> BuildingScene:
    from pdrbench_sim.buildings.office import make_office
    from pdrbench_sim.record import make_scene

    rng = np.random.default_rng([SEED, GROUPS[group], 1, number])
    return make_scene(rng, make_office(rng, num_levels=NUM_LEVELS, area_m2=float(rng.uniform(*AREA_M2))))


def foot_rows(recording: Recording) -> tuple[FootStates, dict[str, FloatArray]]:
    """States of the filter on a whole recording of a foot, and its rows with attitudes.

    Raises:
        RecordingError: As `FootSource`, or the foot never rests.
    """
    accel = recording.streams["accel"]
    rows = FootSource(accel.spec.rate_hz or USUAL_FOOT_HZ)
    states, out = rows.navigated({name: recording.streams[name].rows for name in FootSource.sensors})
    if states is None or not len(out["rotation"]):
        raise RecordingError(f"{recording.id}: the foot never rests; leave the recording out")
    return states, out


def levelled(recording: Recording) -> Recording:
    """A recording of a foot with the rotation vector of the filter, and its reference in that frame.

    The yaw of the filter begins anywhere and drifts by some degrees a minute. What the network is asked for is in
    the frame of the second, so places are turned by the difference between the heading of the filter and the true one,
    the mean over `DRIFT_S` around each.

    Raises:
        RecordingError: See `foot_rows`.
    """
    states, rows = foot_rows(recording)
    streams = {name: SensorStream(recording.streams[name].spec, rows[name]) for name in ("accel", "gyro")}
    rate_hz = recording.streams["accel"].spec.rate_hz
    streams["rotation"] = SensorStream(replace(sensor_spec("rotation"), rate_hz=rate_hz), rows["rotation"])
    return replace(recording, streams=streams, reference=_in_its_frame(recording.reference, states))


def _in_its_frame(way: Trajectory, states: FootStates) -> Trajectory:
    """Places turned into the frame of the filter, drift and all."""
    known = np.isfinite(states.x[:, 0])
    t_s, place_m = states.t_s[known], states.position_m[known, :2]
    own = _moves(np.column_stack([np.interp(way.t_s, t_s, one) for one in place_m.T]))
    true = _moves(way.xy_m)
    same = np.concatenate([[0.0], np.cumsum(own * np.conj(true))])
    middle_s = (way.t_s[1:] + way.t_s[:-1]) / 2

    def until(at_s: FloatArray) -> FloatArray:
        return np.asarray(np.interp(at_s, way.t_s, same))

    around = until(middle_s + DRIFT_S / 2) - until(middle_s - DRIFT_S / 2)
    around = np.where(np.abs(around) > STILL_M2, around, same[-1])  # who stands for so long has no heading of travel
    turn = around / np.maximum(np.abs(around), 1e-12)
    path = np.concatenate([[0.0], np.cumsum(turn * true)])
    return replace(way, xy_m=np.column_stack([path.real, path.imag]), heading_rad=None)


def _moves(xy_m: FloatArray) -> FloatArray:
    """(n - 1,) as complex numbers."""
    return np.asarray(np.diff(xy_m[:, 0]) + 1j * np.diff(xy_m[:, 1]))
