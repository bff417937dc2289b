"""What a seed of a reproduction draws anew: intervals over seeds are intervals over buildings or people."""

from __future__ import annotations

import pytest

from pdrbench.registry import make_task
from pdrbench_lab.papers.paper_walks import map_of, walk_of


def test_every_seed_of_a_hallway_has_a_person_of_its_own() -> None:
    task = make_task("WlanHallway-v1")
    walks = task.split("test")
    assert len({task.units[walk] for walk in walks}) == len(walks) == 20


@pytest.mark.parametrize("env", ["BuildingSite-v1", "LabStrideLost-v2"])
def test_every_seed_has_a_building_of_its_own(env: str) -> None:
    assert not make_task(env).units  # the building of each walk is its unit
    first, second = (map_of(walk_of(env, seed)[0]) for seed in range(2))
    assert first.sha256 != second.sha256
