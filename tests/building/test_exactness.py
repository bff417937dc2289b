"""Bit-exact properties, and input that is certainly a mistake."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
import shapely

from pdrbench.building import WALL, Building, FloorPolygon, Zone
from pdrbench.errors import MapError

CELLS = 6
SQUARE = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]


def cells(rng: np.random.Generator, *, turn_rad: float = 0.0, shift_m: float = 0.0, jitter_m: float = 0.0) -> Building:
    """Unit cells of which two in five inner edges are walls; `jitter_m` moves every vertex of every cell by itself."""
    c, s = np.cos(turn_rad), np.sin(turn_rad)
    upright = rng.random((CELLS + 1, CELLS + 1)) < 0.4
    across = rng.random((CELLS + 1, CELLS + 1)) < 0.4

    def cell(i: int, j: int, is_wall: bool) -> int:
        return i * CELLS + j if 0 <= i < CELLS and 0 <= j < CELLS and not is_wall else WALL

    polygons = []
    for i in range(CELLS):
        for j in range(CELLS):
            outline = np.array([[i, j], [i + 1, j], [i + 1, j + 1], [i, j + 1]], dtype=float)
            neighbour = [
                cell(i, j - 1, bool(across[i, j])),
                cell(i + 1, j, bool(upright[i + 1, j])),
                cell(i, j + 1, bool(across[i, j + 1])),
                cell(i - 1, j, bool(upright[i, j])),
            ]
            placed = outline @ np.array([[c, s], [-s, c]]) + shift_m + rng.uniform(-jitter_m, jitter_m, (4, 2))
            polygons.append(FloorPolygon(f"{i}-{j}", placed, neighbour, 0.0, 0))
    return Building("cells", tuple(polygons))


@pytest.mark.parametrize(
    ("turn_rad", "shift_m", "jitter_m"),
    [(0.0, 0.0, 0.0), (0.7, 0.0, 0.0), (0.7, 5e5, 0.0), (0.7, 0.0, 4.9e-7)],
    ids=["plain", "turned", "far", "loose"],
)
def test_no_particle_slips_past_a_corner(
    rng: np.random.Generator, turn_rad: float, shift_m: float, jitter_m: float
) -> None:
    """An alive point ends in its reported polygon, even when aimed at vertices of a map with rounding gaps."""
    building = cells(rng, turn_rad=turn_rad, shift_m=shift_m, jitter_m=jitter_m)
    polygon, start = building.sample_uniform(rng, 40_000)
    vertices = building.edge_start_xy_m[rng.integers(0, len(building.edge_start_xy_m), 40_000)]
    end = start + (vertices - start) * rng.choice([1.0, 1.5, 3.0], (40_000, 1))
    reached, alive = building.move(polygon, start, end)
    shapes = np.array([shapely.Polygon(p.outline_xy_m) for p in building.polygons])
    assert alive.sum() > 100
    # connected edges may differ by 1e-6 m in x and y, and a joined vertex may lie that far from its polygon
    assert shapely.distance(shapes[reached], shapely.points(end))[alive].max() < 5e-6


def exact_walk(building: Building, polygon: int, start: list[int], end: list[int]) -> tuple[int, bool]:
    """Algorithm 1 in rational numbers: a wall met anywhere on the way out, ends included, ends the segment."""
    here, done, entered = polygon, Fraction(0), -1
    ax, ay = (Fraction(int(v)) for v in start)
    dx, dy = Fraction(int(end[0])) - ax, Fraction(int(end[1])) - ay
    for _ in range(64):
        walls, connections = [], []
        for edge in range(building.first_edge[here], building.first_edge[here + 1]):
            px, py = (Fraction(float(v)) for v in building.edge_start_xy_m[edge])
            qx, qy = (Fraction(float(v)) for v in building.edge_end_xy_m[edge])
            outward = dx * (qy - py) - dy * (qx - px)
            if outward <= 0 or edge == entered:
                continue
            t = ((px - ax) * (qy - py) - (py - ay) * (qx - px)) / outward
            across = ((px - ax) * dy - (py - ay) * dx) / outward
            if not (done <= t <= 1 and 0 <= across <= 1):
                continue
            if building.edge_neighbour[edge] == WALL:
                walls.append(t)
            elif across > 0:
                connections.append((t, edge))
        first = min(connections, default=(Fraction(2), -1))
        if walls and min(walls) <= first[0]:
            return polygon, False
        if first[1] < 0:
            return here, True
        done, entered = first[0], int(building.edge_twin[first[1]])
        here = int(building.edge_neighbour[first[1]])
    return polygon, False


def test_agrees_with_rational_arithmetic_on_a_lattice(rng: np.random.Generator) -> None:
    """Starts and ends on a lattice: through vertices, along walls, onto edges, nowhere at all."""
    plain = cells(rng)
    building = Building(
        "lattice", tuple(FloorPolygon(p.id, p.outline_xy_m * 4, p.neighbour, 0.0, 0) for p in plain.polygons)
    )
    polygon = rng.integers(0, len(building.polygons), 2000)
    corner = np.array([building.polygons[p].outline_xy_m[0] for p in polygon])
    start = corner + rng.integers(0, 5, (2000, 2))
    end = start + rng.integers(-9, 10, (2000, 2))
    reached, alive = building.move(polygon, start, end)
    expected = [exact_walk(building, int(p), a, b) for p, a, b in zip(polygon, start, end, strict=True)]
    assert list(zip(reached.tolist(), alive.tolist(), strict=True)) == expected
    assert 0.1 < alive.mean() < 0.9


@pytest.mark.parametrize("lost", [np.nan, np.inf, -np.inf])
def test_a_segment_that_is_not_finite_is_not_alive(lost: float) -> None:
    room = Building("room", (FloorPolygon("a", SQUARE, [WALL] * 4, 0.0, 0),))
    inside = [[0.5, 0.5]]
    assert not room.move([0], inside, [[lost, 0.5]])[1].any()
    assert not room.move([0], [[0.5, lost]], inside)[1].any()


def test_the_centre_keeps_off_the_walls_and_claims_no_survey() -> None:
    hole = [[1.0, 1.0], [1.0, 8.0], [8.0, 8.0], [8.0, 1.0]]
    wide = FloorPolygon("r", [[-3, -3], [12, -3], [12, 12], [-3, 12]], [WALL] * 8, 0.0, 0, holes=(hole,))
    building = Building("ring", (wide,))
    start = building.centre()
    edges = shapely.linestrings(np.stack([building.edge_start_xy_m, building.edge_end_xy_m], axis=1))
    assert shapely.distance(edges, shapely.Point(start.xy_m)).min() == pytest.approx(0.5, abs=1e-6)
    corners = np.hypot(*(building.edge_start_xy_m - start.xy_m).T)
    assert start.radius_m == pytest.approx(corners.max())


def polygon(**changes: object) -> FloorPolygon:
    fields = {"id": "a", "outline_xy_m": SQUARE, "neighbour": [WALL] * 4, "height_m": 0.0, "level": 0}
    return FloorPolygon(**(fields | changes))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        (("", "", SQUARE, 0), "a zone: id"),
        (("z", 3, SQUARE, 0), "zone 'z': name"),
        (("z", "", SQUARE, 1.5), "zone 'z': level"),
        (("z", "", SQUARE[:2], 0), "zone 'z'.*three vertices"),
    ],
)
def test_a_malformed_zone_is_a_map_error(fields: tuple[object, ...], message: str) -> None:
    with pytest.raises(MapError, match=message):
        Zone(*fields)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("pieces", "message"),
    [
        ((3,), "expected a FloorPolygon at 0, got int"),
        (
            (polygon(outline_xy_m=[[0, 0], [50, 0], [50, 1e-5], [0, 1e-5]]),),
            "'a' is a sliver: 1e-05 m wide along edge 0 of 50 m",
        ),
        ((polygon(outline_xy_m=[[0, 0], [2, 0], [1, 1], [2, 2], [0, 2], [1, 1]], neighbour=[WALL] * 6),), "edge 1"),
    ],
)
def test_a_malformed_building_is_a_map_error(pieces: tuple[FloorPolygon, ...], message: str) -> None:
    with pytest.raises(MapError, match=message):
        Building("bad", pieces)


def test_two_connections_between_the_same_polygons_find_their_own_twin() -> None:
    left = FloorPolygon(
        "left", [[0, 0], [1, 0], [1, 1], [1, 2], [1, 3], [0, 3]], [WALL, 1, WALL, 1, WALL, WALL], 0.0, 0
    )
    right = FloorPolygon(
        "right", [[1, 0], [2, 0], [2, 3], [1, 3], [1, 2], [1, 1]], [WALL, WALL, WALL, 0, WALL, 0], 0.0, 0
    )
    building = Building("two doors", (left, right))
    assert building.edge_twin.tolist() == [-1, 11, -1, 9, -1, -1, -1, -1, -1, 3, -1, 1]
    reached, alive = building.move([0, 0, 0], [[0.5, y] for y in (0.5, 1.5, 2.5)], [[1.5, y] for y in (0.5, 1.5, 2.5)])
    assert reached.tolist() == [1, 0, 1] and alive.tolist() == [True, False, True]
