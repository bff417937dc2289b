"""Buildings made of drawings: rooms, walls, doors, stairs and lifts, and what has to be repaired."""

from __future__ import annotations

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import affinity, box

from pdrbench.building import Building
from pdrbench.building.connectivity import lift_shafts, reachable_parts
from pdrbench.building.convex import compile_map
from pdrbench.errors import MapError, PdrbenchError
from pdrbench_formats.maps.builder import BuildingBuilder

DOORS = {"line": [(4, 1), (4, 2)], "polygon": box(3.9, 1, 4.1, 2), "point": shapely.Point(4, 1.5)}


def two_rooms(gap_m: float = 0.0, **options: object) -> BuildingBuilder:
    builder = BuildingBuilder("rooms", **options).add_level(0, height_m=0.0)  # type: ignore[arg-type]
    return builder.add_walkable(box(0, 0, 4 - gap_m / 2, 4)).add_walkable(box(4 + gap_m / 2, 0, 8, 4))


def is_connected(building: Building, *, by_lift: bool = False) -> bool:
    return bool((reachable_parts(building, by_lift=by_lift) == 0).all())


@pytest.mark.parametrize("door", DOORS.values(), ids=DOORS)
@pytest.mark.parametrize("gap_m", [0.0, 0.004, 0.15, 0.6])
def test_a_door_joins_rooms_through_a_wall_of_any_thickness(door: object, gap_m: float) -> None:
    if isinstance(door, shapely.Polygon) and gap_m > 0.2:
        door = box(3.7, 1, 4.3, 2)
    building = two_rooms(gap_m).add_door(door).build()
    assert is_connected(building)
    start, end = np.array([[2.0, 1.5], [2.0, 3.0]]), np.array([[6.0, 1.5], [6.0, 3.0]])
    polygon, alive = building.move(building.locate(start, 0), start, end)
    assert alive.tolist() == [True, False]
    assert polygon[0] == building.locate(end[:1], 0)[0]


def test_rooms_without_a_door_are_apart_and_areas_without_walls_are_one() -> None:
    assert not is_connected(two_rooms().build())
    builder = BuildingBuilder().add_level(0)
    for x in (0, 4):
        builder.add_walkable(box(x, 0, x + 4, 4), walled=False)
    assert is_connected(builder.build())


def test_walls_cut_a_floor_and_gaps_as_wide_as_doors_are_found() -> None:
    builder = BuildingBuilder().add_level(0).add_walkable(box(0, 0, 8, 4), walled=False)
    builder.add_wall([(4, 0), (4, 1)]).add_wall([(4, 2), (4, 4)])
    building = builder.build()
    assert [repair.kind for repair in builder.repairs] == ["door found"]
    assert sum("/door" in polygon.id for polygon in building.polygons) == 1
    assert building.area_m2 == pytest.approx(32 - 0.1 * 3, abs=0.02)  # the ends of walls reach half a thickness farther


BAD = {
    "sliver": shapely.Polygon([(0, 5), (4, 5), (4, 5 + 3.6e-10)]),
    "self-intersection": shapely.Polygon([(0, 5), (4, 9), (4, 5), (0, 9)]),
    "empty": shapely.Polygon(),
}


@pytest.mark.parametrize("kind", BAD)
def test_what_is_repaired_is_listed_and_refused_in_strict_mode(kind: str) -> None:
    builder = two_rooms().add_walkable(BAD[kind])
    assert [repair.kind for repair in builder.repairs] == [kind]
    assert builder.build().area_m2 == pytest.approx(32 + (8 if kind == "self-intersection" else 0), abs=0.01)
    with pytest.raises(MapError, match="strict"):
        two_rooms(strict=True).add_walkable(BAD[kind])


def test_edges_that_almost_coincide_are_joined() -> None:
    builder = BuildingBuilder().add_level(0).add_walkable(box(0, 0, 4, 4), walled=False)
    building = builder.add_walkable(box(4.003, 0, 8, 4), walled=False).build()
    assert is_connected(building)
    assert [repair.kind for repair in builder.repairs] == ["edges joined"]
    assert compile_map(building) is not None


def stairwell(kind: str = "stairs", *, far: bool = False, turn_deg: float = 0.0) -> tuple[BuildingBuilder, Building]:
    """A corridor on two levels and a stair of 2.5 by 6 m at its side, with the way in above at the other end if far."""

    def placed(shape: shapely.Polygon) -> shapely.Polygon:
        return affinity.translate(affinity.rotate(shape, turn_deg, origin=(0, 0)), 100, -50)

    builder = BuildingBuilder()
    for level in (0, 1):
        builder.add_level(level, height_m=3.4 * level)
        builder.add_walkable(placed(box(-4, 0, 0, 2.4) if not (far and level) else box(6, 0, 10, 2.4)), walled=False)
    builder.connect(kind, levels=(0, 1), polygon=placed(box(0, 0, 6, 2.5)))  # type: ignore[arg-type]
    return builder, builder.build()


