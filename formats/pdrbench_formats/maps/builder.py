"""Buildings from drawings: outlines, walls, doors, stairs and lifts become floor polygons joined along their edges.

A level is a set of areas that one can walk on. Walls are taken out of them, or, where areas meet without one, lie on
the line between them. A door is a floor polygon of its own, as deep as the wall that it passes. A stair becomes
landings and treads. What had to be mended in the drawing is listed as `Repair`; in strict mode the first is an error.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal, Self

import numpy as np

from pdrbench.building.building import Building
from pdrbench.building.polygons import WALL, FloorPolygon, Zone
from pdrbench.errors import MapError, unknown_name
from pdrbench.geometry import FloatArray
from pdrbench.io.geo import GeoFrame
from pdrbench.io.plan import Plan, Repair, suspicions
from pdrbench_formats.maps.flights import Edge, StairLayout, flight_of, lay_out, parts_on_level

ConnectionKind = Literal["stairs", "escalator", "lift"]
CONNECTION_KINDS: Final = ("stairs", "escalator", "lift")
LEVEL_HEIGHT_M: Final = 3.5  # assumed between levels where a drawing has no heights; common in offices
WALL_M: Final = 0.1  # thickness of a wall that is drawn as a line
DOOR_M: Final = 0.9  # width of a door that is drawn as a point
SNAP_M: Final = 0.005  # vertices closer than this are one
STRAIGHT_M: Final = 0.002  # vertices that bend an edge by an area below this length squared are left out
GAP_M: Final = 0.03  # enclosed gaps narrower than this are filled, necks of floor narrower than twice this are cut
MIN_PART_M2: Final = 0.3  # smaller parts of a floor that walls cut off are dropped: too small to stand on
MIN_WIDTH_M: Final = 0.25  # narrower ones as well, such as the inside of a wall that is drawn as two lines
MIN_DOOR_M: Final = 0.3  # a narrower opening is no door
DOOR_REACHES_M: Final = (0.05, 0.12, 0.25, 0.45, 0.7)  # from the line of a door to the floor on both sides
MIN_OVERLAP: Final = 0.5  # of the smaller outline: two outlines of a shaft on different levels
MIN_COMFORT: Final = 0.4  # of a stair that joins all levels: below it, one of them may be left out
MAX_THIN_WALL_M: Final = 0.5  # a stair without a door is opened through a wall up to this thick
MAX_VERTICES: Final = 500_000
MAX_CUTS: Final = 4  # rounds in which rings that touch are kept apart
MAX_FOUND_DOOR_M: Final = 1.3  # a wider gap between two parts of a floor is no door
MAX_FOUND_NECK_M: Final = 0.5  # nor is one that is longer: that is a corridor
ASSUMPTIONS: Final = frozenset({"height assumed", "units assumed", "treads made", "door found"})
"""Kinds of `Repair` that complete a drawing and mend nothing: strict mode allows them."""


@dataclass(slots=True)
class _Cell:
    """A part of a level before its edges are joined."""

    id: str
    shape: Any
    level: int
    kind: str = "floor"
    is_walled: bool = True  # whether its outline is a wall where no door is
    is_door: bool = False
    is_taken: bool = False  # by flights: it becomes no floor polygon of this level
    shaft: int = -1


@dataclass(slots=True)
class _Level:
    """What was drawn on a level."""

    number: int
    height_m: float
    walkable: list[_Cell] = field(default_factory=list)
    walls: list[Any] = field(default_factory=list)
    doors: list[tuple[Any, float, str]] = field(default_factory=list)


@dataclass(slots=True)
class _Connection:
    kind: str
    id: str
    outlines: dict[int, Any]
    is_walled: bool
    levels: tuple[int, ...]
    up: tuple[float, float] | None


class BuildingBuilder:
    """Collects what is drawn on each level and makes a `Building` of it.

    Every method but `build` returns the builder, so that calls can be chained. Geometry is a shapely geometry or an
    array (K, 2) of vertices in metres; a polygon may be given closed or open, either way round.

    Args:
        name: Of the building.
        strict: Raise a `MapError` for the first thing that would have to be repaired.
        wall_m: Thickness of a wall that is drawn as a line.
        door_m: Width of a door that is drawn as a point.

    >>> from shapely import box
    >>> builder = BuildingBuilder("two rooms").add_level(0)
    >>> builder = builder.add_walkable(box(0, 0, 4, 4), id="west").add_walkable(box(4, 0, 8, 4), id="east")
    >>> building = builder.add_door([(4, 1), (4, 2)]).build()
    >>> [polygon.id for polygon in building.polygons]
    ['0/west', '0/east', '0/door-0']
    """

    def __init__(self, name: str = "", *, strict: bool = False, wall_m: float = WALL_M, door_m: float = DOOR_M) -> None:
        self._name, self._strict, self._wall_m, self._door_m = name, strict, wall_m, door_m
        self._levels: dict[int, _Level] = {}
        self._connections: list[_Connection] = []
        self._zones: list[Zone] = []
        self._zone_ids: set[str] = set()
        self._repairs: list[Repair] = []
        self._current: int | None = None
        self._num_vertices = 0

    @property
    def repairs(self) -> tuple[Repair, ...]:
        """What has been mended or assumed so far."""
        return tuple(self._repairs)

    def add_level(self, level: int, *, height_m: float | None = None) -> Self:
        """Begins a level; what is added without a `level` belongs to the last one begun.

        Args:
            level: IMDF ordinal, 0 ground.
            height_m: Of its floor above level 0; `LEVEL_HEIGHT_M` a level where it is not known, which is reported.
        """
        if isinstance(level, bool) or not isinstance(level, (int, np.integer)):
            raise MapError(f"level is a whole number (0 ground); got {level!r}")
        if level in self._levels:
            raise MapError(f"level {level} is added twice")
        if height_m is None:
            height_m = level * LEVEL_HEIGHT_M
            if level:
                self._repair("height assumed", f"level {level}", f"no height is given: {height_m:g} m assumed")
        self._levels[int(level)] = _Level(int(level), float(height_m))
        self._current = int(level)
        return self

    def add_walkable(
        self,
        polygon: Any,
        level: int | None = None,
        *,
        id: str = "",
        name: str = "",
        use: str = "",
        walled: bool = True,
    ) -> Self:
        """Adds an area that people walk on; where areas overlap, the smaller one keeps the overlap.

        Args:
            polygon: Polygon, or several.
            level: None for the last level begun.
            id: Unique on its level; made up where it is empty.
            name: As on the door; an area with a name or a use becomes a zone as well.
            use: Such as "office".
            walled: Whether its outline is a wall where there is no door; False: areas of which neither has walls are
                open to each other where they meet, as an outline is out of which walls are cut.
        """
        place = self._level(level)
        id = id or f"area-{len(place.walkable)}"
        for number, shape in enumerate(self._polygons(polygon, f"level {place.number}, {id!r}", place.number)):
            own = f"{id}.{number}" if number else id
            place.walkable.append(_Cell(own, shape, place.number, is_walled=walled))
            if name or use:
                self._add_zone(own, name or id, shape, place.number, use)
        return self

    def add_wall(self, geometry: Any, level: int | None = None, *, thickness_m: float | None = None) -> Self:
        """Adds a wall, window or anything else that no one passes: a polygon, or a line with a thickness."""
        import shapely

        place = self._level(level)
        for part in self._parts(geometry, ring=False):
            if part.geom_type == "Polygon":
                place.walls += self._polygons(part, f"a wall on level {place.number}", place.number)
            elif part.geom_type in ("LineString", "LinearRing") and part.length > 0:
                half_m = (self._wall_m if thickness_m is None else thickness_m) / 2
                place.walls.append(shapely.buffer(part, half_m, cap_style="square", join_style="mitre"))
        return self

    def add_door(
        self, geometry: Any, level: int | None = None, *, width_m: float | None = None, name: str = ""
    ) -> Self:
        """Adds a door: a line from jamb to jamb, a polygon that fills the opening, or a point on a wall."""
        place = self._level(level)
        for part in self._parts(geometry, ring=False):
            if part.geom_type == "Polygon":
                for shape in self._polygons(part, f"a door on level {place.number}", place.number):
                    place.doors.append((shape, self._door_m, name))
            else:
                place.doors.append((part, width_m or self._door_m, name))
        return self

    def connect(
        self,
        kind: ConnectionKind,
        *,
        levels: Sequence[int],
        polygon: Any,
        id: str = "",
        walled: bool = False,
        up: tuple[float, float] | None = None,
    ) -> Self:
        """Adds stairs, an escalator or a lift.

        Args:
            kind: "stairs", "escalator" or "lift".
            levels: That it joins, two or more.
            polygon: Its outline on all of them, or a mapping from a level to the outline there.
            id: Unique; made up where it is empty.
            walled: Whether its outline is a wall where there is no door.
            up: Direction (x, y) in which it leads up in one straight flight; None where the drawing leaves that open.
        """
        if kind not in CONNECTION_KINDS:
            raise unknown_name("kind of connection", kind, CONNECTION_KINDS)
        joined = tuple(sorted({int(level) for level in levels}))
        id = id or f"{kind}-{len(self._connections)}"
        if len(joined) < 2:
            raise MapError(f"{id!r} joins {list(levels)}; give two levels or more")
        outlines = {}
        for level in joined:
            place = self._level(level)
            drawn = polygon.get(level) if isinstance(polygon, Mapping) else polygon
            shapes = [] if drawn is None else self._polygons(drawn, f"level {place.number}, {id!r}", place.number)
            if not shapes:
                raise MapError(f"{id!r} has no outline on level {level}; give one for each level that it joins")
            outlines[level] = max(shapes, key=lambda shape: shape.area)
        self._connections.append(_Connection(kind, id, outlines, walled, joined, up))
        return self

    def add_zone(self, polygon: Any, level: int | None = None, *, name: str, use: str = "") -> Self:
        """Names an area for pictures; walking ignores it."""
        place = self._level(level)
        for shape in self._polygons(polygon, f"level {place.number}, zone {name!r}", place.number):
            self._add_zone(name, name, shape, place.number, use)
        return self

    def note(self, kind: str, what: str, level: int | None = None) -> Self:
        """Reports something that was mended before the builder was given it."""
        self._repair(kind, "level" if level is None else f"level {level}", what, level=level)
        return self

    def build(self) -> Building:
        """The building.

        Raises:
            MapError: Nothing can be walked on; or, in strict mode, something would have to be repaired.
        """
        if self._num_vertices > MAX_VERTICES:
            raise MapError(f"{self._num_vertices} vertices; simplify the drawing to {MAX_VERTICES} or fewer")
        shafts = self._shafts()
        by_level = {number: self._cells(level, shafts) for number, level in sorted(self._levels.items())}
        layouts = {k: self._lay_out(k, shaft, by_level) for k, shaft in enumerate(shafts) if shaft.kind != "lift"}
        joined = _Joined()
        for number, cells in by_level.items():
            self._place_parts(cells, shafts, layouts)
            joined.add(self._clean(cells, number), self._levels[number].height_m)
        for k, layout in layouts.items():
            if layout is not None:
                self._add_flights(joined, k, shafts[k], layout)
        if not joined.polygons:
            raise MapError(f"building {self._name!r}: nothing to walk on; add_walkable() the floor of each level")
        zones = [zone for zone in self._zones if zone.level in self._levels]
        return Building(self._name, joined.floor_polygons(), tuple(zones))

    # What is drawn.

    def _level(self, level: int | None) -> _Level:
        number = self._current if level is None else level
        if number is None:
            raise MapError("no level yet; begin with add_level(0)")
        if number not in self._levels:
            self.add_level(number)
        return self._levels[number]

    def _repair(
        self, kind: str, where: str, what: str, place: Sequence[float] | None = None, level: int | None = None
    ) -> None:
        repair = Repair(kind, where, what, None if place is None else (float(place[0]), float(place[1])), level)
        if self._strict and kind not in ASSUMPTIONS:
            raise MapError(f"{where}: {what} ({kind}); mend the drawing, or read it without strict")
        self._repairs.append(repair)

    def _parts(self, geometry: Any, *, ring: bool = True) -> list[Any]:
        """Simple parts of a geometry in the plane."""
        import shapely

        if not isinstance(geometry, shapely.Geometry):
            try:
                points = np.asarray(geometry, dtype=np.float64)
            except (TypeError, ValueError):
                raise MapError(
                    f"expected a shapely geometry or vertices (K, 2); got {type(geometry).__name__}"
                ) from None
            if points.ndim != 2 or points.shape[1] != 2 or not len(points):
                raise MapError(f"expected a shapely geometry or vertices (K, 2); got shape {points.shape}")
            if ring and len(points) < 3:
                raise MapError(f"an area needs three vertices; got {len(points)}")
            if not np.isfinite(points).all():
                raise MapError("a vertex is not finite; give metres")
            make = shapely.Polygon if ring else shapely.Point if len(points) == 1 else shapely.LineString
            geometry = make(points)
        if not np.isfinite(shapely.get_coordinates(geometry)).all():
            raise MapError("a vertex is not finite; give metres")
        self._num_vertices += int(shapely.get_num_coordinates(geometry))
        flat = shapely.force_2d(geometry)
        parts = [flat]
        while any(part.geom_type.startswith(("Multi", "Geometry")) for part in parts):
            parts = list(shapely.get_parts(parts))
        return parts

    def _polygons(self, geometry: Any, where: str, level: int) -> list[Any]:
        """Valid polygons of a geometry."""
        import shapely

        found = []
        for part in self._parts(geometry):
            if part.is_empty:
                self._repair("empty", where, "an empty geometry was left out", level=level)
                continue
            if part.geom_type != "Polygon":
                raise MapError(f"{where}: expected a polygon, got a {part.geom_type}; close it to a ring")
            if not part.is_valid:
                reason = shapely.is_valid_reason(part)
                middle = shapely.get_coordinates(part).mean(axis=0)
                self._repair("self-intersection", where, f"{reason}: mended", middle, level)
                part = shapely.make_valid(part, method="structure", keep_collapsed=False)
            for piece in shapely.get_parts(part):
                if piece.geom_type != "Polygon":
                    continue
                if 2 * piece.area < 1e-3 * piece.length:
                    place = shapely.get_coordinates(piece)[0] if not piece.is_empty else None
                    self._repair("sliver", where, f"{piece.area:.2g} m² of {piece.length:.2g} m left out", place, level)
                    continue
                found.append(shapely.remove_repeated_points(piece, 1e-6))
        return found

    def _add_zone(self, id: str, name: str, shape: Any, level: int, use: str) -> None:
        import shapely

        own = _unique(f"{level}/{id}", self._zone_ids)
        ring = shapely.get_coordinates(shapely.remove_repeated_points(shape, 1e-6).exterior)[:-1]
        self._zones.append(Zone(own, name, ring, level, use))

    # Shafts: stairs and lifts above one another.

    def _shafts(self) -> list[_Connection]:
        """Connections, those with a common outline on a common level made one."""
        import shapely

        shafts: list[_Connection] = []
        for one in sorted(self._connections, key=lambda connection: connection.levels):
            for k, other in enumerate(shafts):
                common = set(one.levels) & set(other.levels)
                if one.kind == other.kind and common and all(
                    shapely.intersection(one.outlines[level], other.outlines[level]).area
                    > MIN_OVERLAP * min(one.outlines[level].area, other.outlines[level].area)
                    for level in common
                ):  # fmt: skip
                    outlines = one.outlines | other.outlines
                    shafts[k] = replace(other, outlines=outlines, levels=tuple(sorted(outlines)))
                    break
            else:
                shafts.append(one)
        return shafts

    def _lay_out(self, k: int, shaft: _Connection, by_level: Mapping[int, list[_Cell]]) -> StairLayout | None:
        """Where the treads of a stair lie; None, with a repair, where there is no room for them."""
        import shapely

        core = shapely.intersection_all([shaft.outlines[level] for level in shaft.levels])
        parts = [part for part in shapely.get_parts(core) if part.geom_type == "Polygon"]
        core = max(parts, key=shapely.area, default=shapely.Polygon())
        middle = shapely.get_coordinates(shaft.outlines[shaft.levels[0]].centroid)[0]
        smallest = min(outline.area for outline in shaft.outlines.values())
        where = f"{shaft.kind} {shaft.id!r}, levels {', '.join(map(str, shaft.levels))}"
        if core.area < MIN_OVERLAP * smallest:
            what = f"its outlines on these levels share {core.area:.1f} of {smallest:.1f} m²: left as floor, not joined"
            self._repair("stairs not joined", where, what, middle, shaft.levels[0])
            return None
        accesses = [self._access(k, by_level[level]) for level in shaft.levels]
        heights_m = [self._levels[level].height_m for level in shaft.levels]
        tidy = shapely.simplify(core.buffer(-GAP_M, join_style="mitre").buffer(GAP_M, join_style="mitre"), 0.004)
        if shaft.kind == "escalator" or shaft.up is not None:
            layout = lay_out(tidy, accesses, heights_m, straight_only=True, up=shaft.up)
        else:
            layout = lay_out(tidy, accesses, heights_m)
            while (layout is None or layout.comfort < MIN_COMFORT) and len(shaft.levels) > 2:
                # The way in of the lowest or highest level lies at another end than those of the others.
                ends = [(slice(1, None), shaft.levels[0]), (slice(None, -1), shaft.levels[-1])]
                tried = [(lay_out(tidy, accesses[part], heights_m[part]), part, level) for part, level in ends]
                best, part, level = max(tried, key=lambda one: 0.0 if one[0] is None else one[0].comfort)
                if best is None or best.comfort < MIN_COMFORT:
                    break
                self._repair("level not joined", where, f"no good stair reaches level {level} as well", middle, level)
                layout, accesses, heights_m = best, accesses[part], heights_m[part]
                shaft.levels = shaft.levels[part]
                where = f"{shaft.kind} {shaft.id!r}, levels {', '.join(map(str, shaft.levels))}"
        if layout is None:
            what = "no room for treads between the ways in: left as floor, not joined"
            self._repair("stairs not joined", where, what, middle, shaft.levels[0])
        else:
            risers = ", ".join(
                f"{abs(rise) / count:.2f}" for rise, count in zip(np.diff(heights_m), layout.num_risers, strict=True)
            )
            shape = layout.form.replace("_", " ") + (", turning" if layout.frame.radius_m else "")
            what = f"drawn as an outline: treads laid out ({shape}, {layout.tread_m:.2f} m deep, {risers} m high)"
            self._repair("treads made", where, what, middle, shaft.levels[0])
        return layout

    @staticmethod
    def _access(k: int, cells: Sequence[_Cell]) -> Any:
        """Lines where the outline of a shaft is open to the floor of a level."""
        import shapely

        own = [cell for cell in cells if cell.shaft == k]
        others = [
            cell.shape
            for cell in cells
            if cell.shaft != k and (cell.is_door or not (cell.is_walled or any(c.is_walled for c in own)))
        ]
        if not own or not others:
            return shapely.LineString()
        near = shapely.union_all(others).buffer(GAP_M)
        return shapely.intersection(shapely.union_all([cell.shape for cell in own]).boundary, near)

    def _place_parts(
        self, cells: list[_Cell], shafts: Sequence[_Connection], layouts: Mapping[int, StairLayout | None]
    ) -> None:
        """Puts landings, and what flights take, in the place of the outlines of stairs."""
        import shapely

        for cell in [cell for cell in cells if cell.shaft >= 0]:
            layout = layouts.get(cell.shaft)
            if layout is None:
                continue
            cells.remove(cell)
            levels = shafts[cell.shaft].levels
            if cell.level not in levels:
                cells.append(cell)
                continue
            leaves, arrives = cell.level < levels[-1], cell.level > levels[0]
            for name, part in parts_on_level(layout, cell.shape, leaves=leaves, arrives=arrives).items():
                is_taken = name in ("up", "down")
                for piece in _large_parts(shapely.intersection(part, cell.shape), 0.05):
                    cells.append(replace(cell, id=f"{cell.id} {name}", shape=piece, is_taken=is_taken, kind="floor"))

    def _add_flights(self, joined: _Joined, k: int, shaft: _Connection, layout: StairLayout) -> None:
        """Adds the treads between each two levels and joins them to their landings."""
        for number, (lower, upper) in enumerate(zip(shaft.levels, shaft.levels[1:], strict=False)):
            heights_m = (self._levels[lower].height_m, self._levels[upper].height_m)
            arrival = "down" if layout.form == "half_turn" or upper == shaft.levels[-1] else "up"
            target = layout.far_m if layout.form == "straight" else layout.near_m
            below = joined.edge_to_flight(k, lower, "up", layout, layout.near_m)
            above = joined.edge_to_flight(k, upper, arrival, layout, target)
            if below is None or above is None:
                level = lower if below is None else upper
                what = f"no landing is left on level {level}: not joined"
                middle = layout.frame.to_xy(np.array([layout.core.centroid.coords[0]]))[0]
                self._repair("stairs not joined", f"{shaft.kind} {shaft.id!r}", what, middle, level)
                continue
            joined.add_flight(f"{shaft.id}", (lower, upper), layout, number, heights_m, below, above)

    # One level.

    def _cells(self, level: _Level, shafts: Sequence[_Connection]) -> list[_Cell]:
        """Areas, outlines of shafts and doors of a level, apart from one another."""
        import shapely

        number = level.number
        first = [
            _Cell(f"{shaft.id}", shaft.outlines[number], number, "lift" if shaft.kind == "lift" else "floor",
                  shaft.is_walled, shaft=k)
            for k, shaft in enumerate(shafts) if number in shaft.outlines
        ]  # fmt: skip
        cells = [*first, *sorted(level.walkable, key=lambda cell: cell.shape.area)]
        cells = _apart(cells)
        walls = shapely.union_all(level.walls) if level.walls else shapely.Polygon()
        if level.walls:
            shapely.prepare(walls)
            for cell in cells:
                if shapely.intersects(walls, cell.shape):
                    cell.shape = shapely.difference(cell.shape, walls)
        cells = self._split(cells, number)
        if not level.doors:
            for cell in cells:
                if cell.shaft < 0 and not cell.is_walled:
                    for line in _gaps(cell.shape):
                        level.doors.append((line, self._door_m, ""))
                        what = f"a gap of {line.length:.2f} m in the walls is taken for a door"
                        place = shapely.get_coordinates(line.centroid)[0]
                        self._repair("door found", f"level {number}", what, place, number)
        doors = self._doors(level, cells, walls)
        if doors:
            taken = shapely.union_all([door.shape for door in doors])
            for cell in cells:
                if shapely.intersects(taken, cell.shape):
                    cell.shape = shapely.difference(cell.shape, taken)
            cells = self._split(cells, number)
        cells = [*cells, *doors]
        self._open_shafts(cells, shafts, number)
        order = {cell.id: i for i, cell in enumerate(level.walkable)}
        return sorted(cells, key=lambda cell: (cell.is_door, order.get(cell.id.partition("~")[0], len(order))))

    def _split(self, cells: Sequence[_Cell], number: int) -> list[_Cell]:
        """Each connected part a cell of its own, without necks too narrow to pass."""
        import shapely

        found = []
        for cell in cells:
            shape = cell.shape
            inner = shape.buffer(-GAP_M, join_style="mitre", mitre_limit=3.0)
            opened = inner.buffer(GAP_M, join_style="mitre", mitre_limit=3.0)
            if len(_large_parts(opened, 0.0)) != len(_large_parts(shape, 0.0)) or len(_touching(shape)):
                # A little less than it was: parts that touch at a point would touch again.
                shape = inner.buffer(GAP_M - 0.002, join_style="mitre", mitre_limit=3.0)
                shape = shapely.intersection(shape, cell.shape)
            parts = sorted(_large_parts(shape, 0.0), key=lambda part: -part.area)
            kept = [part for part in parts if part.area >= MIN_PART_M2 and not part.buffer(-MIN_WIDTH_M / 2).is_empty]
            if cell.shaft >= 0:
                kept = kept or parts[:1]
            for part in parts:
                if part.area > 1e-3 and part not in kept:
                    where = f"level {number}, {cell.id!r}"
                    place = shapely.get_coordinates(part)[0]
                    self._repair("small part", where, f"{part.area:.2g} m² left out", place, number)
            for k, part in enumerate(kept):
                found.append(replace(cell, id=f"{cell.id}~{k}" if k else cell.id, shape=part))
        return found

    def _doors(self, level: _Level, cells: Sequence[_Cell], walls: Any) -> list[_Cell]:
        """A cell for every door that leads from one area to another, or through a wall within one."""
        import shapely

        tree = shapely.STRtree([cell.shape for cell in cells])
        doors: list[_Cell] = []
        for geometry, width_m, name in level.doors:
            shape = (
                _door_in_polygon(geometry, cells, tree, walls)
                if geometry.geom_type == "Polygon"
                else _door_on_line(geometry, width_m, cells, tree)
            )
            where = f"level {level.number}, door {name or len(doors)!r}"
            place = shapely.get_coordinates(geometry.centroid)[0]
            if shape is None:
                what = "leads from no area to another: left out"
                self._repair("door left out", where, what, place, level.number)
                continue
            doors.append(_Cell(f"door-{len(doors)}", shape, level.number, is_walled=False, is_door=True))
        for i, door in enumerate(doors):  # leaves of a double door may overlap
            for other in doors[:i]:
                if shapely.intersects(door.shape, other.shape):
                    door.shape = shapely.difference(door.shape, other.shape)
        kept = []
        for door in doors:
            parts = _large_parts(door.shape, 1e-3)
            if parts:
                kept.append(replace(door, shape=max(parts, key=shapely.area)))
        return kept

    def _open_shafts(self, cells: list[_Cell], shafts: Sequence[_Connection], number: int) -> None:
        """Gives a stair or lift without any way in on this level a doorway through the thinnest wall beside it."""
        import shapely

        for k, shaft in enumerate(shafts):
            own = [cell for cell in cells if cell.shaft == k]
            if not own or self._access(k, cells).length >= MIN_DOOR_M:
                continue
            shape = max((cell.shape for cell in own), key=shapely.area)
            where, place = f"level {number}, {shaft.kind} {shaft.id!r}", shapely.get_coordinates(shape.centroid)[0]
            others = [cell for cell in cells if cell.shaft != k]
            doorway = _doorway(shape, [cell.shape for cell in others], self._door_m)
            if doorway is None:
                self._repair("no way in", where, "no door and no floor beside it: cannot be reached", place, number)
                continue
            what = f"no door leads to it: opened a doorway of {self._door_m:g} m through the thinnest wall"
            self._repair("doorway made", where, what, shapely.get_coordinates(doorway.centroid)[0], number)
            for cell in cells:
                if shapely.intersects(doorway, cell.shape):
                    parts = _large_parts(shapely.difference(cell.shape, doorway), 0.0)
                    cell.shape = max(parts, key=shapely.area)
            cells.append(_Cell(f"doorway-{shaft.id}", doorway, number, is_walled=False, is_door=True))

    def _clean(self, cells: Sequence[_Cell], number: int) -> list[_Cell]:
        """The same cells with the same vertices on both sides of every common edge."""
        import shapely

        if not cells:
            return []
        shapes = np.array([cell.shape for cell in cells])
        cleaned = shapely.coverage_clean(shapes, gap_width=GAP_M, snapping_distance=SNAP_M)
        self._report_moves(shapes, cleaned, number)
        for _ in range(MAX_CUTS):
            cleaned = shapely.coverage_simplify(cleaned, STRAIGHT_M)
            touching = {k: _touching(shape) for k, shape in enumerate(cleaned)}
            touching = {k: places for k, places in touching.items() if len(places)}
            if not touching:
                break
            # Where rings touch at a point there is no way through; a small piece of wall keeps them apart.
            for k, places in touching.items():
                cleaned[k] = shapely.difference(cleaned[k], shapely.multipoints(places).buffer(GAP_M, quad_segs=1))
            cleaned = shapely.coverage_clean(cleaned, gap_width=0.0, snapping_distance=SNAP_M)
        found = []
        for cell, shape in zip(cells, cleaned, strict=True):
            for k, part in enumerate(sorted(_large_parts(shape, 1e-3), key=lambda part: -part.area)):
                if 2 * part.area < 2e-3 * part.length:
                    continue
                found.append(replace(cell, id=f"{cell.id}^{k}" if k else cell.id, shape=shapely.orient_polygons(part)))
        return found

    def _report_moves(self, before: Any, after: Any, number: int) -> None:
        """Reports edges that were almost the same and are the same now."""
        import shapely
        from scipy.spatial import KDTree

        old, new = shapely.get_coordinates(before), shapely.get_coordinates(after)
        if not len(new):
            return
        off_m = np.asarray(KDTree(new).query(old)[0])
        moved = off_m > 1e-6
        if moved.any():
            what = f"{int(moved.sum())} vertices joined with others up to {off_m[moved].max() * 1e3:.1f} mm away"
            self._repair("edges joined", f"level {number}", what, old[off_m.argmax()], number)


def _large_parts(shape: Any, min_m2: float) -> list[Any]:
    """Polygons of a geometry that are larger than so much."""
    import shapely

    parts = shapely.get_parts(shape)
    while len(parts) and any(part.geom_type.startswith(("Multi", "Geometry")) for part in parts):
        parts = shapely.get_parts(parts)
    return [part for part in parts if part.geom_type == "Polygon" and part.area > min_m2]


def _touching(shape: Any) -> FloatArray:
    """(N, 2) vertices that occur twice: rings that touch cannot be cut into convex cells."""
    import shapely

    found = [np.zeros((0, 2))]
    for part in _large_parts(shape, 0.0):
        rings = [shapely.get_coordinates(ring)[:-1] for ring in (part.exterior, *part.interiors)]
        points, count = np.unique(np.concatenate(rings), axis=0, return_counts=True)
        found.append(points[count > 1])
    return np.concatenate(found)


def _apart(cells: Sequence[_Cell]) -> list[_Cell]:
    """Cells without the area of those before them."""
    import shapely

    tree = shapely.STRtree([cell.shape for cell in cells])
    found = []
    for i, cell in enumerate(cells):
        before = [int(j) for j in tree.query(cell.shape, predicate="intersects") if j < i]
        shape = cell.shape
        if before:
            shape = shapely.difference(shape, shapely.union_all([cells[j].shape for j in before]))
        found.append(replace(cell, shape=shape))
    return found


def _gaps(shape: Any) -> list[Any]:
    """Lines from jamb to jamb across the gaps of a floor that are as narrow and as short as a door.

    Rooms are what a disc wider than a door can sweep; a gap is where two of them meet or almost meet.
    """
    import shapely

    half_m = MAX_FOUND_DOOR_M / 2
    cores = _large_parts(shape.buffer(-half_m), 0.0)
    rooms = [core.buffer(half_m) for core in cores]
    found: list[Any] = []
    if len(rooms) < 2:
        return found
    for i, j in shapely.STRtree(rooms).query(rooms, predicate="dwithin", distance=MAX_FOUND_NECK_M).T:
        if i >= j:
            continue
        meeting = _large_parts(shapely.intersection(rooms[i], rooms[j]), 1e-6)
        for part in meeting or [shapely.shortest_line(rooms[i], rooms[j])]:
            line = _across(part.centroid, cores[i], cores[j], shape)
            if line is not None:
                found.append(line)
    return found


def _across(middle: Any, one: Any, other: Any, shape: Any) -> Any:
    """The line through a place, across the way from one part of a floor to another, from wall to wall; or None."""
    import shapely

    ways = [shapely.get_coordinates(shapely.shortest_line(part, middle))[0] for part in (one, other)]
    along = ways[1] - ways[0]
    length_m = float(np.hypot(*along))
    if not length_m or not shape.covers(shapely.LineString([ways[0], shapely.get_coordinates(middle)[0], ways[1]])):
        return None
    across = np.array([-along[1], along[0]]) / length_m * MAX_FOUND_DOOR_M
    place = shapely.get_coordinates(middle)[0]
    pieces = shapely.get_parts(shapely.intersection(shape, shapely.LineString([place - across, place + across])))
    line = min(pieces, key=lambda piece: shapely.distance(piece, middle))
    if not MIN_DOOR_M <= line.length <= MAX_FOUND_DOOR_M:
        return None
    ends = shapely.get_coordinates(line)[[0, -1]]
    beyond = 0.01 * (ends[1] - ends[0]) / line.length  # into the jambs, so that no slit is left beside it
    return shapely.LineString([ends[0] - beyond, ends[1] + beyond])


def _door_in_polygon(shape: Any, cells: Sequence[_Cell], tree: Any, walls: Any) -> Any:
    """The part of a door's polygon that is no wall, or all of it where that touches less floor; None without floor."""
    import shapely

    free = shapely.difference(shape, walls)
    parts = _large_parts(free, 0.02)
    if parts and sum(part.area for part in parts) > 0.5 * shape.area:
        return max(parts, key=shapely.area)
    near = [cells[int(i)].shape for i in tree.query(shape.buffer(0.05))]
    touched = sum(shapely.intersection(shape.buffer(0.05), other).area > 0.005 for other in near)
    return shape if touched else None


