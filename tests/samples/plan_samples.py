"""Plans of two rooms in every format, as the producers of each write them."""

from __future__ import annotations

import bz2
import gzip
import itertools
import json
import lzma
import re
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely

from pdrbench.io.geo import GeoFrame

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


def osm_elements(*, doors_have_levels: bool = True) -> list[dict[str, Any]]:
    """The house in Simple Indoor Tagging: doors are nodes, stair and lift name both levels."""
    nodes: list[dict[str, Any]] = []
    ways: list[dict[str, Any]] = []

    def node(place: tuple[float, float], **tags: str) -> int:
        lon, lat = degrees(place)
        nodes.append({"type": "node", "id": len(nodes) + 1, "lat": lat, "lon": lon, "tags": tags})
        return len(nodes)

    for one in house()[:3] + house()[6:]:
        kind, coordinates = one["properties"]["feature"], one["geometry"]["coordinates"]
        if kind == "door":
            node((5.0, 1.5), door="hinged", **({"level": "0", "repeat_on": "1"} if doors_have_levels else {}))
            continue
        refs = [node(place) for place in coordinates[0][:-1]]
        key, value = {"stairs": ("stairs", "yes"), "lift": ("highway", "elevator")}.get(kind, ("ref", kind))
        tags = {"indoor": "room" if kind in ("room", "lift") else "area", "level": "0-1", key: value}
        ways.append({"type": "way", "id": len(ways) + 1, "nodes": [*refs, refs[0]], "tags": tags})
    node((9.0, 4.0), door="yes", **({"level": "0-1"} if doors_have_levels else {}))
    return nodes + ways


def osm_xml(elements: list[dict[str, Any]]) -> str:
    text = "<?xml version='1.0'?><osm version='0.6'>"
    for one in elements:
        place = f" lat='{one['lat']!r}' lon='{one['lon']!r}'" if one["type"] == "node" else ""
        inner = "".join(f'<nd ref="{ref}"/>' for ref in one.get("nodes", ()))
        inner += "".join(f'<tag k="{key}" v="{value}"/>' for key, value in one["tags"].items())
        text += f"<{one['type']} id='{one['id']}'{place}>{inner}</{one['type']}>"
    return text + "</osm>"


def osm(folder: Path) -> Path:
    (folder / "house.osm").write_text(osm_xml(osm_elements()))
    return folder / "house.osm"


def overpass(elements: list[dict[str, Any]], *, with_geometry: bool = False) -> dict[str, Any]:
    """An answer of Overpass, `out body` or `out geom`."""
    places = {one["id"]: {"lat": one["lat"], "lon": one["lon"]} for one in elements if one["type"] == "node"}
    if with_geometry:
        elements = [
            {**one, "geometry": [places[ref] for ref in one["nodes"]]} if one["type"] == "way" else one
            for one in elements
            if one["tags"]
        ]
    return {"version": 0.6, "generator": "Overpass API", "osm3s": {}, "elements": elements}


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


def dxf(folder: Path, layers: tuple[str, str] = ("A-WALL", "A-DOOR"), *, in_block: bool = False) -> Path:
    """The two rooms in millimetres, walls as lines, the door as the arc of its leaf; or walls in a block of a block."""
    ezdxf = pytest.importorskip("ezdxf")
    drawing = ezdxf.new()
    drawing.header["$INSUNITS"] = 4
    space = drawing.modelspace()
    walls, wall_layer = space, layers[0]
    if in_block:
        walls, wall_layer = drawing.blocks.new("WALLS"), "0"
        drawing.blocks.new("PLAN").add_blockref("WALLS", (0, 0), dxfattribs={"layer": "0"})
        space.add_blockref("PLAN", (0, 0), dxfattribs={"layer": layers[0]})
    corners = [(0, 0), (10000, 0), (10000, 4000), (0, 4000), (0, 0)]
    inner = [((5000, 0), (5000, 1000)), ((5000, 1900), (5000, 4000))]
    for a, b in [*itertools.pairwise(corners), *inner]:
        walls.add_line(a, b, dxfattribs={"layer": wall_layer})
    space.add_arc((5000, 1000), 900, 0, 90, dxfattribs={"layer": layers[1]})
    space.add_text("Lab", dxfattribs={"layer": "A-ANNO"})
    drawing.saveas(folder / "house.dxf")
    return folder / "house.dxf"


