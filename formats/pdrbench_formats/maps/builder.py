"""Buildings from drawings: outlines, walls, doors, stairs and lifts become floor polygons joined along their edges.

A level is a set of areas that one can walk on. Walls are taken out of them, or, where areas meet without one, lie on
the line between them. A door is a floor polygon of its own, as deep as the wall that it passes. A stair becomes
landings and treads. What had to be mended in the drawing is listed as `Repair`; in strict mode the first is an error.

`assembly/` holds the steps in the order in which `BuildingBuilder.build` takes them: `shafts` (outlines of stairs and
lifts above one another), `cells` (areas of a level without walls, with `doors`), `flights` (treads), `joining`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final, Self

import numpy as np
import shapely

from pdrbench.building.building import Building
from pdrbench.building.polygons import Zone
from pdrbench.errors import MapError, unknown_name
from pdrbench.io.geo import GeoFrame
from pdrbench_formats.maps.assembly.cells import cells_of, clean
from pdrbench_formats.maps.assembly.drawing import Cell, Connection, ConnectionKind, DrawnLevel, RepairLog
from pdrbench_formats.maps.assembly.joining import JoinedPolygons, add_flights
from pdrbench_formats.maps.assembly.shafts import lay_out_shaft, place_parts, shafts_of
from pdrbench_formats.maps.assembly.shapes import simple_parts, thickened, unique_id, valid_polygons
from pdrbench_formats.maps.plan import Plan, Repair, suspicions

CONNECTION_KINDS: Final = ("stairs", "escalator", "lift")
LEVEL_HEIGHT_M: Final = 3.5  # assumed between levels where a drawing has no heights; common in offices
WALL_M: Final = 0.1  # thickness of a wall that is drawn as a line
DOOR_M: Final = 0.9  # width of a door that is drawn as a point
MAX_VERTICES: Final = 500_000
MAX_SIZE_M: Final = 1e5  # of a shape, and above the ground: no building is so large or high, whatever its unit is


class BuildingBuilder:
    """Collects what is drawn on each level and makes a `Building` of it.

    Every method but `build` returns the builder, so that calls can be chained. Geometry is a shapely geometry or an
    array (K, 2) of vertices in metres; a polygon may be given closed or open, either way round.

    Args:
        name: Of the building.
        strict: Raise a `MapError` for the first thing that would have to be repaired.

    >>> from shapely import box
    >>> builder = BuildingBuilder("two rooms").add_level(0)
    >>> builder = builder.add_walkable(box(0, 0, 4, 4), id="west").add_walkable(box(4, 0, 8, 4), id="east")
    >>> building = builder.add_door([(4, 1), (4, 2)]).build()
    >>> [polygon.id for polygon in building.polygons]
    ['0/west', '0/east', '0/door-0']
    """

    def __init__(self, name: str = "", *, strict: bool = False) -> None:
        self.name = name
        self._levels: dict[int, DrawnLevel] = {}
        self._connections: list[Connection] = []
        self._zones: list[Zone] = []
        self._zone_ids: set[str] = set()
        self._repairs = RepairLog(strict=strict)
        self._current: int | None = None
        self._num_vertices = 0

    @property
    def repairs(self) -> tuple[Repair, ...]:
        """What has been mended or assumed so far."""
        return tuple(self._repairs.entries)

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
                self._repairs.add("height assumed", f"level {level}", f"no height is given: {height_m:g} m assumed")
        if not abs(height_m) <= MAX_SIZE_M:
            raise MapError(f"level {level}: a floor {height_m:g} m above the ground; heights are in metres")
        self._levels[int(level)] = DrawnLevel(int(level), float(height_m))
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
            place.walkable.append(Cell(own, shape, place.number, is_walled=walled))
            if name or use:
                self._add_zone(own, name or id, shape, place.number, use)
        return self

    def add_wall(self, geometry: Any, level: int | None = None, *, thickness_m: float | None = None) -> Self:
        """Adds a wall, window or anything else that no one passes: a polygon, or a line with a thickness."""
        place = self._level(level)
        for part in self._parts(geometry, ring=False):
            if part.geom_type == "Polygon":
                place.walls += self._polygons(part, f"a wall on level {place.number}", place.number)
            elif part.geom_type in ("LineString", "LinearRing") and part.length > 0:
                half_m = (WALL_M if thickness_m is None else thickness_m) / 2
                place.walls.append(thickened(part, half_m, "square"))
        return self

    def add_door(
        self, geometry: Any, level: int | None = None, *, width_m: float | None = None, name: str = ""
    ) -> Self:
        """Adds a door: a line from jamb to jamb, a polygon that fills the opening, or a point on a wall."""
        place = self._level(level)
        for part in self._parts(geometry, ring=False):
            if part.geom_type == "Polygon":
                for shape in self._polygons(part, f"a door on level {place.number}", place.number):
                    place.doors.append((shape, DOOR_M, name))
            else:
                place.doors.append((part, width_m or DOOR_M, name))
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
        self._connections.append(Connection(kind, id, outlines, walled, joined, up))
        return self

    def add_zone(self, polygon: Any, level: int | None = None, *, name: str, use: str = "") -> Self:
        """Names an area for pictures; walking ignores it."""
        place = self._level(level)
        for shape in self._polygons(polygon, f"level {place.number}, zone {name!r}", place.number):
            self._add_zone(name, name, shape, place.number, use)
        return self

    def note_half_level(self, id: str, what: str, shape: Any, level: object) -> Self:
        """Reports something that was left out, since its level is no whole one that has floor."""
        where = f"of {shape.area:.1f} m² on level {level}, which is no whole level that has floor"
        return self.note("level left out", f"{id}: {what} {where}: left out")

    def note_geometry(self, what: str) -> Self:
        """Reports geometry that was mended before the builder was given it."""
        return self.note("geometry", what)

    def note(self, kind: str, what: str, level: int | None = None) -> Self:
        """Reports something that was mended before the builder was given it."""
        self._repairs.add(kind, "plan" if level is None else f"level {level}", what, level=level)
        return self

    def build(self) -> Building:
        """The building.

        Raises:
            MapError: Nothing can be walked on; or, in strict mode, something would have to be repaired.
        """
        if self._num_vertices > MAX_VERTICES:
            raise MapError(f"{self._num_vertices} vertices; simplify the drawing to {MAX_VERTICES} or fewer")
        repairs, height_m = self._repairs, {number: level.height_m for number, level in self._levels.items()}
        shafts = shafts_of(self._connections)
        by_level = {number: cells_of(level, shafts, DOOR_M, repairs) for number, level in sorted(self._levels.items())}
        layouts = {
            k: layout
            for k, shaft in enumerate(shafts)
            if shaft.kind != "lift" and (layout := lay_out_shaft(k, shaft, by_level, height_m, repairs)) is not None
        }
        joined = JoinedPolygons()
        for number, cells in by_level.items():
            place_parts(cells, shafts, layouts)
            joined.add(clean(cells, number, repairs), height_m[number])
        for k, layout in layouts.items():
            add_flights(joined, k, shafts[k], layout, height_m, repairs)
        joined.leave_out_unsound(repairs)
        if not joined.polygons:
            raise MapError(f"building {self.name!r}: nothing to walk on; draw rooms or areas (add_walkable)")
        zones = [zone for zone in self._zones if zone.level in self._levels]
        return Building(self.name, joined.floor_polygons(), tuple(zones))

    # What is drawn.

    def _level(self, level: int | None) -> DrawnLevel:
        number = self._current if level is None else level
        if number is None:
            raise MapError("no level yet; begin with add_level(0)")
        if number not in self._levels:
            self.add_level(number)
        return self._levels[number]

    def _parts(self, geometry: Any, *, ring: bool = True) -> list[Any]:
        """Simple parts of a geometry, whose vertices are counted."""
        parts = simple_parts(geometry, ring=ring)
        self._num_vertices += int(shapely.get_num_coordinates(parts).sum())
        low_x, low_y, high_x, high_y = shapely.bounds(parts).reshape(-1, 4).T
        if (np.fmax(high_x - low_x, high_y - low_y) > MAX_SIZE_M).any():
            raise MapError(f"a shape is larger than {MAX_SIZE_M / 1000:g} km: plans are in metres; scale the drawing")
        return parts

    def _polygons(self, geometry: Any, where: str, level: int) -> list[Any]:
        return valid_polygons(self._parts(geometry), where, level, self._repairs)

    def _add_zone(self, id: str, name: str, shape: Any, level: int, use: str) -> None:
        own = unique_id(f"{level}/{id}", self._zone_ids)
        ring = shapely.get_coordinates(shapely.remove_repeated_points(shape, 1e-6).exterior)[:-1]
        self._zones.append(Zone(own, name, ring, level, use))


def finished(
    builder: BuildingBuilder, source: str, geo: GeoFrame | None = None, skipped: Mapping[str, int] | None = None
) -> Plan:
    """The plan of a builder that has been given everything."""
    building = builder.build()
    return Plan(building, geo, builder.repairs, source, dict(skipped or {}), suspicions(building))
