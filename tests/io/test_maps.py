"""Plans in formats that people have: small ones made here, real ones where they are found, and bad ones."""

from __future__ import annotations

import itertools
import json
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdrbench.building.connectivity import lift_shafts, reachable_parts
from pdrbench.building.convex import compile_map
from pdrbench.datasets import find, is_available
from pdrbench.errors import MapError, PdrbenchError
from pdrbench.io.detect import detect, read_plan
from pdrbench.io.geo import GeoFrame
from pdrbench.io.plan import Plan

FRAME = GeoFrame(51.0, 13.0)
Ring = list[tuple[float, float]]


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Ring:
    return [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]


def feature(kind: str, geometry: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    return {
        "type": "Feature",
        "id": properties.pop("id", f"{kind}-{json.dumps(coordinates)[:40]}-{properties}"),
        "properties": {"feature": kind, **properties},
        "geometry": {"type": geometry, "coordinates": coordinates},
    }


def house() -> list[dict[str, Any]]:
    """Two rooms with a door on each of two levels, a stair and a lift beside them."""
    features = []
    for level in (0, 1):
        features.append(feature("room", "Polygon", [rectangle(0, 0, 5, 4)], level=level, name="Lab"))
        features.append(feature("area", "Polygon", [rectangle(5, 0, 10, 4)], level=level))
        features.append(feature("door", "LineString", [(5, 1), (5, 2)], level=level))
    features.append(feature("stairs", "Polygon", [rectangle(10, 0, 16, 2.5)], levels=[0, 1]))
    features.append(feature("lift", "Polygon", [rectangle(8, 4, 10, 6)], levels=[0, 1]))
    return features


def document(features: list[dict[str, Any]], **members: Any) -> dict[str, Any]:
    levels = [{"level": 0, "height_m": 0.0}, {"level": 1, "height_m": 3.4}]
    return {"type": "FeatureCollection", "units": "metres", "levels": levels, "features": features, **members}


def scaled(features: list[dict[str, Any]], change: Callable[[tuple[float, float]], Any]) -> list[dict[str, Any]]:
    def of(part: Any) -> Any:
        return change(part) if isinstance(part, tuple) else [of(inner) for inner in part]

    return [
        {**one, "geometry": {**one["geometry"], "coordinates": of(one["geometry"]["coordinates"])}} for one in features
    ]


def degrees(place: tuple[float, float]) -> list[float]:
    lat, lon = FRAME.to_geo(np.array(place))
    return [float(lon), float(lat)]


def written(path: Path, content: Any) -> Path:
    path.write_text(json.dumps(content))
    return path


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


def imdf(folder: Path) -> Path:
    """The house as an IMDF archive."""
    units, openings, levels = [], [], []
    for one in scaled(house(), degrees):
        kind = one["properties"]["feature"]
        for level in one["properties"].get("levels", [one["properties"].get("level")]):
            base = {"type": "Feature", "id": f"{one['id']}/{level}", "geometry": one["geometry"]}
            category = {"room": "office", "area": "walkway", "stairs": "stairs", "lift": "elevator"}.get(kind)
            properties = {"level_id": f"L{level}", "category": category or "pedestrian", "name": {"en": kind}}
            (openings if kind == "door" else units).append({**base, "properties": properties})
    for level in (0, 1):
        geometry = scaled([feature("x", "Polygon", [rectangle(0, 0, 16, 6)])], degrees)[0]["geometry"]
        levels.append({"type": "Feature", "id": f"L{level}", "geometry": geometry, "properties": {"ordinal": level}})
    address = [{"type": "Feature", "id": "a", "geometry": None, "properties": {"address": "x"}}]
    path = folder / "venue.zip"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("manifest.json", json.dumps({"version": "1.0.0", "language": "en"}))
        for name, features in (("unit", units), ("opening", openings), ("level", levels), ("address", address)):
            archive.writestr(f"{name}.geojson", json.dumps({"type": "FeatureCollection", "features": features}))
    return path


def osm(folder: Path) -> Path:
    """The house in Simple Indoor Tagging, as XML: doors are nodes, stair and lift name both levels."""
    nodes, ways = [], []

    def node(place: tuple[float, float], tags: str = "") -> int:
        lon, lat = degrees(place)
        nodes.append(f'<node id="{len(nodes) + 1}" lat="{lat!r}" lon="{lon!r}">{tags}</node>')
        return len(nodes)

    for one in house()[:3] + house()[6:]:
        kind, coordinates = one["properties"]["feature"], one["geometry"]["coordinates"]
        if kind == "door":
            node((5.0, 1.5), '<tag k="door" v="hinged"/><tag k="level" v="0"/><tag k="repeat_on" v="1"/>')
            continue
        refs = [node(place) for place in coordinates[0][:-1]]
        extra = {"stairs": ("stairs", "yes"), "lift": ("highway", "elevator")}.get(kind, ("ref", kind))
        tags = {"indoor": "room" if kind in ("room", "lift") else "area", "level": "0-1", extra[0]: extra[1]}
        inner = "".join(f'<nd ref="{ref}"/>' for ref in [*refs, refs[0]])
        inner += "".join(f'<tag k="{key}" v="{value}"/>' for key, value in tags.items())
        ways.append(f'<way id="{len(ways) + 1}">{inner}</way>')
    node((9.0, 4.0), '<tag k="door" v="yes"/><tag k="level" v="0-1"/>')
    path = folder / "house.osm"
    path.write_text("<?xml version='1.0'?><osm version='0.6'>" + "".join(nodes + ways) + "</osm>")
    return path


def picture(folder: Path) -> Path:
    """The two rooms as a picture with walls of four pixels and a gap, and its scale beside it."""
    from PIL import Image, ImageDraw

    image = Image.new("L", (600, 300), 255)
    draw = ImageDraw.Draw(image)
    draw.rectangle([30, 30, 540, 240], outline=0, width=4)
    draw.line([285, 30, 285, 120], fill=0, width=4)
    draw.line([285, 170, 285, 240], fill=0, width=4)
    image.save(folder / "ground.png")
    (folder / "ground.toml").write_text('[[level]]\nimage = "ground.png"\nmetres_per_pixel = 0.02\n')
    return folder / "ground.png"


def ros_map(folder: Path) -> Path:
    grey = np.full((100, 120), 205, dtype=np.uint8)
    grey[10:90, 10:110] = 254
    grey[10:90, 60:62] = 0
    grey[40:58, 60:62] = 254
    (folder / "map.pgm").write_bytes(b"P5\n120 100\n255\n" + grey.tobytes())
    fields = "image: map.pgm\nresolution: 0.05\norigin: [-3.0, -2.5, 0.0]\nnegate: 0\n"
    (folder / "map.yaml").write_text(fields + "occupied_thresh: 0.65\nfree_thresh: 0.196\n")
    return folder / "map.yaml"


def dxf(folder: Path) -> Path:
    """The two rooms in millimetres, walls as lines, the door as the arc of its leaf."""
    ezdxf = pytest.importorskip("ezdxf")
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = 4
    space = drawing.modelspace()
    corners = [(0, 0), (10000, 0), (10000, 4000), (0, 4000), (0, 0)]
    inner = [((5000, 0), (5000, 1000)), ((5000, 1900), (5000, 4000))]
    for a, b in [*itertools.pairwise(corners), *inner]:
        space.add_line(a, b, dxfattribs={"layer": "A-WALL"})
    space.add_arc((5000, 1000), 900, 0, 90, dxfattribs={"layer": "A-DOOR"})
    space.add_text("Lab", dxfattribs={"layer": "A-ANNO"})
    drawing.saveas(folder / "house.dxf")
    return folder / "house.dxf"


MADE = {
    "imdf": (imdf, (0, 1)),
    "osm_indoor": (osm, (0, 1)),
    "picture": (picture, (0,)),
    "ros_map": (ros_map, (0,)),
    "dxf": (dxf, (0,)),
}


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


def test_connections_of_indoorgml_are_doors(tmp_path: Path) -> None:
    def positions(*places: tuple[float, float]) -> str:
        return "".join(f"<gml:pos>{x} {y} 0.0</gml:pos>" for x, y in places)

    cells = "".join(
        f"<CellSpace gml:id='{id}'><Geometry2D><gml:Polygon><gml:exterior><gml:LinearRing>{positions(*ring)}"
        "</gml:LinearRing></gml:exterior></gml:Polygon></Geometry2D></CellSpace>"
        for id, ring in (("A", rectangle(0, 0, 4, 4)), ("B", rectangle(4.2, 0, 8, 4)))
    )
    door = f"<ConnectionBoundary><gml:LineString>{positions((4.1, 1), (4.1, 2))}</gml:LineString></ConnectionBoundary>"
    spaces = "xmlns:gml='http://www.opengis.net/gml/3.2' xmlns='http://www.opengis.net/indoorgml/1.0/core'"
    path = tmp_path / "two.gml"
    path.write_text(f"<IndoorFeatures {spaces}>{cells}{door}</IndoorFeatures>")
    assert detect(path) == "indoorgml"
    assert is_whole(read_plan(path))


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
    "level is text": (lambda features: features[0]["properties"].update(level="0"), "whole number"),
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
    with pytest.raises(PdrbenchError, match=why):
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


def test_xml_entities_and_pictures_elsewhere_are_refused(tmp_path: Path) -> None:
    bomb = tmp_path / "bomb.osm"
    bomb.write_text('<?xml version="1.0"?><!DOCTYPE a [<!ENTITY b "c">]><osm>&b;</osm>')
    with pytest.raises(MapError, match="entities"):
        read_plan(bomb)
    table = tmp_path / "plan.toml"
    table.write_text('[[level]]\nimage = "../x.png"\nmetres_per_pixel = 0.02\n')
    with pytest.raises(MapError, match="beside it"):
        read_plan(table)


@pytest.mark.data
@pytest.mark.parametrize(
    ("path", "kind", "levels", "treads", "lifts"),
    [
        pytest.param("westport_house/westport-house", "wrld3d", 7, 350, 5, marks=pytest.mark.long(seconds=3)),
        ("westport_house/westport-house.zip", "wrld3d", 7, 350, 5),
        pytest.param("osm_apb/APBorig.osm", "osm_indoor", 4, 250, 2, marks=pytest.mark.long(seconds=3)),
        pytest.param("osm_apb/apb.geojson", "osm_indoor", 4, 250, 2, marks=pytest.mark.long(seconds=3)),
    ],
)
def test_real_buildings_can_be_walked_from_the_lowest_to_the_highest_level(
    path: str, kind: str, levels: int, treads: int, lifts: int
) -> None:
    if not is_available("maps") or not (find("maps") / path).exists():
        pytest.skip(f"no {path} below PDRBENCH_DATA")
    plan = read_plan(find("maps") / path)
    building = plan.building
    assert plan.source == kind
    assert len(building.levels) == levels
    parts = reachable_parts(building, by_lift=False)
    reached = [i for i, part in enumerate(parts) if part == 0]
    assert {building.polygons[i].level for i in reached} == set(building.levels)
    assert sum(building.polygons[i].kind == "stairs" for i in reached) >= treads
    assert len(lift_shafts(building)) == lifts
    assert len(compile_map(building)) > 0
