from __future__ import annotations

import collections

import numpy as np
import pytest

from pdrbench_envs import office_abroad
from pdrbench_envs.office_abroad import GROUPS, SPLITS


@pytest.fixture(scope="module")
def task():
    return office_abroad.task()


def test_every_kind_has_as_many_walks_in_several_buildings(task):
    for split, plan in SPLITS.items():
        walks = task.split(split)
        counted = collections.Counter(task.groups[walk][0] for walk in walks)
        assert counted == dict.fromkeys(GROUPS, plan.walks // len(GROUPS))
        places = [office_abroad.WALKS.place_of(walk)[1] for walk in walks]
        for group in GROUPS:
            mine = {place % plan.buildings for place in places if office_abroad.kind_of(place) == group}
            assert len(mine) >= plan.buildings - 1


def test_every_walk_is_by_a_person_of_its_own(task):
    assert task.unit_kind == "person"
    walks = [walk for split in SPLITS for walk in task.split(split)]
    assert len({task.units[walk] for walk in walks}) == len(walks)


def test_phones_are_carried_as_their_kind_says(task):
    walks = {task.groups[walk][0]: walk for walk in reversed(task.split("val"))}
    cart, gentle = task.load(walks["cart"]), task.load(walks["gentle"])
    assert (cart.mounting, gentle.mounting) == ("cart", "hand")
    assert task.tell_start(cart).heading_rad is None
    accel = gentle.streams["accel"].rows
    assert 0.5 < np.linalg.norm(accel[:, 1:], axis=1).std() < 2.5
    assert set(cart.streams) == {spec.name for spec in task.sensors}