@pytest.mark.parametrize("turn_deg", [0.0, 33.0])
@pytest.mark.parametrize(("kind", "far"), [("stairs", False), ("stairs", True), ("escalator", True)])
def test_treads_rise_evenly_from_one_level_to_the_next(kind: str, far: bool, turn_deg: float) -> None:
    builder, building = stairwell(kind, far=far, turn_deg=turn_deg)
    assert is_connected(building)
    treads = [polygon for polygon in building.polygons if polygon.kind == "stairs"]
    heights_m = np.sort([polygon.height_m for polygon in treads])
    rises_m = np.diff([0.0, *heights_m, 3.4])
    assert rises_m == pytest.approx(rises_m[0])
    assert 0.14 < rises_m[0] < (0.2 if not far else 0.25)
    assert all(abs(polygon.height_m / 3.4 - polygon.level) <= 0.5 + 1e-9 for polygon in treads)
    assert {repair.kind for repair in builder.repairs} <= {"treads made", "edges joined"}


@pytest.mark.parametrize("up", [(1.0, 0.0), (-1.0, 0.0)])
def test_a_stair_leads_up_in_the_direction_that_is_drawn(up: tuple[float, float]) -> None:
    builder = BuildingBuilder()
    for level in (0, 1):
        builder.add_level(level, height_m=3.0 * level).add_walkable(box(-10, -10, 20, 10), walled=False)
    building = builder.connect("stairs", levels=(0, 1), polygon=box(0, -1, 9, 1), up=up).build()
    treads = [polygon for polygon in building.polygons if polygon.kind == "stairs"]
    x_m = np.array([tread.outline_xy_m[:, 0].mean() for tread in treads])
    assert is_connected(building)
    assert (np.diff(x_m[np.argsort([tread.height_m for tread in treads])]) * up[0] > 0).all()


def test_a_stair_that_turns_about_a_centre_is_cut_by_rays() -> None:
    angle = np.linspace(0, 1.5, 16)
    ring = [*zip(3 * np.cos(angle), 3 * np.sin(angle), strict=True)]
    ring += [*zip(1.5 * np.cos(angle[::-1]), 1.5 * np.sin(angle[::-1]), strict=True)]
    ground, upper = box(1.4, -3, 3.1, 0), affinity.rotate(box(1.4, 0, 3.1, 3), np.degrees(1.5), origin=(0, 0))
    builder = BuildingBuilder().add_level(0, height_m=0).add_walkable(ground, walled=False)
    builder.add_level(1, height_m=2.6).add_walkable(upper, walled=False)
    building = builder.connect("stairs", levels=(0, 1), polygon=shapely.Polygon(ring)).build()
    assert is_connected(building)
    assert "turning" in builder.repairs[0].what


def test_a_stair_is_joined_where_its_edges_almost_coincide_with_those_of_the_floor() -> None:
    # As coordinates in degrees leave them; GEOS 3.13 finds that landing and outline share two points.
    stair = shapely.Polygon(
        [
            (9.99999999997481, 3.052849015080974e-10),
            (16.000000000025228, -1.537023037311854e-10),
            (16.000000000093294, 2.4999999997736797),
            (10.000000000031307, 2.500000000232667),
        ]
    )
    builder = BuildingBuilder()
    for level in (0, 1):
        builder.add_level(level, height_m=3.5 * level).add_walkable(box(0, 0, 16, 6), walled=False)
    building = builder.connect("stairs", levels=(0, 1), polygon=stair).build()
    assert is_connected(building)
    assert sum("landing" in polygon.id for polygon in building.polygons) == 2


@pytest.mark.parametrize("off_m", [0.004, 0.009, -0.009])
def test_a_corner_that_lies_a_little_off_a_longer_edge_leaves_no_wall(off_m: float) -> None:
    cabin = shapely.Polygon([(16, 3), (18, 3), (18, 5), (16 + off_m, 5)])
    builder = BuildingBuilder()
    for level in (0, 1):
        builder.add_level(level, height_m=3.5 * level).add_walkable(box(0, 0, 16, 6), walled=False)
    building = builder.connect("lift", levels=(0, 1), polygon=cabin).build()
    assert is_connected(building, by_lift=True)
    assert not any("doorway" in polygon.id for polygon in building.polygons)


