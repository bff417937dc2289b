"""Indoor Mapping Data Format (OGC 20-094): a folder or archive with one GeoJSON file for each type of feature.

Units are areas; walls are their edges, openings the doors in them. Walkways and other open units have no walls between
them. Stairs, escalators and lifts are units on each level: those above one another are joined.
"""

from __future__ import annotations

from collections import Counter
from pathlib import Path
from typing import Final

from pdrbench.errors import MapError
from pdrbench.io.geo import GeoFrame
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.maps.builder import BuildingBuilder, finished
from pdrbench_formats.maps.features import WORDS, Feature, check_degrees, frame_of, read_features, to_metres
from pdrbench_formats.maps.files import opened
from pdrbench_formats.maps.plan import Plan
from pdrbench_formats.maps.stacks import Outline, join_stacks

CATEGORIES: Final = WORDS["imdf"]  # categories: `open`, `barriers`, `solid_fixtures`, `connections`; `unused` files
MAX_ORDINAL: Final = 200  # no building has more levels


def read(path: Path | str, *, strict: bool = False) -> Plan:
    """Reads a folder or archive.

    Raises:
        MapError: Names file, feature and remedy.
    """
    container = opened(Path(path))
    builder = BuildingBuilder(Path(path).stem, strict=strict)
    parts: dict[str, list[Feature]] = {}
    for kind in ("level", "unit", "opening", "fixture", "building", *CATEGORIES["unused"]):
        name = f"{kind}.geojson"
        parts[kind] = read_features(container, name, builder.note_geometry) if name in container.sizes else []
    builder.name = _name(parts["building"]) or builder.name
    if not parts["level"] or not parts["unit"]:
        raise MapError(f"{path}: level.geojson and unit.geojson with geometry are needed; export the venue again")
    everything = [*parts["level"], *parts["unit"], *parts["opening"]]
    check_degrees(everything, path)
    geo = frame_of(everything)
    ordinals: dict[str, float] = {}
    for level in parts["level"]:
        ordinal = level.tags.get("ordinal")
        if isinstance(ordinal, bool) or not isinstance(ordinal, (int, float)) or not abs(ordinal) < MAX_ORDINAL:
            raise MapError(f"{level.where}: ordinal is {ordinal!r}; a level needs a number, 0 for the ground")
        ordinals[level.id] = ordinal
    for ordinal in sorted({int(one) for one in ordinals.values() if one == int(one)}):
        builder.add_level(ordinal)
    for kind in ("unit", "opening", "fixture"):
        parts[kind] = _on_whole_levels(parts[kind], ordinals, geo, builder)
    outlines: list[Outline] = []
    for unit in parts["unit"]:
        category, shape, number = unit.text("category").lower(), to_metres(unit.shape, geo), _level(unit, ordinals)
        if category in CATEGORIES["connections"]:
            outlines.append(
                Outline(CATEGORIES["connections"][category], number, shape, unit.id, is_walled=category == "elevator")
            )
        elif category in CATEGORIES["barriers"]:
            builder.add_wall(shape, number)
        else:
            builder.add_walkable(
                shape, number, id=unit.id, name=_name([unit]), use=category, walled=category not in CATEGORIES["open"]
            )
    for fixture in parts["fixture"]:
        if fixture.text("category") in CATEGORIES["solid_fixtures"]:
            builder.add_wall(to_metres(fixture.shape, geo), _level(fixture, ordinals))
    for opening in parts["opening"]:
        builder.add_door(to_metres(opening.shape, geo), _level(opening, ordinals), name=opening.id)
    join_stacks(builder, outlines)
    skipped = Counter({kind: len(parts[kind]) for kind in CATEGORIES["unused"] if parts[kind]})
    return finished(builder, "imdf", geo, skipped)


def _on_whole_levels(
    features: list[Feature], ordinals: dict[str, float], geo: GeoFrame, builder: BuildingBuilder
) -> list[Feature]:
    """The features but those of half levels, as mezzanines are, which are listed."""
    kept = []
    for feature in features:
        ordinal = ordinals.get(feature.text("level_id"), 0)
        if ordinal == int(ordinal):
            kept.append(feature)
        else:
            builder.note_half_level(feature.id, feature.text("category"), to_metres(feature.shape, geo), f"{ordinal:g}")
    return kept


def _level(feature: Feature, ordinals: dict[str, float]) -> int:
    id = feature.text("level_id")
    if id not in ordinals:
        raise MapError(f"{feature.where}: level_id {id!r} is no level of level.geojson; export the venue again")
    return int(ordinals[id])


def _name(features: list[Feature]) -> str:
    """The first name in any language."""
    for feature in features:
        names = feature.tags.get("name")
        if isinstance(names, dict) and names:
            return str(next(iter(names.values())))
        if isinstance(names, str):
            return names
    return ""


def sniff(head: Head) -> bool:
    """True for a folder or archive with `unit.geojson` and another file of a venue; few producers write all."""
    others = {"level.geojson", "venue.geojson", "manifest.json"}
    names = set() if head.container is None else head.container.sizes.keys()
    return "unit.geojson" in names and bool(others & names)


READER: Final = Reader(read, sniff)
