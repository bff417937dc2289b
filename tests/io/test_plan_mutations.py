"""Plans changed by chance, member by member: a reader raises the documented error, or gives a building."""

from __future__ import annotations

import os
import warnings
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from plan_mutations import changed, pick
from plan_samples import FOREIGN, MADE, dxf, feature, house, picture, plain, rectangle

from pdrbench.building.connectivity import reachable_parts
from pdrbench.errors import MapError, PdrbenchError
from pdrbench_formats.detect import read_plan
from pdrbench_formats.maps.assembly.doors import doorway_beside
from pdrbench_formats.maps.assembly.shapes import eroded
from pdrbench_formats.maps.stacks import _overlap

NUM = int(os.environ.get("PLAN_MUTATIONS", "6"))  # of each format
PLANS: dict[str, Callable[[Path], Path]] = {
    **{name: make for name, (make, _) in MADE.items()},
    **{name: FOREIGN[name] for name in ("indoorgml 1.0", "patches", "overpass out geom", "nested tags")},
    "geojson_plan": lambda folder: plain(house(), folder / "house.geojson"),
}


def mutated(rng: np.random.Generator, path: Path, whole: bytes) -> None:
    """Writes a plan in which it, or one member of its archive, is changed."""
    path.write_bytes(whole)
    if not zipfile.is_zipfile(path):
        path.write_bytes(changed(rng, whole, path.name))
        return
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    name = pick(rng, sorted(members))
    with zipfile.ZipFile(path, "w") as archive:
        for member, content in (members | {name: changed(rng, members[name], name)}).items():
            archive.writestr(member, content)


@pytest.mark.parametrize("kind", PLANS)
def test_a_changed_plan_is_a_building_or_the_documented_error(kind: str, tmp_path: Path) -> None:
    for needed in {"picture": ("skimage",), "ros_map": ("skimage",), "dxf": ("ezdxf",)}.get(kind, ()):
        pytest.importorskip(needed)
    rng, path = np.random.default_rng(list(kind.encode())), PLANS[kind](tmp_path)
    worst = path.with_name("map.pgm") if kind == "ros_map" else path
    whole = worst.read_bytes()
    for _ in range(NUM):
        mutated(rng, worst, whole)
        with warnings.catch_warnings(action="ignore"):  # of numbers that overflow
            try:
                plan = read_plan(path, doors="nearest")
            except PdrbenchError as error:
                assert str(path.parent) in str(error), error
                continue
        assert len(reachable_parts(plan.building)) == len(plan.building.polygons)


def test_a_large_picture_is_thinned_and_its_walls_are_kept(tmp_path: Path) -> None:
    pytest.importorskip("skimage")
    from PIL import Image

    path = picture(tmp_path)
    small = read_plan(path)
    Image.open(path).resize((2400, 1200), Image.Resampling.NEAREST).convert("RGBA").save(path)
    path.with_suffix(".toml").write_text('[[level]]\nimage = "ground.png"\nmetres_per_pixel = 0.005\n')
    large = read_plan(path)
    assert "picture thinned" in str(large.repairs)
    areas = [sorted(polygon.area_m2 for polygon in plan.building.polygons) for plan in (small, large)]
    assert areas[1] == pytest.approx(areas[0], rel=0.01)


def test_of_the_specks_of_a_scan_the_largest_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("skimage")
    from PIL import Image

    monkeypatch.setattr("pdrbench_formats.maps.raster.MAX_PARTS", 2)  # what lies outside is one
    path = picture(tmp_path)
    clean_m2 = sum(polygon.area_m2 for polygon in read_plan(path).building.polygons)
    image = Image.open(path)
    for side, left in ((40, 60), (60, 160), (50, 350)):
        image.paste(0, (left, 100, left + side, 100 + side))
    image.save(path)
    plan = read_plan(path)
    assert any("holes in it: all but the 2 largest" in repair.what for repair in plan.repairs)
    specked_m2 = sum(polygon.area_m2 for polygon in plan.building.polygons)
    assert clean_m2 - specked_m2 == pytest.approx((60 * 0.02) ** 2, abs=0.1)


def test_damage_that_a_fuzzer_found_in_pictures_is_the_documented_error(tmp_path: Path) -> None:
    pytest.importorskip("skimage")
    path = picture(tmp_path)
    image, table = path.with_suffix(".png"), path.with_suffix(".toml")
    whole, chunk, header = image.read_bytes(), b"iCCPa profile with a name and nothing else", 8 + 25
    damaged = (len(chunk) - 4).to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big")
    image.write_bytes(whole[:header] + damaged + whole[header:])
    with pytest.raises(MapError, match="no picture that can be read"):
        read_plan(path)
    image.write_bytes(whole)
    table.write_text("metres_per_pixel = 1\nlevel = " + 4000 * "[")
    with pytest.raises(MapError, match="nested too deeply"):
        read_plan(table)


def test_a_floor_with_many_holes_shrinks_as_a_buffer_does(rng: np.random.Generator) -> None:
    """Holes that run into one another when they grow, one in a part that lies in a hole of another."""
    dots = shapely.points(rng.uniform(0.5, 19.5, (150, 2))).tolist()
    holes = shapely.union_all(shapely.buffer(dots, 0.2, quad_segs=2))
    yard = shapely.box(0, 0, 40, 20).difference(shapely.box(21, 1, 39, 19))
    floor = yard.difference(holes).union(shapely.box(25, 5, 35, 15).difference(shapely.box(28, 8, 30, 10)))
    assert shapely.symmetric_difference(eroded(floor, 0.4), floor.buffer(-0.4)).area < 1e-3 * floor.area


def test_copies_knots_and_far_vertices_change_little(tmp_path: Path) -> None:
    drawing = pytest.importorskip("ezdxf").readfile(path := dxf(tmp_path, in_block=True))
    drawing.blocks.get("WALLS").add_blockref("WALLS", (0, 0))
    plans = [read_plan(path), (drawing.saveas(path), read_plan(path))[1]]
    ring = [(x + k * 1e-5, y) for k in range(300) for x, y in rectangle(1, 1, 1.1, 1.1)]
    copies = [feature("room", "Polygon", [rectangle(0, 0, 5 - k * 1e-5, 4)], level=0, id=f"{k}") for k in range(300)]
    for more in ([], copies, [feature("wall", "LineString", ring, level=0)]):
        plans.append(read_plan(plain(house() + more, tmp_path / "a.geojson")))
    areas = [sum(polygon.area_m2 for polygon in plan.building.polygons) for plan in plans]
    assert areas == pytest.approx([areas[0], areas[0], areas[2], areas[2], areas[2] - 0.04], abs=1e-2)
    room, triangles = shapely.box(0, -4, 6, -0.2), [shapely.Polygon([(0, 0), (6, 0), (x, 3)]) for x in (6, 5e4)]
    assert shapely.equals_exact(*(doorway_beside(shape, [room], 0.9) for shape in triangles), 1e-6)
    assert _overlap(shapely.Polygon(ring), shapely.box(0, 0, 2, 2)) <= 1
