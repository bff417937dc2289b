"""Doors that a plan lacks: every room is opened to the corridor beside it, and nothing else moves."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from shapely import affinity, box

from pdrbench_formats.detect import read_plan
from pdrbench_formats.maps.builder import BuildingBuilder
from pdrbench_formats.maps.openings import is_guessed, with_doors
from pdrbench_formats.maps.plan import Plan, unreachable


def rooms_along(corridor_m: float, wall_m: float, rng: np.random.Generator) -> dict[str, Any]:
    """A corridor with rooms of random widths on both sides, a wall between each two, and none with a door."""
    rooms = {"corridor": box(0, 0, corridor_m, 2)}
    for side in (-1, 1):
        left_m = 0.0
        while left_m + 2.5 < corridor_m:
            right_m = min(left_m + rng.uniform(2.5, 6.0), corridor_m)
            low_m = 2 + wall_m if side > 0 else -wall_m - 4
            rooms[f"room-{len(rooms)}"] = box(left_m, low_m, right_m, low_m + 4)
            left_m = right_m + wall_m
    return rooms


def drawn(rooms: dict[str, Any], turn_deg: float) -> Plan:
    builder = BuildingBuilder("rooms").add_level(0)
    for name, shape in rooms.items():
        builder.add_walkable(affinity.rotate(shape, turn_deg, origin=(0, 0)), id=name)
    return Plan(builder.build())


@pytest.mark.parametrize("wall_m", [0.0, 0.004, 0.2, 0.45])
@pytest.mark.parametrize("turn_deg", [0.0, 31.0])
def test_each_room_is_opened_to_the_corridor(wall_m: float, turn_deg: float) -> None:
    plan = drawn(rooms_along(40.0, wall_m, np.random.default_rng(3)), turn_deg)
    lost = int(unreachable(plan.building).sum())
    assert f"{lost} of {lost + 1} rooms have no way in" in with_doors(plan, "none").warnings[0]
    opened = with_doors(plan, "nearest")
    doors = [polygon for polygon in opened.building.polygons if is_guessed(polygon)]
    corridor = next(k for k, polygon in enumerate(opened.building.polygons) if polygon.id == "0/corridor")
    assert len(doors) == lost == len(opened.repairs) and not unreachable(opened.building).any()
    assert all(corridor in door.neighbour for door in doors)
    walls_m2 = 0.9 * wall_m * lost if wall_m >= 0.1 else 0.0  # of a thin wall the floor behind it is taken
    assert opened.building.area_m2 == pytest.approx(plan.building.area_m2 + walls_m2, abs=0.01 * lost)


def test_a_wide_opening_leaves_the_jambs() -> None:
    plan = with_doors(drawn({"hall": box(0, 0, 10, 10), "shop": box(10, 2, 16, 8)}, 0.0), "wide")
    (door,) = (polygon for polygon in plan.building.polygons if is_guessed(polygon))
    assert np.ptp(door.outline_xy_m[:, 1]) == pytest.approx(6.0 - 0.2, abs=0.05)


def test_what_is_far_from_all_else_is_a_house_where_it_is_large() -> None:
    rooms = {"hall": box(0, 0, 10, 10), "barn": box(30, 0, 40, 9), "shed": box(60, 0, 63, 3)}
    plan = with_doors(drawn(rooms, 0.0), "nearest")
    lost = unreachable(plan.building)
    assert [polygon.id for polygon, is_lost in zip(plan.building.polygons, lost, strict=True) if is_lost] == ["0/shed"]
    assert "1 of 3 rooms have no way in" in plan.warnings[0] and "no other room lies beside" in plan.warnings[0]


def test_map_check_says_first_who_is_shut_out_and_its_remedy_opens(command: Any, tmp_path: Path) -> None:
    features = [
        {
            "type": "Feature",
            "properties": {"indoor": "room" if name.startswith("room") else "corridor", "level": "0"},
            "geometry": {"type": "Polygon", "coordinates": [(np.array(shape.exterior.coords) * 1e-5).tolist()]},
        }
        for name, shape in rooms_along(40.0, 0.0, np.random.default_rng(3)).items()
    ]
    path = tmp_path / "mall.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "features": features}))
    told = command("map", "check", path).out.splitlines()[0]
    assert "rooms have no way in" in told and "--doors nearest" in told
    out = tmp_path / "plan.html"
    answer = command("map", "check", path, "--doors", "nearest", "--out", out)
    assert "are guessed" in answer.out.splitlines()[0] and "door guessed" in out.read_text()
    assert not unreachable(read_plan(path, doors="nearest").building).any()
    assert command("map", "check", path, "--doors", "many").code == 1
