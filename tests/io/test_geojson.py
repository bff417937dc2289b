from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pdrbench.building import WALL, Building, FloorPolygon, Zone
from pdrbench.errors import MapError
from pdrbench_formats.maps import geojson

finite = st.floats(-1e6, 1e6, allow_nan=False)
names = st.text(st.characters(exclude_categories=("Cs",)), max_size=8)


def make_building() -> Building:
    a = FloorPolygon(
        "a",
        [[0, 0], [4, 0], [4, 4], [0, 4]],
        [WALL, 1, WALL, WALL, WALL, WALL, WALL],
        0.1 + 0.2,
        0,
        holes=([[1, 1], [1, 2], [2, 1]],),
    )
    b = FloorPolygon("b", [[4, 0], [8, 0], [8, 4], [4, 4]], [WALL, WALL, WALL, 0], 1 / 3, 1, "stairs")
    return Building("höuse", (a, b), (Zone("z", "Café <1>", [[0, 0], [1, 0], [0, 1]], 0, "shop"),))


@given(
    x=finite, y=finite, width=st.floats(1e-2, 1e3), height_m=finite, level=st.integers(-9, 99), name=names, zone=names
)
@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_round_trip_keeps_every_bit(
    tmp_path: Path, x: float, y: float, width: float, height_m: float, level: int, name: str, zone: str
) -> None:
    outline = [[x, y], [x + width, y], [x + width, y + np.sqrt(2)], [x, y + np.pi]]
    square = FloorPolygon("s", outline, [WALL] * 4, height_m, level)
    building = Building(name, (square,), (Zone("z", zone, outline, level),))
    geojson.write(building, tmp_path / "b.geojson")
    again = geojson.read(tmp_path / "b.geojson")
    assert again == building and again.sha256 == building.sha256
    assert again.polygons[0].outline_xy_m.tobytes() == building.polygons[0].outline_xy_m.tobytes()


def test_round_trip_of_holes_connections_and_kinds_and_a_missing_file(tmp_path: Path) -> None:
    geojson.write(make_building(), tmp_path / "b.geojson")
    assert geojson.read(tmp_path / "b.geojson") == make_building()
    assert [p.name for p in tmp_path.iterdir()] == ["b.geojson"]
    with pytest.raises(MapError, match="cannot be read"):
        geojson.read(tmp_path / "none.geojson")


def test_a_byte_order_mark_and_crlf_are_accepted(tmp_path: Path) -> None:
    geojson.write(make_building(), tmp_path / "b.geojson")
    text = json.dumps(json.loads((tmp_path / "b.geojson").read_text()), indent=1).replace("\n", "\r\n")
    (tmp_path / "b.geojson").write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert geojson.read(tmp_path / "b.geojson") == make_building()


@pytest.mark.parametrize("content", [b"", b"{", b"\xff\xfe", b"[]", b"{}", b'{"a": NaN}', b"[" * 100_000, b"\x00"])
def test_a_file_that_is_no_building(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "bad.geojson").write_bytes(content)
    with pytest.raises(MapError, match=r"bad\.geojson"):
        geojson.read(tmp_path / "bad.geojson")


def change(*path: object, to: object) -> Callable[[dict[str, Any]], None]:
    def apply(document: dict[str, Any]) -> None:
        place: Any = document
        for key in path[:-1]:
            place = place[key]
        if to is KeyError:
            del place[path[-1]]
        else:
            place[path[-1]] = to

    return apply


FIRST = ("features", 0)
RING = (*FIRST, "geometry", "coordinates", 0)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (change("version", to=2), r"\$.version"),
        (change("features", to={}), r"array.*\$.features"),
        (change(*FIRST, "properties", "feature", to="unit"), "Invalid value 'unit'"),
        (change(*FIRST, "properties", "level", to=KeyError), "missing required field `level`.*features"),
        (change(*FIRST, "properties", "levle", to=0), "unknown field `levle`"),
        (change(*FIRST, "properties", "height_m", to="3"), r"features\[0\].properties.height_m"),
        (change(*FIRST, "geometry", "type", to="MultiPolygon"), "Invalid enum value 'MultiPolygon'"),
        (change(*FIRST, "geometry", "coordinates", to=[]), r"features\[0\].geometry.coordinates"),
        (change(*RING, 0, to=[0.0, 0.0, 1.0]), r"coordinates\[...\]|length 2"),
        (change(*RING, 4, to=[0.0, 0.5]), "ring 0 of 'a' is not closed"),
        (change(*FIRST, "properties", "leads_to", to=[[None] * 4]), "one list per ring"),
        (change(*FIRST, "properties", "leads_to", 0, 1, to="c"), "edge 1 of 'a' leads to 'c', which is not"),
        (change(*FIRST, "properties", "leads_to", 0, 1, to=None), "edge 3 of polygon 'b' leads to 'a', but no edge"),
        (change(*FIRST, "id", to="b"), "'b'"),
        (change("name", to=KeyError), "missing required field `name`"),
        (change(*RING, 1, to=[10**400, 0.0]), r"features\[0\].geometry|out of range"),
    ],
)
def test_every_defect_is_named_with_file_and_place(
    tmp_path: Path, edit: Callable[[dict[str, Any]], None], message: str
) -> None:
    path = tmp_path / "b.geojson"
    geojson.write(make_building(), path)
    document = json.loads(path.read_text())
    edit(document)
    path.write_text(json.dumps(document))
    with pytest.raises(MapError, match=message) as caught:
        geojson.read(path)
    assert "b.geojson" in str(caught.value)
