"""What a reader makes of a plan: the building, where it stands, and what was mended on the way."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from pdrbench.building import Building, FloorPolygon
from pdrbench.building.connectivity import lift_shafts
from pdrbench.io.geo import GeoFrame
from pdrbench_formats.maps.houses import unreachable


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
