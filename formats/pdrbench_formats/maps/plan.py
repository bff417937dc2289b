"""What a reader makes of a plan: the building, where it stands, and what was mended on the way."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from pdrbench.building import Building, FloorPolygon
from pdrbench.building.connectivity import labels_of, lift_shafts, reachable_parts, unconnected_levels
from pdrbench.building.polygons import shapely_polygons
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.io.geo import GeoFrame

HOUSE_M: Final = 2.0  # thicker than any wall: what lies further apart is two houses
MIN_HOUSE: Final = 0.1  # of the area of the largest house: what is smaller is a part without a way in


@dataclass(frozen=True, slots=True)
class Repair:
    """Something that was mended or assumed.

    Attributes:
        kind: One word or two, such as "sliver", to count by.
        where: Names the level, and the polygon as far as it has a name.
        what: What was seen and what was done.
        place_xy_m: Where on the plan; None where it has no place.
        level: On which level; None where it has none.
    """

    kind: str
    where: str
    what: str
    place_xy_m: tuple[float, float] | None = None
    level: int | None = None


@dataclass(frozen=True, slots=True)
class Plan:
    """A plan that was read.

    Attributes:
        building: What one can walk on.
        geo: Where (0, 0) of the building is on the Earth, x east and y north; None where the plan does not say.
        repairs: What was mended or assumed.
        source: Format, such as "imdf".
        skipped: Count of features by kind that say nothing of where one can walk.
        warnings: What may be wrong with the plan as a whole, such as its units.
        closed: What nobody walks on unless doors are opened, apart from the building: shops of a shopping centre.
    """

    building: Building
    geo: GeoFrame | None = None
    repairs: tuple[Repair, ...] = ()
    source: str = ""
    skipped: Mapping[str, int] = field(default_factory=dict)
    warnings: tuple[str, ...] = ()
    closed: tuple[FloorPolygon, ...] = ()

    def describe(self) -> dict[str, Any]:
        """What `pdrbench inspect` prints."""
        return {
            "holds": "a map",
            "name": self.building.name,
            "place": "unknown" if self.geo is None else f"{self.geo.lat_deg:.6f}, {self.geo.lon_deg:.6f}",
            "repairs": dict(Counter(repair.kind for repair in self.repairs)),
            "skipped": dict(self.skipped),
            "warnings": "; ".join(self.warnings) or "none",
            "levels": level_table(self.building),
        }


@dataclass(frozen=True, slots=True)
class PlanAlignment:
    """From the plane of a plan to metres with x east: scaled, then turned about the origin."""

    turn_rad: float = 0.0  # heading of the x axis of the plan, counter-clockwise from east
    scale: float = 1.0  # metres per unit of the plan

    @property
    def is_identity(self) -> bool:
        """True where nothing changes."""
        return self.turn_rad == 0.0 and self.scale == 1.0

    def __call__(self, xy: FloatArray) -> FloatArray:
        """(..., 2) metres of places (..., 2)."""
        if self.is_identity:
            return np.asarray(xy, dtype=np.float64)
        cos, sin = math.cos(self.turn_rad), math.sin(self.turn_rad)
        turned: FloatArray = self.scale * (np.asarray(xy, dtype=np.float64) @ np.array([[cos, sin], [-sin, cos]]))
        return turned

    def building(self, building: Building) -> Building:
        """The same building on the other plane; heights stay."""
        if self.is_identity:
            return building
        polygons = tuple(
            replace(p, outline_xy_m=self(p.outline_xy_m), holes=tuple(self(hole) for hole in p.holes))
            for p in building.polygons
        )
        zones = tuple(replace(zone, outline_xy_m=self(zone.outline_xy_m)) for zone in building.zones)
        return Building(name=building.name, polygons=polygons, zones=zones)


def level_table(building: Building) -> list[dict[str, Any]]:
    """Per level: floor polygons, area, extent, doors, treads, lifts, and parts that no way leads to."""
    is_lost = unreachable(building)
    stops = {i for shaft in lift_shafts(building) for i in shaft}
    rows = []
    for level in building.levels:
        here = [i for i, polygon in enumerate(building.polygons) if polygon.level == level]
        x0, y0, x1, y1 = building.bounds_m(level)
        rows.append(
            {
                "level": level,
                "polygons": len(here),
                "area_m2": sum(building.polygons[i].area_m2 for i in here),
                "extent_m": f"{x1 - x0:.0f} × {y1 - y0:.0f}",
                "doors": sum("/door" in building.polygons[i].id for i in here),
                "treads": sum(building.polygons[i].kind == "stairs" for i in here),
                "lifts": sum(i in stops for i in here),
                "unreachable": int(is_lost[here].sum()),
            }
        )
    return rows


def unreachable(building: Building) -> BoolArray:
    """(P,) True for floor polygons that no way leads to from the largest part of their house or unconnected level.

    Lifts count as ways. What lies further than `HOUSE_M` from all else is a house of its own where it is large.
    """
    import shapely

    parts = reachable_parts(building)
    shapes = shapely_polygons(building.polygons)
    near = shapely.STRtree(shapes).query(shapes, predicate="dwithin", distance=HOUSE_M)
    houses = labels_of(len(parts), parts[near[:, building.level(near[0]) == building.level(near[1])]].T)[parts]
    area_m2 = np.bincount(houses, weights=[polygon.area_m2 for polygon in building.polygons])
    # The largest part is 0, and the largest of a house the least.
    main = {int(parts[houses == house].min()) for house in np.flatnonzero(area_m2 >= MIN_HOUSE * area_m2.max())}
    for level in unconnected_levels(building):
        here = [i for i, polygon in enumerate(building.polygons) if polygon.level == level]
        area_m2 = np.bincount(parts[here], weights=[building.polygons[i].area_m2 for i in here])
        main.add(int(area_m2.argmax()))
    lost: BoolArray = ~np.isin(parts, list(main))
    return lost


def suspicions(building: Building) -> tuple[str, ...]:
    """Signs that lengths are not metres."""
    x0, y0, x1, y1 = building.bounds_m()
    size_m = max(x1 - x0, y1 - y0)
    doors = [polygon for polygon in building.polygons if "/door" in polygon.id]
    widths = sorted(max(_size(polygon.outline_xy_m)) for polygon in doors)
    median = widths[len(widths) // 2] if widths else 0.9
    found = []
    if size_m > 2000.0:
        found.append(f"the building measures {size_m:.0f} m: are lengths centimetres or millimetres?")
    elif size_m < 5.0:
        found.append(f"the building measures {size_m:.2g} m: are lengths degrees or kilometres?")
    elif len(widths) >= 5 and median > 2.2:
        found.append(f"half of the doors are wider than {median:.1f} m: are lengths feet? (3 feet are 0.9 m)")
    return tuple(found)


def _size(ring: Any) -> tuple[float, float]:
    import shapely

    corners = shapely.get_coordinates(shapely.oriented_envelope(shapely.Polygon(ring)))
    sides = ((corners[1:3] - corners[:2]) ** 2).sum(axis=1) ** 0.5
    return float(sides[0]), float(sides[1])
