from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.recording import Recording
from pdrbench.registry import make_task


@pytest.fixture(scope="module")
def walk() -> Recording:
    task = make_task("OfficePhoneLevels-v1")
    return task.load(task.split("train")[4])


def test_people_take_stairs_and_lifts(walk: Recording) -> None:
    building = walk.building
    assert isinstance(building, Building)
    kinds = {building.polygons[p].kind for p in building.locate(walk.reference.xy_m, walk.reference.level)}
    assert kinds == {"floor", "stairs", "lift"}
    assert len(np.unique(walk.reference.level)) == 3


def test_changes_of_level_are_derived_and_said_to_be(walk: Recording) -> None:
    stream, reference = walk.streams["level_change"], walk.reference
    assert stream.spec.derived and not walk.streams["baro"].spec.derived
    level = reference.level[0] + np.array([stream.column("levels")[stream.t_s <= t_s].sum() for t_s in reference.t_s])
    assert np.mean(level == reference.level) > 0.9
    assert {1.0, 2.0} <= set(stream.column("way").tolist())
