"""The floor as convex pieces: nothing is lost, nothing overlaps, every passage leads back."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import Building, FloorPolygon, FloorRegion
from pdrbench.building.convex import ConvexMap, compile_map
from pdrbench.geometry import FloatArray


def turned(building: Building, angle_rad: float, shift_m: float = 0.0) -> Building:
    c, s = np.cos(angle_rad), np.sin(angle_rad)

    def place(xy_m: FloatArray) -> FloatArray:
        placed: FloatArray = xy_m @ np.array([[c, s], [-s, c]]) + shift_m
        return placed

    return Building(
        building.name,
        tuple(
            FloorPolygon(
                p.id, place(p.outline_xy_m), p.neighbour, p.height_m, p.level, p.kind, tuple(place(h) for h in p.holes)
            )
            for p in building.polygons
        ),
    )


def area_m2(corners: FloatArray) -> FloatArray:
    (x1, y1), (x2, y2) = (corners[:, 1] - corners[:, 0]).T, (corners[:, 2] - corners[:, 0]).T
    area: FloatArray = np.abs(x1 * y2 - y1 * x2) / 2
    return area


@pytest.mark.parametrize("angle_rad", [0.0, 0.3, 1.1])
@pytest.mark.parametrize("shift_m", [0.0, 3e5])
def test_pieces_cover_every_polygon_once(house: Building, angle_rad: float, shift_m: float) -> None:
    building = turned(house, angle_rad, shift_m)
    world = compile_map(building)
    corners, piece = world.pieces_of(FloorRegion.whole(building))
    of_polygon = np.zeros(len(building.polygons))
    np.add.at(of_polygon, world.polygon[piece], area_m2(corners.astype(np.float64)))
    np.testing.assert_allclose(of_polygon, [p.area_m2 for p in building.polygons], rtol=1e-4)


def test_rectangles_stay_whole(house: Building) -> None:
    world = compile_map(house)
    pieces = np.bincount(world.polygon)
    is_rectangle = np.array([len(p.neighbour) == 4 for p in house.polygons])
    assert (pieces[is_rectangle] == 1).all()
    assert pieces[0] > 1  # the hall has a reflex corner and a hole


def test_corners_of_a_piece_are_on_its_boundary(house: Building) -> None:
    world = compile_map(turned(house, 0.4))
    piece = np.repeat(np.arange(len(world)), np.diff(world.first_corner))
    outside_m = world.outside_m(piece, world.corner_xy_m.astype(np.float32))
    assert np.abs(outside_m).max() < world.tolerance_m


def test_boxes_lie_inside(house: Building) -> None:
    world = compile_map(turned(house, 0.4))
    x0, y0, x1, y1 = world.box_m.T
    for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1)):
        assert world.outside_m(np.arange(len(world)), np.column_stack([x, y])).max() <= 0


def test_every_gate_leads_back(house: Building) -> None:
    """Behind a gate lies a piece with a gate on the line one came through, of the same length, that leads here."""
    world = compile_map(house)
    line_of_gate = np.repeat(np.arange(len(world.line)), np.diff(world.first_gate))
    piece_of_line = np.repeat(np.arange(len(world)), np.diff(world.first_line))
    for gate, (piece, entered) in enumerate(world.gate_to):
        assert piece_of_line[entered] == piece
        back = range(world.first_gate[entered], world.first_gate[entered + 1])
        here = line_of_gate[gate]
        assert any(
            world.gate_to[b, 0] == piece_of_line[here]
            and world.gate_to[b, 1] == here
            and np.isclose(np.ptp(world.gate[b]), np.ptp(world.gate[gate]), atol=1e-5)
            for b in back
        )


def test_walls_have_no_gates(house: Building) -> None:
    """The total width of gates between polygons is that of the connections, less the tolerance at both ends."""
    world = compile_map(house)
    line_of_gate = np.repeat(np.arange(len(world.line)), np.diff(world.first_gate))
    piece_of_line = np.repeat(np.arange(len(world)), np.diff(world.first_line))
    leaves = world.polygon[piece_of_line[line_of_gate]] != world.polygon[world.gate_to[:, 0]]
    width_m = (np.ptp(world.gate, axis=1) + 2 * world.tolerance_m)[leaves].sum()
    joined = house.edge_neighbour >= 0
    expected_m = np.hypot(*(house.edge_end_xy_m - house.edge_start_xy_m)[joined].T).sum()
    assert width_m == pytest.approx(expected_m, abs=1e-4)


def test_a_region_is_cut_along_the_pieces(house: Building) -> None:
    world = compile_map(house)
    square = np.array([[[1.0, 1.0], [5.0, 1.0], [5.0, 5.0]]])
    corners, piece = world.pieces_of(FloorRegion(square, np.array([0])))
    centres = corners.mean(axis=1)
    assert world.outside_m(piece.astype(np.int64), centres).max() < 0
    assert (np.diff(piece) >= 0).all()
    # the triangle of 8 m2 less the part of the pillar [2, 3] x [2, 3] under its diagonal
    assert area_m2(corners.astype(np.float64)).sum() == pytest.approx(8.0 - 0.5, abs=1e-4)


def test_an_empty_region_has_no_triangles(house: Building) -> None:
    corners, piece = compile_map(house).pieces_of(FloorRegion(np.zeros((0, 3, 2)), np.zeros(0)))
    assert corners.shape == (0, 3, 2)
    assert len(piece) == 0


def test_compiled_once(house: Building) -> None:
    assert isinstance(compile_map(house), ConvexMap)
    assert compile_map(house) is compile_map(house)