def layered() -> list[dict[str, Any]]:
    """The house as programs for maps have it: a layer and one level for each shape."""
    found = []
    for one in house():
        kind, tags = one["properties"]["feature"], one["properties"]
        layer = {"room": "A-ROOM", "area": "A-AREA", "door": "A-DOOR", "stairs": "A-STRS", "lift": "A-EVTR"}[kind]
        for level in tags.get("levels", [tags.get("level")]):
            found.append({**one, "properties": {"Layer": layer, "level": level}})
    return found


def shapefiles(folder: Path) -> Path:
    """The house as shapefiles in feet, one for each layer, in an archive."""
    shapefile = pytest.importorskip("shapefile")
    parts = scaled(layered(), lambda p: [p[0] / 0.3048, p[1] / 0.3048])
    for name in ("rooms", "Doors", "stairs", "lifts"):
        is_line = name == "Doors"
        with shapefile.Writer(folder / name, shapefile.POLYLINE if is_line else shapefile.POLYGON) as file:
            file.field("floor", "N", 4)
            layers = {"rooms": ("A-ROOM", "A-AREA"), "Doors": ("A-DOOR",), "stairs": ("A-STRS",), "lifts": ("A-EVTR",)}
            for one in (one for one in parts if one["properties"]["Layer"] in layers[name]):
                coordinates = one["geometry"]["coordinates"]
                file.line([coordinates]) if is_line else file.poly(coordinates)
                file.record(one["properties"]["level"])
        (folder / f"{name}.prj").write_text('PROJCS["x",GEOGCS["y",UNIT["Degree",0.01745]],UNIT["Foot",0.3048]]')
    with zipfile.ZipFile(folder / "house.zip", "w") as archive:
        for path in sorted(folder.iterdir()):
            if path.suffix in (".shp", ".dbf", ".shx", ".prj"):
                archive.write(path, f"gis/{path.name}")
    return folder / "house.zip"


MADE = {
    "shapefile": (shapefiles, (0, 1)),
    "imdf": (imdf, (0, 1)),
    "osm_indoor": (osm, (0, 1)),
    "picture": (picture, (0,)),
    "ros_map": (ros_map, (0,)),
    "dxf": (dxf, (0,)),
}


def positions(ring: list[tuple[float, float]], heights_m: list[float]) -> str:
    rows = zip(ring, heights_m, strict=True)
    return "".join(f"<gml:pos>{x} {y} {z}</gml:pos>" for (x, y), z in rows)


def gml_face(ring: Ring, heights_m: list[float], *, tag: str = "Polygon", id: str = "") -> str:
    name = f" gml:id='{id}'" if id else ""
    line = f"<gml:exterior><gml:LinearRing>{positions(ring, heights_m)}</gml:LinearRing></gml:exterior>"
    return f"<gml:{tag}{name}>{line}</gml:{tag}>"