def _door_on_line(geometry: Any, width_m: float, cells: Sequence[_Cell], tree: Any) -> Any:
    """A rectangle about the line of a door, deep enough to reach the floor on both sides; None where there is none."""
    import shapely

    if geometry.geom_type == "Point":
        geometry = _line_through(geometry, width_m, cells, tree)
        if geometry is None:
            return None
    ends = shapely.get_coordinates(geometry)[[0, -1]]
    along = ends[1] - ends[0]
    length_m = float(np.hypot(*along))
    if length_m < MIN_DOOR_M:
        return None
    normal = np.array([-along[1], along[0]]) / length_m
    for reach_m in DOOR_REACHES_M:
        left, right = (_strip(ends, sign * reach_m * normal) for sign in (1.0, -1.0))
        if all(_floor_at_end(ends, sign * reach_m * normal, cells, tree) for sign in (1.0, -1.0)):
            return shapely.union(left, right)
    return None


def _strip(ends: FloatArray, across: FloatArray) -> Any:
    import shapely

    return shapely.Polygon([ends[0], ends[1], ends[1] + across, ends[0] + across])


def _floor_at_end(ends: FloatArray, across: FloatArray, cells: Sequence[_Cell], tree: Any) -> bool:
    """Whether there is floor along most of the far side of a strip."""
    import shapely

    far = shapely.LineString(
        [ends[0] + across + 0.1 * (ends[1] - ends[0]), ends[1] + across - 0.1 * (ends[1] - ends[0])]
    )
    near = [cells[int(i)].shape for i in tree.query(far)]
    covered = sum(shapely.intersection(far, shape).length for shape in near)
    return bool(covered > 0.6 * far.length)


