"""The route graph on floors where its shape is known, and on offices: inside, connected, near to every place."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.building.connectivity import reachable_parts
from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray, IntArray
from pdrbench_baselines.viterbi_map.route_graph import RouteGraph, RouteGraphParams, route_graph
from pdrbench_baselines.viterbi_map.route_map import RouteMapParams, route_map
from pdrbench_sim.buildings.assembly import Cell, Opening, assemble, rectangle
from pdrbench_sim.buildings.office import make_office

PARAMS = RouteGraphParams()


def make(cells: list[Cell], openings: list[Opening] | None = None) -> Building:
    return Building("made", assemble(cells, openings or []))


def turned(building: Building, angle_rad: float, shift_m: tuple[float, float]) -> Building:
    turn = np.array([[math.cos(angle_rad), -math.sin(angle_rad)], [math.sin(angle_rad), math.cos(angle_rad)]])
    polygons = (
        FloorPolygon(
            p.id,
            p.outline_xy_m @ turn.T + shift_m,
            p.neighbour,
            p.height_m,
            p.level,
            p.kind,
            tuple(hole @ turn.T + shift_m for hole in p.holes),
        )
        for p in building.polygons
    )
    return Building(building.name, tuple(polygons))


def parts(graph: RouteGraph) -> IntArray:
    """(N,) number of the part of the graph of each point."""
    size = (len(graph), len(graph))
    ways = coo_array((np.ones(len(graph.pair)), (graph.pair[:, 0], graph.pair[:, 1])), shape=size)
    return np.asarray(connected_components(ways, directed=False)[1])


def sticks_out_m(building: Building, graph: RouteGraph, polygon: IntArray, xy_m: FloatArray) -> FloatArray:
    """(K,) by how much places (K, 2) lie outside the nearest disc of a point that they see."""
    out_m = np.full(len(xy_m), np.inf)
    found: Any = cKDTree(graph.xy_m).query(xy_m, k=min(24, len(graph)))
    for away, near in zip(found[0].T, found[1].T, strict=True):
        reached, alive = building.move(polygon, xy_m, graph.xy_m[near])
        sees = alive & (np.abs(building.height(reached) - building.height(graph.polygon[near])) < 1.0)
        out_m = np.minimum(out_m, np.where(sees, away - graph.clearance_m[near], np.inf))
    return out_m


def check(building: Building) -> RouteGraph:
    """The properties of a graph of a building with one connected group of levels, or one level."""
    graph = route_graph(building, building.levels[0])
    height_m = building.height(graph.polygon)
    # Inside: every point lies on its polygon, every way is a straight walk that ends beside its point.
    assert (building.locate(graph.xy_m, building.level(graph.polygon)) >= 0).all()
    one, other = graph.pair.T
    reached, alive = building.move(graph.polygon[one], graph.xy_m[one], graph.xy_m[other])
    assert alive.all()
    assert (np.abs(building.height(reached) - height_m[other]) < 1.0).all()
    assert graph.way_m == pytest.approx(np.hypot(*(graph.xy_m[one] - graph.xy_m[other]).T))
    # Connected exactly where the floor is.
    floor, net = reachable_parts(building, by_lift=False), parts(graph)
    assert set(floor) == set(floor[graph.polygon])
    pairs = {tuple(pair) for pair in np.column_stack([floor[graph.polygon], net]).tolist()}
    assert len(pairs) == len(set(floor)) == len(set(net))
    # Near to every place: discs are spaced by a metre and spurs whose discs stick out by half a metre are cut.
    polygon, xy_m = building.sample_uniform(np.random.default_rng(3), 2000)
    out_m = sticks_out_m(building, graph, polygon, xy_m)
    assert out_m.max() < PARAMS.spur_m + PARAMS.spacing_m / 2
    assert np.quantile(out_m, 0.95) < 0.1
    return graph


def test_the_axis_of_a_corridor_is_its_middle() -> None:
    graph = check(make([Cell("corridor", rectangle(0, 0, 20, 2), 0.0, 0)]))
    assert graph.xy_m[:, 1] == pytest.approx(1.0, abs=0.05)
    assert graph.clearance_m == pytest.approx(1.0, abs=0.05)
    assert np.ptp(graph.xy_m[:, 0]) == pytest.approx(18.0, abs=0.4)  # spurs into the corners are cut
    assert graph.way_m.sum() == pytest.approx(18.0, abs=0.4)


def test_a_loop_stays_a_loop() -> None:
    ring = [(0.0, 0.0), (12.0, 0.0), (12.0, 10.0), (0.0, 10.0)]
    hole = np.array([(2.0, 2.0), (2.0, 8.0), (10.0, 8.0), (10.0, 2.0)])
    graph = check(Building("loop", (FloorPolygon("loop", np.array(ring), np.full(8, WALL), 0.0, 0, holes=(hole,)),)))
    assert len(graph.pair) >= len(graph)  # a tree has one pair less than points


def test_doors_join_rooms_and_walls_part_them() -> None:
    rooms = [Cell("a", rectangle(0, 0, 4, 4), 0.0, 0), Cell("b", rectangle(4, 0, 8, 4), 0.0, 0)]
    rooms.append(Cell("c", rectangle(8, 0, 12, 4), 0.0, 0))
    building = make(rooms, [Opening("a", "b", (4.0, 1.0), (4.0, 1.9))])
    graph = check(building)
    assert len(set(parts(graph))) == 2
    door = np.hypot(*(graph.xy_m - [4.0, 1.45]).T)
    assert door.min() < 0.25  # a point at the narrowest place


def test_halls_have_rings_and_corridors_none() -> None:
    hall = check(make([Cell("hall", rectangle(0, 0, 30, 24), 0.0, 0)]))
    assert hall.is_ring.sum() > 40
    away_m = np.sort(hall.clearance_m[hall.is_ring] % PARAMS.ring_m)
    assert np.minimum(away_m, PARAMS.ring_m - away_m).max() < 0.1
    corridor = check(make([Cell("corridor", rectangle(0, 0, 30, 3), 0.0, 0)]))
    assert not corridor.is_ring.any()


@pytest.mark.parametrize("seed", [4, 7])
def test_offices_with_stairs(seed: int) -> None:
    office = make_office(np.random.default_rng(seed), num_levels=2, area_m2=1200.0)
    graph = check(office)
    level = office.level(graph.polygon)
    assert set(level) == {0, 1}
    assert (level[graph.pair[:, 0]] != level[graph.pair[:, 1]]).any()


@pytest.mark.parametrize("angle_rad", [0.3, 1.9])
def test_turning_and_shifting_a_building_turns_and_shifts_its_graph(office: Building, angle_rad: float) -> None:
    shift_m = (120.0, -45.0)
    before, after = route_graph(office, 0), route_graph(turned(office, angle_rad, shift_m), 0)
    turn = np.array([[math.cos(angle_rad), -math.sin(angle_rad)], [math.sin(angle_rad), math.cos(angle_rad)]])
    axis = before.xy_m[~before.is_ring] @ turn.T + shift_m
    # Rounding moves points along the axis, or takes a spur that is as long as the limit; no more.
    away_m, near = cKDTree(after.xy_m[~after.is_ring]).query(axis)
    assert np.quantile(away_m, 0.99) < PARAMS.spacing_m
    assert np.median(np.abs(before.clearance_m[~before.is_ring] - after.clearance_m[~after.is_ring][near])) < 0.02
    length_m = [float(g.way_m[~g.is_ring[g.pair].any(axis=1)].sum()) for g in (before, after)]
    assert length_m[0] == pytest.approx(length_m[1], rel=0.01)


def test_a_level_that_nothing_joins_has_a_graph_of_its_own() -> None:
    building = make([Cell("a", rectangle(0, 0, 9, 9), 0.0, 0), Cell("b", rectangle(0, 0, 9, 5), 4.0, 1)])
    assert set(building.level(route_graph(building, 1).polygon)) == {1}
    with pytest.raises(MapError, match="no level 3"):
        route_graph(building, 3)


def test_a_map_of_routes_knows_ways_and_walls() -> None:
    rooms = [Cell("a", rectangle(0, 0, 10, 10), 0.0, 0), Cell("b", rectangle(10, 0, 20, 10), 0.0, 0)]
    routes = route_map(make(rooms, [Opening("a", "b", (10.0, 1.0), (10.0, 2.0))]), 0, RouteMapParams())

    def walked(start_m: tuple[float, float], end_m: tuple[float, float], *, is_open: bool) -> bool:
        _, point = routes.nearest(np.array(start_m), 0)
        to_m = np.array([end_m]) - routes.origin_xy_m
        _, is_floor = routes.walk(to_m, np.array([point], dtype=np.int32), is_open=is_open)
        return bool(is_floor[0])

    assert walked((5.0, 5.0), (6.5, 5.5), is_open=True)
    assert walked((9.2, 1.5), (10.8, 1.5), is_open=True)  # through the door
    assert not walked((9.0, 8.0), (11.5, 8.0), is_open=True)
    assert walked((9.0, 8.0), (11.5, 8.0), is_open=False)
    place_m, point = routes.nearest(np.array([-3.0, 5.0]), 0)
    away_m = np.hypot(*(place_m - routes.origin_xy_m - routes.local_m[point]))
    assert away_m == pytest.approx(routes.radius_m[point])
    with pytest.raises(MapError, match="no floor on level 2"):
        routes.nearest(np.zeros(2), 2)
