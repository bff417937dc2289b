"""Plans in formats that people have: small ones made here, real ones where they are found, and bad ones."""

from __future__ import annotations

import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from plan_samples import (
    FOREIGN,
    MADE,
    degrees,
    document,
    dxf,
    feature,
    house,
    imdf,
    indoorgml,
    osm,
    osm_elements,
    osm_xml,
    packed,
    plain,
    rectangle,
    ros_map,
    scaled,
    turned_lat_lon,
    written,
    written_bytes,
    written_text,
)

from pdrbench.building.connectivity import lift_shafts, reachable_parts
from pdrbench.building.convex import compile_map
from pdrbench.datasets import find, is_available
from pdrbench.errors import MapError, PdrbenchError, RecordingError
from pdrbench_formats.detect import detect, read_plan
from pdrbench_formats.maps.plan import Plan, unreachable


def is_whole(plan: Plan) -> bool:
    """Whether one can walk everywhere, and the fast map walk can be compiled."""
    return bool((reachable_parts(plan.building) == 0).all()) and len(compile_map(plan.building)) > 0


@pytest.mark.parametrize("units", ["metres", "feet", "degrees", ""])
def test_the_documented_geojson_in_any_unit(tmp_path: Path, units: str) -> None:
    changes = {"feet": lambda p: [p[0] / 0.3048, p[1] / 0.3048], "degrees": degrees, "": degrees}
    features = scaled(house(), changes.get(units, list))
    plan = read_plan(written(tmp_path / "house.geojson", document(features, units=units)))
    assert plan.source == "geojson_plan"
    assert is_whole(plan)
    assert plan.building.levels == (0, 1)
    assert plan.building.area_m2 == pytest.approx(2 * (40 + 4) + 15, rel=0.15)
    assert len(lift_shafts(plan.building)) == 1
    assert (plan.geo is not None) == (units in ("degrees", ""))
    assert ("units assumed" in {repair.kind for repair in plan.repairs}) == (not units)
    assert {zone.name for zone in plan.building.zones} == {"Lab"}


def dxf_in(folder: Path, per_m: float, insunits: int, *, columns: int = 0, door: bool = True) -> Path:
    """A floor of 12 by 8 m with a door of 0.9 m between two rooms, in any unit and under any header."""
    ezdxf = pytest.importorskip("ezdxf")
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = insunits
    space = drawing.modelspace()
    walls = [[(0, 0), (12, 0), (12, 8), (0, 8), (0, 0)], [(6, 0), (6, 3.5)], [(6, 4.4), (6, 8)]]
    for layer, line in [*(("A-WALL", wall) for wall in walls), *[("A-DOOR", [(6, 3.5), (6, 4.4)])] * door]:
        space.add_lwpolyline([(x * per_m, y * per_m) for x, y in line], dxfattribs={"layer": layer})
    for x in np.append(np.arange(1.0, 5.0, 1.5), np.arange(7.5, 11.0, 1.5))[:columns]:
        space.add_circle((x * per_m, 2.0 * per_m), 0.3 * per_m, dxfattribs={"layer": "A-WALL"})
    space.add_ellipse((1.0, 1.0), (5.0, 1e300), dxfattribs={"layer": "A-WALL"})  # nowhere, and left out
    drawing.saveas(folder / "plan.dxf")
    return folder / "plan.dxf"


@pytest.mark.parametrize("insunits", [0, 1, 4, 5, 6])
@pytest.mark.parametrize(("per_m", "own"), [(1000.0, 4), (100.0, 5), (1.0, 6), (1 / 0.0254, 1), (1 / 0.3048, 2)])
def test_a_door_says_in_which_unit_a_drawing_is(tmp_path: Path, per_m: float, own: int, insunits: int) -> None:
    plan = read_plan(dxf_in(tmp_path, per_m, insunits))
    x0, y0, x1, y1 = plan.building.bounds_m()
    assert (x1 - x0, y1 - y0) == pytest.approx((12.0, 8.0), rel=0.02)
    notes = [repair.kind for repair in plan.repairs if repair.kind.startswith("units")]
    assert notes == ["units assumed" if insunits == 0 else "units doubtful"] * (insunits != own)
    if "units doubtful" in notes:
        assert 'unit = "mm"' in next(repair.what for repair in plan.repairs if repair.kind == "units doubtful")