def _line_through(point: Any, width_m: float, cells: Sequence[_Cell], tree: Any) -> Any:
    """The line of a door at a point: along the nearest wall, moved off its corners."""
    import shapely

    near = [cells[int(i)] for i in tree.query(point.buffer(DOOR_REACHES_M[-1]))]
    best: tuple[float, float, FloatArray, FloatArray] | None = None
    place = shapely.get_coordinates(point)[0]
    for cell in near:
        for ring in (cell.shape.exterior, *cell.shape.interiors):
            points = shapely.get_coordinates(shapely.simplify(ring, 0.01))
            a, along = points[:-1], np.diff(points, axis=0)
            length = np.maximum(np.hypot(*along.T), 1e-9)
            t = np.clip(((place - a) * along).sum(axis=1) / length**2, 0.0, 1.0)
            off_m = np.hypot(*(a + t[:, None] * along - place).T)
            close = np.flatnonzero(off_m <= min(off_m.min() + 0.05, DOOR_REACHES_M[-1]))
            for k in close:
                key = (round(float(off_m[k]) / 0.1), -float(length[k]))
                if best is None or key < best[:2]:
                    best = (*key, a[k], a[k] + along[k])
    if best is None:
        return None
    a, b = best[2:]
    length_m = float(np.hypot(*(b - a)))
    unit = (b - a) / length_m
    half_m = min(width_m, length_m) / 2
    middle_m = float(np.clip((place - a) @ unit, half_m, length_m - half_m))
    return shapely.LineString([a + (middle_m - half_m) * unit, a + (middle_m + half_m) * unit])