def test_a_stair_without_room_for_treads_stays_floor_and_says_so() -> None:
    builder = BuildingBuilder().add_level(0).add_level(1)
    for level in (0, 1):
        builder.add_walkable(box(-4, 0, 0, 2), level, walled=False)
    building = builder.connect("stairs", levels=(0, 1), polygon=box(0, 0, 1, 1)).build()
    assert "stairs not joined" in {repair.kind for repair in builder.repairs}
    assert not is_connected(building)


def test_lifts_above_one_another_are_one_shaft() -> None:
    builder = BuildingBuilder()
    for level in range(3):
        builder.add_level(level, height_m=3.0 * level).add_walkable(box(0, 0, 5, 5), walled=False)
    building = builder.connect("lift", levels=(0, 1, 2), polygon=box(5, 0, 7, 2)).build()
    (shaft,) = lift_shafts(building)
    assert [building.polygons[i].level for i in shaft] == [0, 1, 2]
    assert is_connected(building, by_lift=True)
    assert not is_connected(building, by_lift=False)


@pytest.mark.parametrize(
    ("call", "why"),
    [
        (lambda b: b.add_level(0), "added twice"),
        (lambda b: b.add_level(0.5), "whole number"),
        (lambda b: b.add_level(1, height_m=1e308), "above the ground"),
        (lambda b: b.add_walkable(box(0, 0, 1e9, 1)), "larger than 100 km"),
        (lambda b: b.connect("stair", levels=(0, 1), polygon=box(0, 0, 1, 1)), "did you mean 'stairs'"),
        (lambda b: b.connect("stairs", levels=(0,), polygon=box(0, 0, 1, 1)), "two levels or more"),
        (lambda b: b.connect("stairs", levels=(0, 1), polygon={0: box(0, 0, 1, 1)}), "no outline on level 1"),
        (lambda b: b.add_walkable([(0, 0), (np.nan, 1), (1, 1)]), "not finite"),
        (lambda b: b.add_walkable(shapely.LineString([(0, 0), (1, 1)])), "close it"),
        (lambda b: b.build(), "nothing to walk on"),
    ],
)
def test_what_is_no_drawing_is_refused(call: object, why: str) -> None:
    with pytest.raises(PdrbenchError, match=why):
        call(BuildingBuilder().add_level(0))  # type: ignore[operator]


def test_a_stair_with_a_slit_of_two_nanometres_has_two_flights() -> None:
    """As drawn for a station: a U whose flights touch along their whole length."""
    slit = shapely.Polygon([(0, 0), (6, 0), (6, 3), (0, 3), (0, 1.5 + 1e-9), (4.5, 1.5 + 1e-9), (4.5, 1.5), (0, 1.5)])
    builder = BuildingBuilder()
    for level in (0, 1):
        builder.add_level(level, height_m=3.2 * level).add_walkable(box(-4, 0, 0, 3), walled=False)
    building = builder.connect("stairs", levels=(0, 1), polygon=slit).build()
    assert is_connected(building)
    assert sum(polygon.kind == "stairs" for polygon in building.polygons) > 12


_METRES = st.integers(-60, 60).map(lambda cm: cm / 10)
_RING = st.lists(st.tuples(_METRES, _METRES), min_size=3, max_size=9)


@given(
    outlines=st.lists(_RING, min_size=1, max_size=4),
    stair=_RING,
    door=st.tuples(_METRES, _METRES),
    off=st.floats(0, 1e-7),
)
@settings(max_examples=12, deadline=None, derandomize=True)
def test_whatever_is_drawn_becomes_valid_polygons_or_an_error_that_says_so(
    outlines: list[list[tuple[float, float]]], stair: list[tuple[float, float]], door: tuple[float, float], off: float
) -> None:
    builder = BuildingBuilder()
    try:
        for level in (0, 1):
            builder.add_level(level, height_m=3.0 * level)
            builder.add_walkable(box(-4, -4, 4, 4), walled=bool(level))
            for outline in outlines:
                builder.add_walkable(np.array(outline) + level * off).add_wall(shapely.LineString(outline))
            builder.add_door([door, (door[0] + 1.0, door[1] + off)])
        for kind in ("stairs", "lift"):
            builder.connect(kind, levels=(0, 1), polygon=np.array(stair) + (6.0 if kind == "lift" else 0.0))
        building = builder.build()
    except MapError as error:
        assert "outline" in str(error) or "nothing to walk on" in str(error)
        return
    for polygon in building.polygons:
        assert shapely.Polygon(polygon.outline_xy_m, polygon.holes).is_valid