def test_a_plan_toml_states_the_unit(tmp_path: Path) -> None:
    dxf_in(tmp_path, 1000.0, 1, door=False)
    (tmp_path / "plan.toml").write_text('unit = "mm"\n[[level]]\ndrawing = "plan.dxf"\n')
    plan = read_plan(tmp_path / "plan.toml")
    assert plan.building.bounds_m()[2] == pytest.approx(12.0, rel=0.02)
    assert {repair.kind for repair in plan.repairs} == {"door found"}


def test_round_columns_have_few_vertices(tmp_path: Path) -> None:
    building = read_plan(dxf_in(tmp_path, 100.0, 5, columns=6)).building
    holes = [len(hole) for polygon in building.polygons for hole in polygon.holes]
    assert len(holes) == 6 and max(holes) <= 64
    assert building.area_m2 == pytest.approx(93.3 - 6 * 0.09 * np.pi, abs=0.3)


@pytest.mark.parametrize("kind", MADE)
def test_every_format_is_recognised_and_makes_rooms_with_doors(tmp_path: Path, kind: str) -> None:
    make, levels = MADE[kind]
    if kind in ("picture", "ros_map"):
        pytest.importorskip("skimage")
    path = make(tmp_path)
    assert detect(path) == kind
    plan = read_plan(path)
    assert plan.building.levels == levels
    assert is_whole(plan)
    assert sum("/door" in polygon.id for polygon in plan.building.polygons) >= len(levels)
    assert plan.describe()["holds"] == "a map"


def test_a_map_of_ros_keeps_its_frame(tmp_path: Path) -> None:
    pytest.importorskip("skimage")
    building = read_plan(ros_map(tmp_path)).building
    assert building.bounds_m() == pytest.approx((-2.5, -2.0, 2.5, 2.0), abs=0.06)
    assert building.contains([[-1.0, 0.0], [0.05, -1.5]], 0).tolist() == [True, False]


def test_the_page_on_buildings_shows_what_works(tmp_path: Path) -> None:
    page = (Path(__file__).parents[2] / "docs" / "buildings.md").read_text()
    (example,) = re.findall(r"```json\n(.*?)```", page, re.DOTALL)
    (program,) = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    assert is_whole(read_plan(written(tmp_path / "house.geojson", json.loads(example))))
    names: dict[str, Any] = {}
    exec(program, names)
    assert names["building"].levels == (0, 1)


def millimetres(place: tuple[float, float]) -> list[float]:
    return [place[0] * 1e3, place[1] * 1e3]


NEED_SKIMAGE = {"nav2"}


@pytest.mark.parametrize("variant", FOREIGN)
def test_what_other_producers_write_is_read_right(tmp_path: Path, variant: str) -> None:
    if variant in NEED_SKIMAGE:
        pytest.importorskip("skimage")
    plan = read_plan(FOREIGN[variant](tmp_path))
    assert is_whole(plan)
    assert sum("/door" in polygon.id for polygon in plan.building.polygons) >= len(plan.building.levels)
    expected_m2 = {"indoorgml": 31.0, "dxf": 38.3, "picture": 41.0, "ros_map": 19.5}.get(plan.source)
    expected_m2 = expected_m2 or floor_m2(read_plan(plain(house(), tmp_path / "house.geojson")))
    assert floor_m2(plan) == pytest.approx(expected_m2, rel=0.02)


def floor_m2(plan: Plan) -> float:
    return sum(polygon.area_m2 for polygon in plan.building.polygons if polygon.kind == "floor")


def dxf_levels(folder: Path) -> Path:
    """A hall on two levels with a stair and a lift in it, far from the origin; a table says which drawing is which."""
    ezdxf = pytest.importorskip("ezdxf")
    table = ""
    for level in (0, 1):
        drawing = ezdxf.new()
        drawing.header["$INSUNITS"] = 6
        for layer, outline in (
            ("A-WALL", rectangle(100, 200, 116, 204)),
            ("A-FLOR-STRS", rectangle(110, 200.5, 115, 202.9)),
            ("A-FLOR-EVTR", rectangle(106, 202, 107.6, 203.7)),
        ):
            drawing.modelspace().add_lwpolyline(outline[:-1], close=True, dxfattribs={"layer": layer})
        drawing.saveas(folder / f"level{level}.dxf")
        table += f'[[level]]\ndrawing = "level{level}.dxf"\nlevel = {level}\nheight_m = {3.4 * level}\n'
    return written_text(folder / "plan.toml", table)


