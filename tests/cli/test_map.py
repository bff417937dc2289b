"""`pdrbench map check`: what is listed, what is drawn, and what a walk crosses."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdrbench.recording import Recording
from pdrbench.trajectory import Trajectory
from pdrbench_formats.pages.map_check import check_walk
from pdrbench_formats.recordings import native
from pdrbench_sim.buildings.assembly import one_room

ROOM = [[0, 0], [6, 0], [6, 4], [0, 4], [0, 0]]


def plan(folder: Path) -> Path:
    """Two rooms with a door between them on level 0, a third that none leads to, and a level 1 that nothing joins."""
    features: list[dict[str, Any]] = []

    def add(kind: str, geometry: str, coordinates: Any, level: int) -> None:
        shape = {"type": geometry, "coordinates": coordinates}
        id = f"{kind}-{len(features)}"
        properties = {"feature": kind, "level": level}
        features.append({"type": "Feature", "id": id, "properties": properties, "geometry": shape})

    for k in range(3):
        add("room", "Polygon", [[[x + 6 * k, y] for x, y in ROOM]], 0)
    add("door", "LineString", [[6, 1], [6, 2]], 0)
    add("room", "Polygon", [ROOM], 1)
    path = folder / "plan.geojson"
    path.write_text(json.dumps({"type": "FeatureCollection", "units": "metres", "features": features}))
    return path


def walk(folder: Path, xy_m: Any) -> Path:
    way = np.array(xy_m, dtype=np.float64)
    reference = Trajectory(
        t_s=np.arange(len(way)) * 1.0,
        xy_m=way,
        level=np.zeros(len(way), dtype=np.int64),
        surveyed=np.ones(len(way), dtype=np.bool_),
    )
    native.write(Recording(id="walk", building=None, streams={}, reference=reference), folder / "walk")
    return folder / "walk"


def test_unreachable_rooms_lonely_levels_and_crossed_walls_are_listed(command: Any, tmp_path: Path) -> None:
    way = walk(tmp_path, [[3, 1.5], [9, 1.5], [9, 3], [3, 3], [3, 9]])
    answer = command("map", "check", plan(tmp_path), "--walk", way, "--json")
    assert answer.code == 0
    facts = answer.json
    assert [row["level"] for row in facts["levels"]] == [0, 1]
    assert [row["area_m2"] for row in facts["unreachable"]] == [24.0]
    assert facts["unconnected_levels"] == [0, 1]
    assert facts["walk"]["walls_crossed"] == 2  # back beside the door, and out of the building
    assert facts["walk"]["outside"] == 1
    assert "height assumed" in {repair["kind"] for repair in facts["repairs"]}


@pytest.mark.parametrize("suffix", ["html", "png"])
def test_a_plan_is_drawn(command: Any, tmp_path: Path, suffix: str) -> None:
    out = tmp_path / f"plan.{suffix}"
    assert command("map", "check", plan(tmp_path), "--out", out).code == 0
    content = out.read_bytes()
    assert content.startswith(b"\x89PNG") if suffix == "png" else b"<svg" in content and b"no way leads here" in content


def test_a_page_shows_every_level_and_the_walk_larger(command: Any, tmp_path: Path) -> None:
    out, way = tmp_path / "plan.html", walk(tmp_path, [[3, 1.5], [9, 1.5], [9, 3], [3, 3]])
    assert command("map", "check", plan(tmp_path), "--walk", way, "--out", out).code == 0
    page = out.read_text()
    captions = re.findall("<figcaption>(.*?)</figcaption>", page)
    assert captions == ["level 0", "level 1", "the walk on level 0"]
    assert page.count("<svg") == len(captions)
    assert "walls crossed: 1" in page and "<h2>walls crossed by the walk</h2>" in page


def test_another_ending_and_a_file_without_a_plan_are_refused(command: Any, tmp_path: Path) -> None:
    assert "name one" in command("map", "check", plan(tmp_path), "--out", tmp_path / "plan.docx").err
    way = walk(tmp_path, [[3, 1], [4, 1]])
    assert "is no map" in command("map", "check", way).err


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ([[-1.0, 0.0], [0.0, 1.0]], "mirrored left to right"),
        ([[1.0, 0.0], [0.0, -1.0]], "mirrored top to bottom"),
        ([[0.3048, 0.0], [0.0, 0.3048]], "in feet"),
        ([[1.0, 0.0], [0.0, 1.0]], ""),
    ],
)
def test_a_mirrored_plan_and_one_in_feet_are_named(
    change: list[list[float]], said: str, rng: np.random.Generator
) -> None:
    corners = np.array([[50, 20], [90, 20], [90, 30], [58, 30], [58, 50], [50, 50]])
    building = one_room("L", corners)
    _, xy_m = building.sample_uniform(rng, 200)
    middle = np.zeros(2) if "feet" in said else np.array([70.0, 35.0])
    moved = (xy_m - middle) @ np.array(change).T + middle
    way = Trajectory(np.arange(200.0), moved, np.zeros(200, dtype=np.int64), np.ones(200, dtype=np.bool_))
    warnings = check_walk(building, way).warnings
    assert bool(warnings) == bool(said)
    assert not said or said in warnings[0]