def _doorway(shape: Any, others: Sequence[Any], width_m: float) -> Any:
    """A rectangle from an outline through the thinnest wall to the floor behind it; None where no floor is near."""
    import shapely

    if not others:
        return None
    tree = shapely.STRtree(others)
    best: tuple[float, Any] | None = None
    points = shapely.get_coordinates(shape.exterior)
    for a, b in itertools.pairwise(points):
        length_m = float(np.hypot(*(b - a)))
        if length_m < width_m:
            continue
        unit = (b - a) / length_m
        for middle_m in np.linspace(width_m / 2, length_m - width_m / 2, max(1, int(length_m / 0.4))):
            ends = np.array([a + (middle_m - width_m / 2) * unit, a + (middle_m + width_m / 2) * unit])
            for sign in (1.0, -1.0):
                across = sign * np.array([-unit[1], unit[0]])
                if shapely.Polygon(shape).contains(shapely.Point(*(ends.mean(axis=0) + 0.05 * across))):
                    continue
                ray = shapely.LineString([ends.mean(axis=0), ends.mean(axis=0) + MAX_THIN_WALL_M * across])
                hits = [shapely.intersection(ray, others[int(i)]) for i in tree.query(ray, predicate="intersects")]
                gap_m = min(
                    (shapely.distance(shapely.Point(*ends.mean(axis=0)), hit) for hit in hits), default=math.inf
                )
                if best is not None and gap_m >= best[0] - 1e-3:
                    continue
                strip = _strip(ends - 0.05 * across, (gap_m + 0.1) * across) if math.isfinite(gap_m) else None
                if strip is None:
                    continue
                far = shapely.LineString(ends + (gap_m + 0.04) * across)
                if sum(shapely.intersection(far, others[int(i)]).length for i in tree.query(far)) > 0.8 * width_m:
                    best = (float(gap_m), shapely.orient_polygons(strip))
    return None if best is None else best[1]