def test_drawings_of_several_levels_are_joined_by_stairs_and_lifts_above_one_another(tmp_path: Path) -> None:
    plan = read_plan(dxf_levels(tmp_path))
    assert plan.source == "dxf" and plan.building.levels == (0, 1)
    assert len(lift_shafts(plan.building)) == 1
    assert bool((reachable_parts(plan.building, by_lift=False) == 0).all())
    assert plan.building.bounds_m() == pytest.approx((0.05, 0.05, 15.95, 3.95), abs=0.02)
    (tmp_path / "plan.toml").unlink()
    with pytest.raises(MapError, match=r"2 drawings; say in a plan.toml"):
        read_plan(tmp_path)


def test_a_folder_with_a_collection_for_each_level_is_one_plan(tmp_path: Path) -> None:
    folder = tmp_path / "house" / "levels"
    folder.mkdir(parents=True)
    joins = {"stairs", "lift"}
    for level in (0, 1):
        own = [one for one in house() if one["properties"].get("level") == level]
        own += [one for one in house() if one["properties"]["feature"] in joins and level == 0]
        written(folder / f"{level}.geojson", {**document(own), "levels": [{"level": level, "height_m": 3.4 * level}]})
    plan = read_plan(tmp_path / "house")
    assert is_whole(plan) and plan.building.levels == (0, 1)
    assert plan.building.area_m2 == pytest.approx(read_plan(plain(house(), tmp_path / "one.geojson")).building.area_m2)
    written(folder / "1.geojson", document([house()[3]], units="feet"))
    with pytest.raises(MapError, match="name the same in each"):
        read_plan(tmp_path / "house")


def osm_of(folder: Path, text: str) -> Path:
    return written_text(folder / "a.osm", text)


def toml_of(folder: Path, image: str) -> Path:
    return written_text(folder / "plan.toml", f'[[level]]\nimage = "{image}"\nmetres_per_pixel = 0.02\n')


def noise(folder: Path) -> Path:
    from PIL import Image

    Image.fromarray(np.random.default_rng(0).random((1000, 1000)) < 0.7).save(folder / "plan.png")
    return written_text(folder / "plan.toml", '[[level]]\nimage = "plan.png"\nmetres_per_pixel = 0.1\n')


