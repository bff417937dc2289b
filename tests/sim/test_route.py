from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.building.connectivity import reachable_parts
from pdrbench_sim.people.route import Place, RouteError, navigation_mesh


def assert_walkable(building: Building, route) -> None:
    """Every leg runs inside its polygon and ends in the next one's."""
    for i in range(len(route.polygon)):
        reached, alive = building.move(route.polygon[i : i + 1], route.xy_m[i : i + 1], route.xy_m[i + 1 : i + 2])
        assert alive.all()
        if i + 1 == len(route.polygon):
            assert reached[0] == route.polygon[i]


def test_a_non_convex_room_is_walked_around_its_inner_corner(l_room):
    start, goal = Place(0, [7, 2]), Place(0, [2, 7])
    straight_m = 2 * math.hypot(3, 2)  # over the corner itself
    tight = navigation_mesh(l_room).route(start, goal, clearance_m=1e-6)
    assert tight.length_m == pytest.approx(straight_m, abs=1e-4)
    wide = navigation_mesh(l_room).route(start, goal, clearance_m=0.4)
    # At 0.4 m from the corner the line is longer by at most the detour over a point 0.4 m inside on each axis.
    assert straight_m < wide.length_m < 2 * math.hypot(3 + 0.4, 2 - 0.4) + 1e-9
    corner_m = np.hypot(*(wide.xy_m[1:-1] - [4, 4]).T)
    assert corner_m.min() >= 0.4 - 1e-9
    assert_walkable(l_room, wide)


def test_a_hole_is_passed_on_the_shorter_side(ring):
    route = navigation_mesh(ring).route(Place(0, [1, 7]), Place(0, [9, 7]), clearance_m=1e-6)
    over_top_m = 2 * math.hypot(2, 1) + 4
    assert route.length_m == pytest.approx(over_top_m, abs=1e-4)
    assert route.xy_m[1:-1, 1].min() > 7.9
    assert_walkable(ring, route)


def test_a_door_is_passed_clear_of_its_jambs_and_unconnected_places_are_named(two_rooms):
    route = navigation_mesh(two_rooms).route(Place(0, [0.5, 3.5]), Place(1, [7.5, 3.5]), clearance_m=0.4)
    np.testing.assert_array_equal(np.unique(route.polygon), [0, 1])
    (in_door,) = route.xy_m[np.isclose(route.xy_m[:, 0], 4)]
    assert 1.4 - 1e-9 <= in_door[1] <= 1.5 + 1e-9
    assert_walkable(two_rooms, route)
    mesh = navigation_mesh(two_rooms)
    start = Place(0, [1, 1])
    np.testing.assert_array_equal(reachable_parts(two_rooms, by_lift=False), [0, 0, 1])
    with pytest.raises(RouteError, match=r"no way leads from \(1.00, 1.00\) in polygon 'west'.*'alone'.*neighbour"):
        mesh.route(start, Place(2, [10, 2]))


def test_a_gap_too_narrow_for_a_body_is_taken_only_when_nothing_else_leads_there(room):
    # From the left half to the right one: straight through 0.3 m, or by a detour at the top.
    pillar = [(4.8, 0.3), (4.8, 4.5), (5.2, 4.5), (5.2, 0.3)]
    detour = Building("detour", (room("hall", [(0, 0), (10, 0), (10, 6), (0, 6)], holes=(pillar,)),))
    route = navigation_mesh(detour).route(Place(0, [4, 0.5]), Place(0, [6, 0.5]))
    assert route.xy_m[:, 1].max() > 4.5
    pillar = [(4.8, 0.3), (4.8, 5.9), (5.2, 5.9), (5.2, 0.3)]
    squeeze = Building("squeeze", (room("hall", [(0, 0), (10, 0), (10, 6), (0, 6)], holes=(pillar,)),))
    route = navigation_mesh(squeeze).route(Place(0, [4, 0.5]), Place(0, [6, 0.5]))
    assert route.length_m < 3


def test_routes_are_the_same_in_a_rotated_and_shifted_building(room):
    angle = 0.7
    turn = np.array([[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]])
    outline = np.array([(0, 0), (8, 0), (8, 4), (4, 4), (4, 8), (0, 8)], dtype=float)
    there = Building("there", (room("L", outline),))
    moved = Building("moved", (room("L", outline @ turn + [30, -5]),))
    start, goal = np.array([7.0, 2.0]), np.array([2.0, 7.0])
    one = navigation_mesh(there).route(Place(0, start), Place(0, goal))
    other = navigation_mesh(moved).route(Place(0, start @ turn + [30, -5]), Place(0, goal @ turn + [30, -5]))
    np.testing.assert_allclose(other.xy_m, one.xy_m @ turn + [30, -5], atol=1e-9)


def test_stairs_are_climbed_tread_by_tread(office, mesh):
    rng = np.random.default_rng(0)
    (low,), (low_xy_m,) = office.sample_uniform(rng, 1, level=0)
    (high,), (high_xy_m,) = office.sample_uniform(rng, 1, level=2)
    route = mesh.route(Place(low, low_xy_m), Place(high, high_xy_m))
    height_m = office.height(route.polygon)
    passed_m = height_m[np.concatenate([[True], np.diff(route.polygon) != 0])]
    steps_m = np.diff(passed_m)
    assert passed_m[0] == office.height(low)
    assert passed_m[-1] == office.height(high)
    assert np.abs(steps_m).max() < 0.18
    assert_walkable(office, route)


def test_all_rooms_of_an_office_can_be_walked_to(office, mesh):
    rng = np.random.default_rng(1)
    polygon, xy_m = office.sample_uniform(rng, 20)
    start = Place(polygon[0], xy_m[0])
    assert not reachable_parts(office, by_lift=False).any()
    for there, there_xy_m in zip(polygon, xy_m, strict=True):
        assert_walkable(office, mesh.route(start, Place(there, there_xy_m)))


@pytest.mark.parametrize("place", [Place(0, [5, 5]), Place(7, [1, 1]), Place(-1, [1, 1]), Place(0, [np.nan, 1])])
def test_a_place_outside_its_polygon_is_refused(two_rooms, place):
    with pytest.raises(RouteError, match="polygon"):
        navigation_mesh(two_rooms).route(place, Place(1, [6, 2]))
