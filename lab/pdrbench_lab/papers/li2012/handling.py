"""A person stands and handles a phone: what its sensors record while not one step is taken (claim L7, TC1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from pdrbench.errors import RecordingError
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Trajectory
from pdrbench_lab.papers.li2012.handling_motion import HandlingParams, handling_motion
from pdrbench_lab.realism.phone_rows import phone_rows
from pdrbench_sim.people.route import Place
from pdrbench_sim.record import BuildingScene
from pdrbench_sim.resolution import rounded
from pdrbench_sim.units.motion import sample_times
from pdrbench_sim.units.profiles import imu_profile

DEVICE: Final = "phone_mid"
MOTION_HZ: Final = 200.0
HELD_M: Final = 1.2  # above the floor
# How the phone of TC1 is handled. Of the parameters that are ours one was fitted, so that of 100 false steps of a plain
# peak detector about 30 are left by the limits on duration and swing (L7): games shake less than the default.
TC1: Final = HandlingParams(game_g=(0.05, 0.2))


def record_handling(
    scene: BuildingScene,
    seed: Sequence[int],
    place: Place,
    *,
    duration_s: float,
    rate_hz: float = 50.0,
    reference_s: float = 1.0,
    params: HandlingParams = TC1,
    name: str = "handling",
) -> Recording:
    """Records a phone that is handled at one place.

    Args:
        scene: The building and its magnetic field.
        seed: Numbers; the same ones give the same bytes.
        place: Where a person stands.
        duration_s: For how long, some seconds.
        rate_hz: Of all streams.
        reference_s: Between rows of the reference, which is the place.
        params: How the phone is handled.
        name: Id of the recording.

    Returns:
        Streams accel, gyro, mag and rotation; a person who handles a phone has no heading.

    Raises:
        RecordingError: No time to speak of.
    """
    if not 2.0 <= duration_s < math.inf:
        raise RecordingError(f"a phone is handled for two seconds or more; got duration_s={duration_s:g}")
    hands, *rngs = np.random.default_rng(list(seed)).spawn(5)
    floor_m = float(scene.building.height(np.array([place.polygon]))[0])
    held_m = np.append(place.xy_m, floor_m + HELD_M)
    motion = handling_motion(hands, duration_s, held_m, rate_hz=MOTION_HZ, params=params)
    t_s, row = sample_times(motion, duration_s, rate_hz)
    field_ut = scene.magnetic.at(motion.xyz_m[row], np.full(len(row), floor_m))
    profile = replace(imu_profile(DEVICE), rate_hz=rate_hz)
    rows = phone_rows(motion, profile, rngs, (t_s, motion.quaternion[row], field_ut))
    streams = {
        sensor: SensorStream(replace(sensor_spec(sensor), rate_hz=rate_hz), table[table[:, 0] <= duration_s])
        for sensor, table in rows.items()
    }
    at_s = np.arange(math.floor(duration_s / reference_s) + 1, dtype=np.float64) * reference_s
    level = int(scene.building.level(np.array([place.polygon]))[0])
    recording = Recording(
        id=name,
        building=scene.building,
        streams=streams,
        reference=Trajectory(
            t_s=at_s, xy_m=np.tile(place.xy_m, (len(at_s), 1)), level=np.full(len(at_s), level), surveyed=at_s > 0
        ),
        device=f"simulated {DEVICE}",
        mounting="hand",
    )
    return rounded(recording, {"accel": profile.accel.step, "gyro": profile.gyro.step})