# six doors each way, as wide to the north as to the east
DOORS = [line for k in range(6) for line in ([(5, k), (5, k + 0.6)], [(k + 0.2, 4), (k + 0.8, 4)])]
ALONG = [*house()[:2], *(feature("door", "LineString", line, level=0) for line in DOORS)]
REFUSED: dict[str, tuple[Callable[[Path], Path], str]] = {
    "noise": (lambda p: noise(p), "as noise or a photograph"),
    "a feature alone": (lambda p: written(p / "a.geojson", house()[0]), "a Feature alone"),
    "exchanged": (
        lambda p: plain(scaled(house(), turned_lat_lon), p / "a.json", units="degrees"),
        "latitude look swapped",
    ),
    "exchanged along the meridian": (
        lambda p: plain(scaled(ALONG, lambda q: degrees(q)[::-1]), p / "a.json", units="degrees"),
        "its short edges are 63% longer along one axis, 0% with the two exchanged",
    ),
    "other words": (
        lambda p: plain([{**one, "properties": {"what": "room", "floor": 0}} for one in house()], p / "a.json"),
        "its properties are floor, level, what",
    ),
    "lists of rows and of numbers": (lambda p: written(p / "a.json", {"a": [{"b": [{}]}, {"b": [0]}, {}]}), "a.json"),
    "unit": (lambda p: plain(house(), p / "a.geojson", units="yards"), "a.geojson: no unit of length"),
    "cut gzip": (
        lambda p: written_bytes(p / "a.geojson.gz", packed(plain(house(), p / "a.geojson")).read_bytes()[:-200]),
        "the gzip data ends too early",
    ),
    "no answer": (
        lambda p: written(p / "a.json", {"osm3s": {}, "elements": [], "nodes": 0, "remark": "timed out"}),
        "said 'timed out'",
    ),
    "pbf": (lambda p: written_bytes(p / "a.osm.pbf", b"\0\0\0\x0d\n\tOSMHeader" + bytes(50)), "osmium cat"),
    "named levels": (
        lambda p: written_text(
            p / "a.osm", osm_xml(osm_elements()).replace("'0-1'", "'roof'").replace('"0-1"', '"roof"')
        ),
        "level is 'roof'",
    ),
    "indoorgml 2.0": (lambda p: indoorgml(p, version="2.0"), "IndoorGML 2.0"),
    "cells in degrees": (lambda p: indoorgml(p, change=lambda q: (51 + q[1] * 1e-5, 13 + q[0] * 1e-5)), "degrees"),
    "levels without heights": (lambda p: indoorgml(p, z_m=(0.0, 0.0)), "cover one another"),
    "citygml": (
        lambda p: written_text(p / "a.gml", "<c:CityModel xmlns:c='http://www.opengis.net/citygml/2.0'/>"),
        "CityGML",
    ),
    "dwg": (lambda p: written_bytes(p / "a.dwg", b"AC1032\0\0" + bytes(50)), "save it as DXF"),
    "unnamed layers": (lambda p: dxf(p, ("L1", "L2")), "layers with drawings: A-ANNO, L1, L2"),
    "no such encoding": (lambda p: osm_of(p, "<?xml version='1.0' encoding='UnF-16'?><osm/>"), "unknown encoding"),
    "wide encoding": (lambda p: osm_of(p, "<?xml version='1.0' encoding='shift-jis'?><osm/>"), "multi-byte"),
    "entities": (lambda p: osm_of(p, "<!DOCTYPE osm [<!ENTITY b 'bb'>]><osm>&b;</osm>"), "entities"),
    "depth": (lambda p: osm_of(p, f"<osm>{'<a>' * 9999}{'</a>' * 9999}</osm>"), "levels; export"),
    "dimension": (
        lambda p: written_text(
            p / "a.gml", indoorgml(p).read_text().replace("gml:pos>", "gml:pos srsDimension='x'>", 1)
        ),
        "holds no numbers",
    ),
    "long name": (lambda p: toml_of(p, "a" * 999), "a' is no file beside it"),
    "no name": (lambda p: toml_of(p, "a\\u0000.png"), "'a\\x00.png' is no file beside it"),
    "endless origin": (
        lambda p: written_text(p / "map.yaml", ros_map(p).read_text().replace("-2.5, 0.0", "inf, inf")),
        "origin is [-3.0, inf, inf]",
    ),
    "elsewhere": (lambda p: toml_of(p, "../x.png"), "'../x.png' is no file beside it"),
    "pdf": (lambda p: written_bytes(p / "a.pdf", b"%PDF-1.4"), "save the page as PNG"),
}


@pytest.mark.parametrize("variant", REFUSED)
def test_what_cannot_be_read_is_refused_with_file_and_remedy(tmp_path: Path, variant: str) -> None:
    make, why = REFUSED[variant]
    path = make(tmp_path)
    with pytest.raises((MapError, RecordingError), match=re.escape(why)) as error:
        read_plan(path)
    assert path.name in str(error.value)


def _without(member: str) -> Callable[[list[dict[str, Any]]], Any]:
    def change(features: list[dict[str, Any]]) -> None:
        del features[0]["properties"][member]

    return change


def _ring(ring: Any) -> Callable[[list[dict[str, Any]]], Any]:
    def change(features: list[dict[str, Any]]) -> None:
        features[0]["geometry"]["coordinates"] = [ring]

    return change


BAD: dict[str, tuple[Callable[[list[dict[str, Any]]], Any], str]] = {
    "unclosed": (_ring(rectangle(0, 0, 5, 4)[:-1]), "not closed"),
    "unknown feature": (lambda features: features[0]["properties"].update(feature="rom"), "did you mean 'room'"),
    "missing level": (_without("level"), "level is None"),
    "level is text": (lambda features: features[0]["properties"].update(level="roof"), "whole number"),
    "not a number": (_ring([(0, 0), (1, "x"), (1, 1), (0, 0)]), "two finite numbers"),
    "unknown geometry": (lambda features: features[0]["geometry"].update(type="Circle"), "Circle"),
    "wrong nesting": (lambda features: features[0]["geometry"].update(coordinates=[1, 2]), "nested wrongly"),
    "one level": (lambda features: features[-1]["properties"].update(levels=[0]), "two levels or more"),
}
MENDED: dict[str, tuple[Callable[[list[dict[str, Any]]], Any], str]] = {
    "three-dimensional": (_ring([(*place, 1.0) for place in rectangle(0, 0, 5, 4)]), "geometry"),
    "empty": (lambda features: features.append(feature("room", "Polygon", [], level=0)), "geometry"),
    "crossing itself": (_ring([(0, 0), (5, 4), (5, 0), (0, 4), (0, 0)]), "self-intersection"),
    "duplicate id": (lambda features: features[0].update(id=features[1]["id"]), "duplicate id"),
    "multipolygon": (
        lambda features: features[0].update(
            geometry={"type": "MultiPolygon", "coordinates": [[rectangle(0, 0, 5, 4)], [rectangle(0, 4, 1e-9, 5)]]}
        ),
        "sliver",
    ),
}


