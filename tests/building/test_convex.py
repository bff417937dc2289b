"""The floor as convex cells: nothing is lost, nothing overlaps, every passage leads back."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import Building, FloorPolygon, FloorRegion
from pdrbench.building.convex import compile_map
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
def test_cells_cover_every_polygon_once(house: Building, angle_rad: float, shift_m: float) -> None:
    building = turned(house, angle_rad, shift_m)
    convex = compile_map(building)
    corners, cell = convex.cells_of(FloorRegion.whole(building))
    of_polygon = np.zeros(len(building.polygons))
    np.add.at(of_polygon, convex.polygon[cell], area_m2(corners.astype(np.float64)))
    np.testing.assert_allclose(of_polygon, [p.area_m2 for p in building.polygons], rtol=1e-4)


def test_rectangles_stay_whole(house: Building) -> None:
    convex = compile_map(house)
    cells = np.bincount(convex.polygon)
    is_rectangle = np.array([len(p.neighbour) == 4 for p in house.polygons])
    assert (cells[is_rectangle] == 1).all()
    assert cells[0] > 1  # the hall has a reflex corner and a hole


def test_boxes_lie_inside(house: Building) -> None:
    convex = compile_map(turned(house, 0.4))
    x0, y0, x1, y1 = convex.world.box_m.T
    for x, y in ((x0, y0), (x1, y0), (x1, y1), (x0, y1)):
        assert convex.outside_m(np.arange(len(convex)), np.column_stack([x, y])).max() <= 0


def test_every_portal_leads_back(house: Building) -> None:
    """The cell behind a portal has a portal on the same line, of the same length, that leads back."""
    convex = compile_map(house)
    line_of_portal = np.repeat(np.arange(len(convex.world.line)), np.diff(convex.world.first_portal))
    cell_of_line = np.repeat(np.arange(len(convex)), np.diff(convex.world.first_line))
    for portal, (cell, entered) in enumerate(convex.world.neighbour):
        assert cell_of_line[entered] == cell
        back = range(convex.world.first_portal[entered], convex.world.first_portal[entered + 1])
        here = line_of_portal[portal]
        assert any(
            convex.world.neighbour[b, 0] == cell_of_line[here]
            and convex.world.neighbour[b, 1] == here
            and np.isclose(np.ptp(convex.world.portal[b]), np.ptp(convex.world.portal[portal]), atol=1e-5)
            for b in back
        )


def test_walls_have_no_portals(house: Building) -> None:
    """The total width of portals between polygons is that of the connections, less the tolerance at both ends."""
    convex = compile_map(house)
    line_of_portal = np.repeat(np.arange(len(convex.world.line)), np.diff(convex.world.first_portal))
    cell_of_line = np.repeat(np.arange(len(convex)), np.diff(convex.world.first_line))
    leaves = convex.polygon[cell_of_line[line_of_portal]] != convex.polygon[convex.world.neighbour[:, 0]]
    width_m = (np.ptp(convex.world.portal, axis=1) + 2 * convex.tolerance_m)[leaves].sum()
    joined = house.edge_neighbour >= 0
    expected_m = np.hypot(*(house.edge_end_xy_m - house.edge_start_xy_m)[joined].T).sum()
    assert width_m == pytest.approx(expected_m, abs=1e-4)


def test_a_region_is_cut_along_the_cells(house: Building) -> None:
    convex = compile_map(house)
    square = np.array([[[1.0, 1.0], [5.0, 1.0], [5.0, 5.0]]])
    corners, cell = convex.cells_of(FloorRegion(square, np.array([0])))
    centres = corners.mean(axis=1)
    assert convex.outside_m(cell.astype(np.int64), centres).max() < 0
    assert (np.diff(cell) >= 0).all()
    # the triangle of 8 m2 less the part of the pillar [2, 3] x [2, 3] under its diagonal
    assert area_m2(corners.astype(np.float64)).sum() == pytest.approx(8.0 - 0.5, abs=1e-4)