def indoorgml(
    folder: Path,
    *,
    version: str = "1.0",
    form: str = "faces",
    change: Callable[[tuple[float, float]], tuple[float, float]] = lambda place: place,
    z_m: tuple[float, ...] = (0.0,),
) -> Path:
    """Two rooms as solids, with a connection between them, on floors of these heights."""
    cells, shared, doors = "", "", ""
    for level, z in enumerate(z_m):
        for id, ring in (("A", rectangle(0, 0, 4, 4)), ("B", rectangle(4.2, 0, 8, 4))):
            corners = [change(place) for place in ring]
            faces = [(corners, [z] * 5), (corners, [z + 3.0] * 5)]
            faces += [([a, b, b, a, a], [z, z, z + 3, z + 3, z]) for a, b in itertools.pairwise(corners)]
            if form == "patches":
                patches = "".join(gml_face(*face, tag="PolygonPatch") for face in faces)
                surface = f"<gml:surfaceMember><gml:Surface><gml:patches>{patches}</gml:patches></gml:Surface>"
                surface += "</gml:surfaceMember>"
            elif form == "shared":
                names = [f"{id}{level}-{k}" for k in range(len(faces))]
                surface = "".join(f"<gml:surfaceMember xlink:href='#{name}'/>" for name in names)
                shared += "".join(
                    f"<CellSpaceBoundary>{gml_face(*face, id=name)}</CellSpaceBoundary>"
                    for face, name in zip(faces, names, strict=True)
                )
            else:
                surface = "".join(f"<gml:surfaceMember>{gml_face(*face)}</gml:surfaceMember>" for face in faces)
            solid = f"<gml:Solid><gml:exterior><gml:Shell>{surface}</gml:Shell></gml:exterior></gml:Solid>"
            cells += f"<CellSpace gml:id='{id}{level}'><Geometry3D>{solid}</Geometry3D></CellSpace>"
        ends = [change(place) for place in ((4.1, 1.0), (4.1, 2.0))]
        line = f"<gml:LineString>{positions(ends, [z, z])}</gml:LineString>"
        doors += f"<ConnectionBoundary>{line}</ConnectionBoundary>"
    spaces = "xmlns:gml='http://www.opengis.net/gml/3.2' xmlns:xlink='http://www.w3.org/1999/xlink'"
    spaces += f" xmlns='http://www.opengis.net/indoorgml/{version}/core'"
    path = folder / "two.gml"
    path.write_text(f"<IndoorFeatures {spaces}>{cells}{shared}{doors}</IndoorFeatures>")
    return path


def plain(features: list[dict[str, Any]], path: Path, **members: Any) -> Path:
    return written(path, document(features, **members))


def imdf_without_version(folder: Path) -> Path:
    """As some producers write it: below a folder, with their own manifest and what an operating system leaves."""
    with zipfile.ZipFile(imdf(folder)) as venue, zipfile.ZipFile(folder / "other.zip", "w") as archive:
        for name in venue.namelist():
            content = b'{"language": "en"}' if name == "manifest.json" else venue.read(name)
            archive.writestr(f"My venue/{name}", content)
        archive.writestr("__MACOSX/My venue/._unit.geojson", b"\0\5")
    return folder / "other.zip"


def nav2_map(folder: Path) -> Path:
    """As map_saver of ROS 2 writes it: its free_thresh lies above the value of unknown cells."""
    path = ros_map(folder)
    path.write_text(path.read_text().replace("0.196", "0.25").replace("negate: 0", "mode: trinary\nnegate: false"))
    return path