@pytest.mark.parametrize("bad", BAD)
def test_a_bad_plan_gives_one_clear_error(tmp_path: Path, bad: str) -> None:
    features = house()
    change, why = BAD[bad]
    change(features)
    with pytest.raises(PdrbenchError, match=f"bad.geojson.*{why}"):
        read_plan(written(tmp_path / "bad.geojson", document(features)))


@pytest.mark.parametrize("mended", MENDED)
def test_what_can_be_mended_is_mended_and_listed(tmp_path: Path, mended: str) -> None:
    features = house()
    change, kind = MENDED[mended]
    change(features)
    plan = read_plan(written(tmp_path / "mended.geojson", document(features)))
    assert kind in {repair.kind for repair in plan.repairs}


def test_swapped_degrees_and_too_many_vertices_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    east = [
        {**one, "geometry": {**one["geometry"], "coordinates": json.loads(json.dumps(one["geometry"]["coordinates"]))}}
        for one in scaled(house(), lambda p: [51.0 + p[1] * 1e-5, 113.0 + p[0] * 1e-5])
    ]
    with pytest.raises(MapError, match="swapped"):
        read_plan(written(tmp_path / "swapped.geojson", document(east, units="degrees")))
    with pytest.raises(MapError, match="are they degrees"):
        read_plan(written(tmp_path / "named.geojson", document(scaled(house(), degrees))))
    monkeypatch.setattr("pdrbench_formats.maps.features.MAX_VERTICES", 20)
    with pytest.raises(MapError, match="vertices; simplify"):
        read_plan(written(tmp_path / "many.geojson", document(house())))


@pytest.mark.data
def test_a_real_building_can_be_walked_from_the_lowest_to_the_highest_level() -> None:
    path = "osm_apb/APBorig.osm"
    if not is_available("maps") or not (find("maps") / path).exists():
        pytest.skip(f"no {path} below PDRBENCH_DATA")
    plan = read_plan(find("maps") / path)
    building = plan.building
    assert (plan.source, len(building.levels), len(lift_shafts(building))) == ("osm_indoor", 4, 2)
    parts = reachable_parts(building, by_lift=False)
    reached = [building.polygons[i] for i, part in enumerate(parts) if part == 0]
    assert {polygon.level for polygon in reached} == set(building.levels)
    assert sum(polygon.kind == "stairs" for polygon in reached) >= 250


def test_a_room_on_half_a_level_is_listed(tmp_path: Path) -> None:
    path = osm(tmp_path)
    text = path.read_text()
    room = text.replace('k="indoor" v="room"/><tag k="level" v="0-1"', 'k="indoor" v="room"/><tag k="level" v="0.5"', 1)
    assert room != text
    path.write_text(room)
    (found,) = [repair for repair in read_plan(path).repairs if repair.kind == "level left out"]
    assert "m² on level 0.5" in found.what


