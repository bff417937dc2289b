"""Plans that few people have: real ones, where they are found."""

from __future__ import annotations

from pathlib import Path

import pytest

from pdrbench.building.connectivity import lift_shafts, reachable_parts
from pdrbench.building.convex import compile_map
from pdrbench.errors import MapError
from pdrbench_formats.detect import detect, read_plan

pytestmark = pytest.mark.data


def test_westport_house_can_be_walked_from_the_lowest_to_the_highest_level(data_root: Path) -> None:
    plan = read_plan(data_root / "maps/westport_house/westport-house.zip")
    building = plan.building
    assert (plan.source, len(building.levels), len(lift_shafts(building))) == ("wrld3d", 7, 5)
    parts = reachable_parts(building, by_lift=False)
    reached = [building.polygons[i] for i, part in enumerate(parts) if part == 0]
    assert {polygon.level for polygon in reached} == set(building.levels)
    assert sum(polygon.kind == "stairs" for polygon in reached) >= 350
    assert len(compile_map(building)) > 0


def test_a_school_of_mappedin_is_read(data_root: Path) -> None:
    (path,) = sorted((data_root / "samples/mvf").glob("*.zip"))
    plan = read_plan(path)
    assert (plan.source, len(plan.building.levels)) == ("mvf", 4)
    assert sum("/door" in polygon.id for polygon in plan.building.polygons) > 200


def test_a_plan_without_levels_is_refused(tmp_path: Path) -> None:
    (tmp_path / "main.json").write_text('{"levels": [], "z_order": 0}')
    assert detect(tmp_path) == "wrld3d"
    with pytest.raises(MapError, match="names no level"):
        read_plan(tmp_path)