def geojson_lines(features: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Rooms as closed lines, as programs for drawing export them."""
    for one in features:
        if one["properties"]["feature"] in ("room", "area"):
            one["geometry"] = {"type": "LineString", "coordinates": one["geometry"]["coordinates"][0]}
    return features


def levels_with_a_point(features: list[dict[str, Any]]) -> list[dict[str, Any]]:
    for one in features:
        properties = one["properties"]
        properties.update({key: float(properties[key]) for key in ("level",) if key in properties})
    return features


def geojson_of_osm(folder: Path) -> Path:
    """What converters make of OpenStreetMap: tags in a member of their own."""
    elements = osm_elements(doors_have_levels=False)
    places = {one["id"]: [one["lon"], one["lat"]] for one in elements if one["type"] == "node"}
    features = []
    for one in (element for element in elements if element["tags"]):
        is_way = one["type"] == "way"
        coordinates = [[places[ref] for ref in one["nodes"]]] if is_way else places[one["id"]]
        geometry = {"type": "Polygon" if is_way else "Point", "coordinates": coordinates}
        tags = {"tags": one["tags"]}
        features.append(
            {"type": "Feature", "id": f"{one['type']}/{one['id']}", "properties": tags, "geometry": geometry}
        )
    return written(folder / "osm.geojson", {"type": "FeatureCollection", "features": features})


def packed(path: Path) -> Path:
    place = path.with_name(path.name + ".gz")
    place.write_bytes(gzip.compress(path.read_bytes()))
    return place


def in_utf16(path: Path) -> Path:
    text = path.read_text(encoding="utf-8")
    if text.startswith("<"):
        text = '<?xml version="1.0" encoding="UTF-16"?>\n' + re.sub(r"^<\?xml.*?\?>\s*", "", text)
    return written_bytes(path, text.encode("utf-16"))


def doors_as_lines(elements: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """A line of 0.9 m from jamb to jamb in the place of the first door, without a level."""
    door = next(one for one in elements if one["tags"].get("door") == "hinged")
    jambs = [degrees((5.0, y)) for y in (1.05, 1.95)]
    nodes = [{"type": "node", "id": 900 + k, "lon": lon, "lat": lat, "tags": {}} for k, (lon, lat) in enumerate(jambs)]
    way = {"type": "way", "id": 900, "nodes": [900, 901], "tags": {"indoor": "door"}}
    return nodes + [one for one in elements if one is not door] + [way]


CRS84 = {"type": "name", "properties": {"name": "urn:ogc:def:crs:OGC:1.3:CRS84"}}


def turned_lat_lon(xy_m: tuple[float, float]) -> list[float]:
    """Degrees in the wrong order, of a house that is turned."""
    return list(degrees((0.8 * xy_m[0] - 0.6 * xy_m[1], 0.6 * xy_m[0] + 0.8 * xy_m[1])))[::-1]


def wkt_table(path: Path) -> Path:
    shapes = [(shapely.geometry.shape(one["geometry"]).wkt, one["properties"]) for one in layered()]
    rows = [f'"{wkt}",{tags["Layer"]},{tags["level"]}' for wkt, tags in shapes]
    return written_text(path, "\n".join(["WKT,Layer,level", *rows, ""]))


FOREIGN: dict[str, Callable[[Path], Path]] = {
    "features on lines": lambda p: written_text(p / "a.geojsonl", "\x1e" + "\n\x1e".join(map(json.dumps, house()))),
    "WKT in a table": lambda p: wkt_table(p / "a.csv"),
    "closed lines as rooms": lambda p: plain(geojson_lines(house()), p / "a.geojson"),
    "levels with a point": lambda p: plain(levels_with_a_point(house()), p / "a.geojson"),
    "millimetres": lambda p: plain(
        scaled(house(), lambda q: [q[0] * 1e3, q[1] * 1e3]), p / "a.json", units="millimetres"
    ),
    "crs names degrees": lambda p: plain(scaled(house(), degrees), p / "a.geojson", units="", crs=CRS84),
    "gzip": lambda p: packed(plain(house(), p / "a.geojson")),
    "manifest without version": imdf_without_version,
    "doors without level": lambda p: written_text(p / "a.osm", osm_xml(osm_elements(doors_have_levels=False))),
    "osm in gzip": lambda p: packed(osm(p)),
    "osm in bzip2": lambda p: written_bytes(p / "b.osm.bz2", bz2.compress(osm(p).read_bytes())),
    "drawing in xz": lambda p: written_bytes(p / "a.dxf.xz", lzma.compress(dxf(p).read_bytes())),
    "utf-16": lambda p: in_utf16(plain(house(), p / "a.geojson")),
    "osm in utf-16": lambda p: in_utf16(osm(p)),
    "doors as lines": lambda p: written_text(p / "a.osm", osm_xml(doors_as_lines(osm_elements()))),
    "overpass out body": lambda p: written(p / "a.json", overpass(osm_elements())),
    "overpass out geom": lambda p: written(p / "a.json", overpass(osm_elements(), with_geometry=True)),
    "nested tags": geojson_of_osm,
    "layers of a drawing": lambda p: plain(scaled(layered(), degrees), p / "a.geojson", units="", levels=[]),
    "indoorgml 1.0": indoorgml,
    "indoorgml 1.1": lambda p: indoorgml(p, version="1.1"),
    "patches": lambda p: indoorgml(p, form="patches"),
    "shared faces": lambda p: indoorgml(p, form="shared"),
    "layers with umlauts": lambda p: dxf(p, ("Wände", "Türen")),
    "layer of a nested block": lambda p: dxf(p, in_block=True),
    "nav2": nav2_map,
}


def written_text(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def written_bytes(path: Path, content: bytes) -> Path:
    path.write_bytes(content)
    return path