def test_half_levels_and_ramps_are_listed(tmp_path: Path) -> None:
    """A level of IMDF between two, and a corridor of OpenStreetMap that leads up without steps."""
    with zipfile.ZipFile(imdf(tmp_path)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    units, levels = (json.loads(members[f"{name}.geojson"]) for name in ("unit", "level"))
    levels["features"].append({**levels["features"][0], "id": "mezzanine", "properties": {"ordinal": 0.5}})
    units["features"].append({**units["features"][0], "id": "gallery", "properties": {"level_id": "mezzanine"}})
    folder = tmp_path / "venue"
    folder.mkdir()
    for name, content in members.items():
        (folder / name).write_bytes(content)
    written(folder / "unit.geojson", units)
    written(folder / "level.geojson", levels)
    plan = read_plan(folder)
    assert is_whole(plan)
    assert "gallery:  of 20.0 m² on level 0.5" in "".join(r.what for r in plan.repairs if r.kind == "level left out")
    text = osm(tmp_path).read_text()
    path = written_text(tmp_path / "ramp.osm", text.replace('k="stairs" v="yes"', 'k="ramp" v="yes"'))
    plan = read_plan(path)
    assert "straight flight" in next(repair.what for repair in plan.repairs if repair.kind == "ramp")
    assert is_whole(plan)


@pytest.mark.parametrize(
    ("per_pixel", "unit", "notes"), [(20.0, "mm", 0), (20.0, "", 1), (2.0, "", 1), (0.02 / 0.3048, "ft", 0)]
)
def test_a_picture_in_other_units(tmp_path: Path, per_pixel: float, unit: str, notes: int) -> None:
    pytest.importorskip("skimage")
    path = drawn(tmp_path)
    (tmp_path / "plan.toml").write_text(
        f'unit = "{unit}"\n[[level]]\nimage = "plan.png"\nmetres_per_pixel = {per_pixel}\n'
    )
    plan = read_plan(path)
    assert plan.building.bounds_m()[2] == pytest.approx(10.55, rel=0.02)
    assert sum(repair.kind == "units doubtful" for repair in plan.repairs) == notes


def drawn(folder: Path, *, light: str = "white", dark: str = "black", extra: str = "", text: str = "") -> Path:
    """Two rooms with a door between them, a table in one, and an entrance that may stand open."""
    from PIL import Image, ImageDraw

    wide, high = (1300, 800) if extra == "sheet" else (600, 400)
    draw = ImageDraw.Draw(image := Image.new("RGB", (wide, high), light))
    draw.rectangle([50, 50, 530, 340], outline=dark, width=5)
    draw.line([285, 50, 285, 340], fill=dark, width=5)
    draw.rectangle([280, 180, 290, 224], fill=light)
    draw.rectangle([90, 90, 140, 130], outline=dark, width=2)
    draw.text((350, 100), text, fill=dark, font_size=40)
    draw.rectangle([20, 20, wide - 30, high - 30], outline=dark, width=3 * (extra in ("frame", "sheet")))
    if extra == "gap":
        draw.rectangle([520, 180, 540, 224], fill=light)
    image.save(folder / "plan.png")
    (folder / "plan.toml").write_text('[[level]]\nimage = "plan.png"\nmetres_per_pixel = 0.02\n')
    return folder / "plan.png"


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ({}, "furniture left out"),
        ({"text": "ROOM 008"}, "furniture left out"),
        ({"extra": "gap"}, "walls not closed"),
        ({"extra": "frame"}, "frame"),
        ({"extra": "sheet"}, "frame"),
        ({"light": "#101020", "dark": "#e0e0e0"}, "light walls"),
        ({"dark": "#8080c8"}, "threshold found"),
    ],
)
def test_pictures_as_people_draw_them(tmp_path: Path, options: dict[str, Any], told: str) -> None:
    pytest.importorskip("skimage")
    plan = read_plan(drawn(tmp_path, **options))
    assert told in {repair.kind for repair in plan.repairs}
    assert plan.building.area_m2 == pytest.approx(9.4 * 5.6 - 0.8, rel=0.05) and not unreachable(plan.building).any()
    assert sum("/door" not in polygon.id for polygon in plan.building.polygons) == 2


def test_a_hall_with_a_closed_office_half_as_long_and_wide_is_no_frame(tmp_path: Path) -> None:
    pytest.importorskip("skimage")
    from PIL import Image, ImageDraw

    draw = ImageDraw.Draw(image := Image.new("L", (600, 400), 255))
    for corners in ([20, 20, 570, 370], [50, 50, 350, 300]):
        draw.rectangle(corners, outline=0, width=5)
    image.save(tmp_path / "plan.png")
    assert read_plan(toml_of(tmp_path, "plan.png")).building.area_m2 == pytest.approx(10.8 * 6.8, rel=0.05)


def test_web_mercator_is_told_by_the_widths_of_doors(tmp_path: Path) -> None:
    at, metre_m = (1.2e6, 6378137.0 * float(np.arcsinh(np.tan(np.radians(50.0))))), np.cos(np.radians(50.0))
    features = scaled(house(), lambda place: [at[k] + place[k] / metre_m for k in (0, 1)])
    plan = read_plan(written(tmp_path / "a.geojson", {"type": "FeatureCollection", "features": features}))
    assert plan.building.polygons[0].area_m2 == pytest.approx(20.0, rel=0.01) and plan.geo is not None
