from __future__ import annotations

import copy
from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from pdrbench.building import WALL, Building, FloorPolygon, Zone
from pdrbench.errors import MapError

SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]
NEXT = [[1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0]]
WALLS = [WALL] * 4


def test_area_levels_heights_and_edges_that_follow_the_rings(house: Building) -> None:
    hall, room, treads, gallery = 76 - 1, 36, 2 * 0.29 * 12, 16 * 3
    assert house.area_m2 == pytest.approx(hall + room + treads + gallery)
    assert house.levels == (0, 1)
    assert house.height([0, 2, 13]) == pytest.approx([0, 0.165, 0.165 * 12])
    assert house.level([0, 2, 13, 14]).tolist() == [0, 0, 1, 1]
    assert house.bounds_m() == (0, 0, 16, pytest.approx(12.48))
    assert house.bounds_m(0) == (0, 0, 16, 10)
    for p, polygon in enumerate(house.polygons):
        own = slice(house.first_edge[p], house.first_edge[p + 1])
        assert (house.edge_polygon[own] == p).all()
        assert np.array_equal(house.edge_start_xy_m[own], np.concatenate(polygon.rings))
        assert np.array_equal(house.edge_neighbour[own], polygon.neighbour)
    with pytest.raises(ValueError, match="read-only"):
        house.edge_neighbour[0] = 3


def test_locate_agrees_with_shapely_point_by_point(house: Building, rng: np.random.Generator) -> None:
    xy_m = rng.uniform(-1, 17, (3000, 2))
    level = rng.integers(0, 2, 3000)
    shapes = [shapely.Polygon(p.outline_xy_m, p.holes) for p in house.polygons]
    expected = [
        next((i for i, p in enumerate(house.polygons) if p.level == at and shapes[i].covers(shapely.Point(xy))), -1)
        for xy, at in zip(xy_m, level, strict=True)
    ]
    assert house.locate(xy_m, level).tolist() == expected
    assert np.array_equal(house.contains(xy_m, level), np.array(expected) >= 0)


def test_places_are_in_polygons_of_their_level_boundary_included(house: Building) -> None:
    places = [[0, 0], [10, 2.5], [2.5, 2.5], [2, 2], [np.nan, 0], [-1e-9, 0]]
    assert house.locate(places, 0).tolist() == [0, 0, -1, 0, -1, -1]
    assert house.locate([[1, 9.8]], 0).tolist() == [0]
    assert house.locate([[1, 9.8]], 1).tolist() == [14]
    assert house.walkable(0).area == pytest.approx(75 + 36 + 2 * 0.29 * 6)


def test_samples_are_uniform_over_area(house: Building) -> None:
    count = 200_000
    polygon, xy_m = house.sample_uniform(np.random.default_rng(1), count)
    area = np.array([p.area_m2 for p in house.polygons])
    fraction = np.bincount(polygon, minlength=len(area)) / count
    # binomial standard deviation of each fraction; five of them hold for all 15 polygons at once
    assert (np.abs(fraction - area / area.sum()) < 5 * np.sqrt(area / area.sum() / count)).all()
    hall = shapely.Polygon(house.polygons[0].outline_xy_m, house.polygons[0].holes)
    assert shapely.covers(hall.buffer(1e-9), shapely.points(xy_m[polygon == 0])).all()
    left = (xy_m[polygon == 0, 0] < 4).mean()
    assert left == pytest.approx((40 - 1) / 75, abs=5 * 0.5 / np.sqrt((polygon == 0).sum()))


def test_samples_of_one_level_and_same_generator_same_bytes(house: Building) -> None:
    first = house.sample_uniform(np.random.default_rng(5), 100, level=1)
    again = house.sample_uniform(np.random.default_rng(5), 100, level=1)
    assert (house.level(first[0]) == 1).all()
    assert first[1].tobytes() == again[1].tobytes()
    with pytest.raises(MapError, match="no level 7; levels: 0, 1"):
        house.sample_uniform(np.random.default_rng(5), 1, level=7)


def test_equal_by_content(house: Building) -> None:
    again = copy.deepcopy(house)
    assert again == house and hash(again) == hash(house) and again is not house
    renamed = Building("other", house.polygons, house.zones)
    assert renamed != house
    assert Building(house.name, house.polygons) != house


