"""Simulated people in Westport House: everything can be reached, and walks change levels."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building.connectivity import reachable_parts
from pdrbench.datasets import is_available
from pdrbench.registry import make_task

pytestmark = [
    pytest.mark.data,
    pytest.mark.skipif(not is_available("maps"), reason="the set `maps` is not below PDRBENCH_DATA"),
]


@pytest.mark.parametrize("env", ["WestportPhone-v1", "WestportFoot-v2"])
def test_walks_change_levels_of_a_building_that_can_be_walked_from_end_to_end(env: str) -> None:
    task = make_task(env)
    recordings = [task.load(walk) for walk in task.walks["val"][:2]]
    building = recordings[0].building
    assert building is not None and building.levels == tuple(range(7))
    assert (reachable_parts(building, by_lift=False) == 0).all()
    for recording in recordings:
        reference = recording.reference
        assert len(np.unique(reference.level)) > 1
        assert building.contains(reference.xy_m, reference.level).all()
        assert reference.z_m is not None and np.ptp(reference.z_m) > 3.0
        if env == "WestportPhone-v1":
            changes = recording.streams["level_change"].rows
            level = reference.level[0] + [changes[changes[:, 0] <= t_s, 1].sum() for t_s in reference.t_s]
            # A level counts from another moment than the middle of a ride or climb; weather is not always told apart.
            assert (level == reference.level).mean() > 0.85


def test_a_foot_in_a_lift_stands_while_the_pressure_falls_as_it_rises() -> None:
    task = make_task("WestportFoot-v2")
    recording = task.load(task.walks["val"][2])
    reference = recording.reference
    assert reference.z_m is not None
    rise_m = np.diff(reference.z_m)
    rides = np.flatnonzero(np.abs(rise_m) > 3.0)  # no stride climbs as much
    assert len(rides)
    accel, baro = recording.streams["accel"].rows, recording.streams["baro"].rows
    for ride in rides:
        assert np.ptp(reference.xy_m[ride : ride + 2], axis=0).max() == 0.0
        # Upwards the rest after a ride begins when the lift stops; its mean speed is 1 m/s.
        assert rise_m[ride] > 0
        stop_s = reference.t_s[ride + 1]
        start_s = stop_s - rise_m[ride]
        riding = (accel[:, 0] >= start_s) & (accel[:, 0] <= stop_s)
        norm = np.linalg.norm(accel[riding, 1:], axis=1)
        # 6 h / T^2 is the greatest acceleration of its way 3 f^2 - 2 f^3, T = h seconds; 1 m/s2 for 6 m.
        assert abs(norm.mean() - 9.81) < 0.3
        assert np.abs(norm - 9.81).max() < 6.0 / rise_m[ride] + 0.6
        before, after = (np.interp(t_s, baro[:, 0], baro[:, 1]) for t_s in (start_s, stop_s))
        assert (before - after) * 8.3 == pytest.approx(rise_m[ride], abs=1.5)  # 8.3 m for each hPa near the ground