class _Joined:
    """Floor polygons of a building while they are joined: rings, and what lies across each of their edges."""

    def __init__(self) -> None:
        self.polygons: list[tuple[str, list[FloatArray], list[int], float, int, str]] = []
        self._to_flights: dict[tuple[int, int, str], list[tuple[int, int, FloatArray, FloatArray]]] = {}
        self._ids: set[str] = set()

    def add(self, cells: Sequence[_Cell], height_m: float) -> None:
        """Adds the cells of a level, open to one another where the edges that they share are no wall."""
        import shapely

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
                elif _is_open(cell, cells[other]):
                    neighbours[-1] = index[other]
            id = _unique(f"{cell.level}/{cell.id}", self._ids)
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
    ) -> None:
        """Adds treads and joins them to one another and to both landings."""
        treads = flight_of(layout, number, heights_m, below[2], above[2])
        first = len(self.polygons)
        for k, tread in enumerate(treads):
            neighbours = [WALL] * len(tread.ring_xy_m)
            neighbours[tread.before] = first + k - 1 if k else below[0]
            neighbours[tread.after] = first + k + 1 if k < len(treads) - 1 else above[0]
            level = levels[1] if tread.is_upper else levels[0]
            id = _unique(f"{levels[0]}/{name} up to {levels[1]} {k + 1:02d}", self._ids)
            self.polygons.append((id, [tread.ring_xy_m], neighbours, tread.height_m, level, "stairs"))
        self.polygons[below[0]][2][below[1]] = first
        self.polygons[above[0]][2][above[1]] = first + len(treads) - 1

    def floor_polygons(self) -> tuple[FloorPolygon, ...]:
        """All of them."""
        return tuple(
            FloorPolygon(id, rings[0], np.array(neighbours), height_m, level, kind, tuple(rings[1:]))
            for id, rings, neighbours, height_m, level, kind in self.polygons
        )


def _unique(id: str, taken: set[str]) -> str:
    """The id, or with a number behind it where it is taken; taken from now on."""
    own = id
    for number in itertools.count(2):
        if own not in taken:
            break
        own = f"{id}#{number}"
    taken.add(own)
    return own


def _edges_of(rings: Iterable[FloatArray]) -> Iterable[tuple[tuple[float, ...], tuple[float, ...]]]:
    """First and second vertex of every edge, ring by ring."""
    for ring in rings:
        points = [tuple(point) for point in ring.tolist()]
        yield from zip(points, [*points[1:], points[0]], strict=True)


def _is_open(one: _Cell, other: _Cell) -> bool:
    """Whether people pass the edge between two cells."""
    return one.is_door or other.is_door or (one.shaft == other.shaft != -1) or not (one.is_walled or other.is_walled)


def finished(
    builder: BuildingBuilder, source: str, geo: GeoFrame | None = None, skipped: Mapping[str, int] | None = None
) -> Plan:
    """The plan of a builder that has been given everything."""
    building = builder.build()
    return Plan(building, geo, builder.repairs, source, dict(skipped or {}), suspicions(building))