def polygon(**changes: object) -> FloorPolygon:
    fields = {"id": "a", "outline_xy_m": SQUARE, "neighbour": WALLS, "height_m": 0.0, "level": 0}
    return FloorPolygon(**(fields | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"outline_xy_m": SQUARE[::-1]}, "'a': outline runs clockwise"),
        ({"outline_xy_m": [*SQUARE, SQUARE[0]], "neighbour": [WALL] * 5}, "edge 4 has no length.*do not repeat"),
        ({"outline_xy_m": [SQUARE[0], *SQUARE]}, "edge 0 has no length"),
        ({"outline_xy_m": SQUARE[:2]}, "three vertices; got 2"),
        ({"outline_xy_m": [[0, 0], [1, 0], [np.nan, 1]]}, "vertex 2 is not finite"),
        ({"outline_xy_m": [[0, 0, 0], [1, 0, 0], [1, 1, 0]]}, r"\(K, 2\)"),
        ({"outline_xy_m": [[0, 0], [1, 0], [2, 0]]}, "sliver"),
        ({"neighbour": [WALL] * 3}, "4 edges and `neighbour` of shape"),
        ({"height_m": np.inf}, "height_m is inf"),
        ({"level": 0.5}, "level is a whole number"),
        ({"level": True}, "level is a whole number"),
        ({"id": ""}, "id is text, not empty"),
        ({"id": 3}, "id is text, not empty; got 3"),
        ({"id": "\ud800"}, "half a surrogate pair"),
        ({"outline_xy_m": [[0, 0], [1], [2, 2]]}, "pairs of numbers"),
        ({"outline_xy_m": [["west", 0], [1, 0], [1, 1]]}, "pairs of numbers"),
        ({"neighbour": [WALL, WALL, WALL, -1.5]}, "whole numbers"),
        ({"neighbour": ["b", WALL, WALL, WALL]}, "polygon indices"),
        ({"height_m": None}, "height_m is None"),
        ({"height_m": "1"}, "height_m is '1'"),
        ({"level": 2**40}, "level is a whole number"),
        ({"kind": "lawn"}, "kind is one of floor, stairs, ramp, lift; got 'lawn'"),
        ({"holes": ([[0.2, 0.2], [0.4, 0.2], [0.4, 0.4]],), "neighbour": [WALL] * 7}, "hole 0 runs counter-clockwise"),
    ],
)
def test_a_bad_polygon_is_named(changes: dict[str, object], message: str) -> None:
    with pytest.raises(MapError, match=message):
        polygon(**changes)


def build(*polygons: FloorPolygon, zones: tuple[Zone, ...] = ()) -> Building:
    return Building("test", polygons, zones)


def second(neighbour: list[int], outline: list[list[float]] = NEXT) -> FloorPolygon:
    return polygon(id="b", outline_xy_m=outline, neighbour=neighbour)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: build(), "no floor polygon"),
        (lambda: build(polygon(), polygon()), "polygon id 'a' stands 2 times"),
        (lambda: build(polygon(), zones=(Zone("z", "", SQUARE, 0), Zone("z", "", SQUARE, 0))), "zone id 'z'"),
        (lambda: build(polygon(neighbour=[WALL, 7, WALL, WALL])), "edge 1 of polygon 'a' leads to polygon 7"),
        (lambda: build(polygon(neighbour=[WALL, -2, WALL, WALL])), "edge 1 of polygon 'a' leads to polygon -2"),
        (lambda: build(polygon(neighbour=[WALL, 0, WALL, WALL])), "edge 1 of polygon 'a' leads to its own polygon"),
        (
            lambda: build(polygon(neighbour=[WALL, 1, WALL, WALL]), second(WALLS)),
            "edge 1 of polygon 'a' leads to 'b', but no edge of 'b' leads back",
        ),
        (
            lambda: build(
                polygon(neighbour=[WALL, 1, WALL, WALL]),
                second([WALL, WALL, WALL, 0], [[1.1, 0], [2, 0], [2, 1], [1.1, 1]]),
            ),
            r"leads back lies elsewhere \(0.1 m off\)",
        ),
        (
            lambda: build(polygon(outline_xy_m=[[0, 0], [2, 0], [0.5, 2], [1.5, 2]], neighbour=WALLS)),
            "polygon 'a' is not simple at edge",
        ),
        (
            lambda: build(polygon(holes=([[3, 3], [3, 4], [4, 4], [4, 3]],), neighbour=[WALL] * 8)),
            "polygon 'a' is not simple",
        ),
    ],
)
def test_a_bad_building_names_polygon_and_edge(make: object, message: str) -> None:
    with pytest.raises(MapError, match=message):
        make()  # type: ignore[operator]


def test_triangles_cover_every_polygon_exactly(house: Building) -> None:
    corners, owner = house.triangles()
    (bx, by), (cx, cy) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    area = np.bincount(owner, np.abs(bx * cy - by * cx) / 2)
    assert area == pytest.approx([p.area_m2 for p in house.polygons])


def test_a_building_shows_its_levels_in_a_notebook(office: Building) -> None:
    root = ElementTree.fromstring(office._repr_svg_())
    name = "{http://www.w3.org/2000/svg}"
    assert [text.text for text in root.iter(f"{name}title")] == ["level 0", "level 1"]
    assert len(list(root.iter(f"{name}polyline"))) == np.count_nonzero(office.edge_neighbour == WALL)
    assert len(list(root.iter(f"{name}path"))) >= 2
