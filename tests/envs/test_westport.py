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


@pytest.mark.parametrize(
    "env", [pytest.param("WestportPhone-v0", marks=pytest.mark.long(seconds=5)), "WestportFoot-v0"]
)
def test_walks_climb_stairs_of_a_building_that_can_be_walked_from_end_to_end(env: str) -> None:
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
