"""Cells and treads become floor polygons that know what lies across each of their edges."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np
import shapely

from pdrbench.building.polygons import WALL, FloorPolygon
from pdrbench.geometry import FloatArray
from pdrbench_formats.maps.assembly.drawing import Cell, Connection, RepairLog
from pdrbench_formats.maps.assembly.flights import Edge, StairLayout, flight_of
from pdrbench_formats.maps.assembly.shapes import is_sound, unique_id


class JoinedPolygons:
    """Floor polygons of a building while they are joined: rings, and what lies across each of their edges."""

    def __init__(self) -> None:
        self.polygons: list[tuple[str, list[FloatArray], list[int], float, int, str]] = []
        self._to_flights: dict[tuple[int, int, str], list[tuple[int, int, FloatArray, FloatArray]]] = {}
        self._ids: set[str] = set()

    def add(self, cells: Sequence[Cell], height_m: float) -> None:
        """Adds the cells of a level, open to one another where the edges that they share are no wall."""
        first = len(self.polygons)
        index: dict[int, int] = {}
        rings: list[list[FloatArray]] = []
        for k, cell in enumerate(cells):
            parts = (cell.shape.exterior, *cell.shape.interiors)
            rings.append([shapely.get_coordinates(ring)[:-1] for ring in parts])
            if not cell.is_taken:
                index[k] = first + len(index)
        across: dict[tuple[float, ...], tuple[int, int]] = {}
        for k, own in enumerate(rings):
            for edge, (a, b) in enumerate(_edges_of(own)):
                across[(*a, *b)] = (k, edge)
        for k, cell in enumerate(cells):
            if cell.is_taken:
                continue
            neighbours = []
            for edge, (a, b) in enumerate(_edges_of(rings[k])):
                other, _ = across.get((*b, *a), (-1, -1))
                neighbours.append(WALL)
                if other < 0:
                    continue
                if cells[other].is_taken:
                    if cells[other].shaft == cell.shaft:
                        key = (cell.shaft, cell.level, cells[other].id.rpartition(" ")[2].partition("^")[0])
                        entry = (index[k], edge, np.array(a), np.array(b))
                        self._to_flights.setdefault(key, []).append(entry)
                elif cell.is_open_to(cells[other]):
                    neighbours[-1] = index[other]
            id = unique_id(f"{cell.level}/{cell.id}", self._ids)
            self.polygons.append((id, rings[k], neighbours, height_m, cell.level, cell.kind))

    def edge_to_flight(
        self, shaft: int, level: int, part: str, layout: StairLayout, v_m: float
    ) -> tuple[int, int, Edge] | None:
        """Polygon and edge of the landing from which a flight begins at a v of its layout, the longest there is."""
        best = None
        for polygon, edge, a, b in self._to_flights.get((shaft, level, part), []):
            ends = layout.frame.to_uv(np.array([a, b]))[:, 1]
            length_m = float(np.hypot(*(b - a)))
            if np.abs(ends - v_m).max() < 0.05 and length_m >= 0.3 and (best is None or length_m > best[0]):
                best = (length_m, polygon, edge, (a, b))
        return best[1:] if best is not None else None

    def add_flight(
        self,
        name: str,
        levels: tuple[int, int],
        layout: StairLayout,
        number: int,
        heights_m: tuple[float, float],
        below: tuple[int, int, Edge],
        above: tuple[int, int, Edge],
    ) -> bool:
        """Adds treads and joins them to one another and to both landings; False where one is no polygon."""
        treads = flight_of(layout, number, heights_m, below[2], above[2])
        if not treads or not all(is_sound([tread.ring_xy_m]) for tread in treads):
            return False
        first = len(self.polygons)
        for k, tread in enumerate(treads):
            neighbours = [WALL] * len(tread.ring_xy_m)
            neighbours[tread.before] = first + k - 1 if k else below[0]
            neighbours[tread.after] = first + k + 1 if k < len(treads) - 1 else above[0]
            level = levels[1] if tread.is_upper else levels[0]
            id = unique_id(f"{levels[0]}/{name} up to {levels[1]} {k + 1:02d}", self._ids)
            self.polygons.append((id, [tread.ring_xy_m], neighbours, tread.height_m, level, "stairs"))
        self.polygons[below[0]][2][below[1]] = first
        self.polygons[above[0]][2][above[1]] = first + len(treads) - 1
        return True

    def leave_out_unsound(self, repairs: RepairLog) -> None:
        """Leaves out what is no simple polygon in spite of all cleaning, with a repair; a wall is where it was."""
        kept = [k for k, polygon in enumerate(self.polygons) if is_sound(polygon[1])]
        if len(kept) == len(self.polygons):
            return
        number = {old: new for new, old in enumerate(kept)}
        for id, rings, _, _, level, _ in (self.polygons[k] for k in range(len(self.polygons)) if k not in number):
            repairs.add("left out", f"level {level}, {id!r}", "no simple polygon is left of it", rings[0][0], level)
        self.polygons = [self.polygons[k] for k in kept]
        for _, _, neighbours, *_ in self.polygons:
            neighbours[:] = [number.get(other, WALL) for other in neighbours]

    def floor_polygons(self) -> tuple[FloorPolygon, ...]:
        """All of them."""
        return tuple(
            FloorPolygon(id, rings[0], np.array(neighbours), height_m, level, kind, tuple(rings[1:]))
            for id, rings, neighbours, height_m, level, kind in self.polygons
        )


def add_flights(
    joined: JoinedPolygons,
    k: int,
    shaft: Connection,
    layout: StairLayout,
    height_m: Mapping[int, float],
    repairs: RepairLog,
) -> None:
    """Adds the treads between each two levels and joins them to their landings."""
    for number, (lower, upper) in enumerate(zip(shaft.levels, shaft.levels[1:], strict=False)):
        heights_m = (height_m[lower], height_m[upper])
        arrival = "down" if layout.form == "half_turn" or upper == shaft.levels[-1] else "up"
        target = layout.far_m if layout.form == "straight" else layout.near_m
        below = joined.edge_to_flight(k, lower, "up", layout, layout.near_m)
        above = joined.edge_to_flight(k, upper, arrival, layout, target)
        if below is None or above is None:
            level = lower if below is None else upper
            what = f"no landing is left on level {level}: not joined"
        elif not joined.add_flight(shaft.id, (lower, upper), layout, number, heights_m, below, above):
            level, what = lower, "its treads would cross one another: left out, not joined"
        else:
            continue
        middle = layout.frame.to_xy(np.array([layout.core.centroid.coords[0]]))[0]
        repairs.add("stairs not joined", f"{shaft.kind} {shaft.id!r}", what, middle, level)


def _edges_of(rings: Iterable[FloatArray]) -> Iterable[tuple[tuple[float, ...], tuple[float, ...]]]:
    """First and second vertex of every edge, ring by ring."""
    for ring in rings:
        points = [tuple(point) for point in ring.tolist()]
        yield from zip(points, [*points[1:], points[0]], strict=True)
