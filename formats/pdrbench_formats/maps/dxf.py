"""DXF drawings (`ezdxf`), one for each level: what a layer holds is read from its name.

Walls are lines, polylines and arcs on layers named so ("A-WALL", "Wand", "mur"). Closed outlines on layers of rooms are
rooms; where there are none, the floor is what the outer walls enclose. Doors are gaps in the walls: lines, arcs and
blocks on layers of doors show where. Stairs and lifts are closed outlines; those above one another are joined.
Drawings of several levels share an origin, and a `plan.toml` beside them says which is which:

    [[level]]
    drawing = "ground.dxf"
    level = 0
    height_m = 0.0

The unit is that of $INSUNITS where what is drawn can be so large: doors, or treads, or else the whole plan. A file
`plan.toml` with `unit = "mm"` above the levels settles it.
"""

from __future__ import annotations

import io
import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, Literal

import msgspec
import numpy as np

from pdrbench.errors import MapError
from pdrbench.geometry import FloatArray
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.maps.builder import BuildingBuilder, finished
from pdrbench_formats.maps.features import beside, member, name_of, opened, toml_table
from pdrbench_formats.maps.plan import Plan
from pdrbench_formats.maps.stacks import Outline, join_stacks

LAYERS: Final = {
    "door": re.compile(r"door|t(ue|ü)r|port[ae]|puerta|deur|dörr|drzwi|двер|门|門|ドア|扉", re.IGNORECASE),
    "stairs": re.compile(r"stair|trepp|trap(pen)?$|escal|scal[ae]|strs|schod|лестн|楼梯|階段", re.IGNORECASE),
    "lift": re.compile(r"elev|lift|aufzug|ascens|evtr|winda|лифт|电梯|エレベ", re.IGNORECASE),
    "room": re.compile(
        r"room|space|r(au|ae|äu|ä)m|area|zone|bereich|outline|boundary|floor|flor|ruimte|pi[eè]ce|habitac|espacio|"
        r"stanz|local[ie]|sala|rum$|pok[oó]j|помещ|комнат|房间|房間|部屋",
        re.IGNORECASE,
    ),
    "wall": re.compile(
        r"wall|w(a|ä|ae)nd|mauer|mur|muur|pared|window|glaz|fenster|column|cols|st(ue|ü)tz|cloison|fen[eê]tre|ventana|"
        r"finestr|raam|vägg|[sś]cian|стен|墙|牆|壁|窗|柱",
        re.IGNORECASE,
    ),
}
UNITS_M: Final = {1: 0.0254, 2: 0.3048, 4: 0.001, 5: 0.01, 6: 1.0, 7: 1000.0, 10: 0.9144, 14: 0.1}  # by $INSUNITS
UNITS: Final = {"m": 1.0, "mm": 0.001, "cm": 0.01, "ft": 0.3048, "in": 0.0254}  # likely ones, the likeliest first
LIKELY_M: Final = (8.0, 600.0)  # the longer side of a building
POSSIBLE_M: Final = (2.0, 1800.0)
DOOR_M: Final = (0.6, 1.5)  # widths of doors, DIN 18100 and of double leaves
DOUBLE_DOOR_M: Final = 3.0
TREAD_M: Final = (0.22, 0.36)  # depth of treads, DIN 18065
MIN_TREADS: Final = 4  # parallel lines that are a flight
MIN_LIKELIER: Final = 1.25  # a unit is chosen over another that fits as well by so much
CLOSE_M: Final = 1.3  # half of a gap in the outer walls that is closed to find the floor
DAMAGED: Final = (ValueError, KeyError, IndexError, TypeError, AttributeError, AssertionError)  # of ezdxf, on bad files
MAX_BLOCKS: Final = 8  # within one another
ARC: Final = 0.005  # sagitta of the chords of an arc, of its size: 32 chords a circle


def read(path: Path | str, *, strict: bool = False) -> Plan:
    """Reads a drawing, or those that a `plan.toml` names.

    Raises:
        MapError: Names file, layers and remedy.
    """
    path = Path(path)
    plan = _plan(path)
    builder = BuildingBuilder(plan.name or name_of(path), strict=strict)
    skipped: Counter[str] = Counter()
    drawn = []
    for entry in plan.level:
        builder.add_level(entry.level, height_m=entry.height_m if len(plan.level) > 1 else 0.0)
        drawn.append(_in_metres(beside(path, entry.drawing), plan.unit, builder, entry.level, skipped))
    low = np.min([shape.bounds[:2] for level in drawn for part in level.values() for shape in part], axis=0)
    outlines: list[Outline] = []
    for entry, shapes in zip(plan.level, drawn, strict=True):
        outlines += _add_level(builder, beside(path, entry.drawing), entry.level, shapes, low)
    if len(drawn) > 1:
        join_stacks(builder, outlines)
    else:
        for outline in outlines:
            builder.add_zone(outline.shape, name=outline.kind, use=outline.kind)
    return finished(builder, "dxf", None, skipped)


class _Entry(msgspec.Struct, forbid_unknown_fields=True):
    drawing: str
    level: int = 0
    height_m: float | None = None


class _Plan(msgspec.Struct, forbid_unknown_fields=True):
    level: list[_Entry]
    name: str = ""
    unit: Literal["m", "mm", "cm", "ft", "in", ""] = ""


def _plan(path: Path) -> _Plan:
    """What a `plan.toml` says; of a drawing alone, that it is level 0."""
    if path.is_dir():
        names = sorted(place.name for place in path.glob("*.[dD][xX][fF]"))
        raise MapError(f"{path}: {len(names)} drawings; say in a plan.toml beside them which level each is:\n"
                       f'    [[level]]\n    drawing = "{names[0]}"\n    level = 0\n    height_m = 0.0')  # fmt: skip
    if path.suffix != ".toml":
        return _Plan([_Entry(path.name)])
    found: _Plan = toml_table(path, _Plan, "it needs [[level]] with drawing and level")
    if len({entry.level for entry in found.level}) != len(found.level) or not found.level:
        raise MapError(f"{path}: give one drawing for each level; levels are {[entry.level for entry in found.level]}")
    return found


def _in_metres(
    path: Path, unit: str, builder: BuildingBuilder, level: int, skipped: Counter[str]
) -> dict[str, list[Any]]:
    """Geometry of a drawing by what its layer holds."""
    import shapely

    document = _document(path)
    try:
        shapes = _drawn(document, skipped)
        names = sorted({_layer(entity) for entity in document.modelspace()})
    except DAMAGED as error:
        raise MapError(f"{path}: the drawing is damaged ({type(error).__name__}: {error}); export it again") from error
    if not shapes["wall"] and not shapes["room"]:
        raise MapError(
            f"{path}: no layer is named like walls or rooms (layers with drawings: {', '.join(names[:20]) or 'none'}); "
            f"rename the layers, for instance A-WALL, A-DOOR, A-ROOM"
        )
    scale = UNITS[unit] if unit else _scale(document, shapes, builder, level)
    return {name: [shapely.transform(shape, lambda xy: xy * scale) for shape in part] for name, part in shapes.items()}


def _add_level(
    builder: BuildingBuilder, path: Path, level: int, drawn: Mapping[str, list[Any]], low: FloatArray
) -> list[Outline]:
    """Adds what is drawn on a level, moved to an origin; returns its stairs and lifts."""
    import shapely

    shapes = {name: [shapely.transform(shape, lambda xy: xy - low) for shape in part] for name, part in drawn.items()}
    rooms = [shape for shape in shapes["room"] if shape.geom_type == "Polygon"]
    if rooms:
        for number, room in enumerate(rooms):
            builder.add_walkable(room, level, id=f"room-{number}", walled=not shapes["wall"])
    else:
        outline = _outline(shapes["wall"])
        if outline is None:
            raise MapError(f"{path}: the walls enclose no floor; draw closed outlines on a layer named A-ROOM")
        builder.add_walkable(outline, level, id="floor", walled=False)
    for wall in shapes["wall"]:
        if not (wall.geom_type == "Polygon" and any(room.equals(wall) for room in rooms)):
            builder.add_wall(wall.exterior if wall.geom_type == "Polygon" and wall.area > 25.0 else wall, level)
    for line in _doors(shapes["door"], shapes["wall"]):
        builder.add_door(line, level)
    return [
        Outline(kind, level, shape, f"{kind}-{number}")
        for kind in ("stairs", "lift")
        for number, shape in enumerate(shape for shape in shapes[kind] if shape.geom_type == "Polygon")
    ]


def _drawn(document: Any, skipped: Counter[str]) -> dict[str, list[Any]]:
    """Geometry by what its layer holds; counts what is on other layers or has none."""
    shapes: dict[str, list[Any]] = {name: [] for name in LAYERS}
    for layer, entity in _entities(document.modelspace()):
        kind = next((name for name, pattern in LAYERS.items() if pattern.search(layer)), "")
        made = _geometry(entity, kind) if kind else None
        if made is None:
            skipped[f"{entity.dxftype()} on layer {layer!r}"] += 1
        else:
            shapes[kind].append(made)
    return shapes


def _layer(entity: Any) -> str:
    return str(entity.dxf.layer) if entity.dxf.hasattr("layer") else "0"


def _document(path: Path) -> Any:
    try:
        from ezdxf import recover
        from ezdxf.lldxf.const import DXFError
    except ImportError:
        raise MapError("reading DXF needs ezdxf: pip install pdrbench[maps]") from None
    content = member(opened(path), path.name)
    if _DWG.match(content):
        raise MapError(f"{path}: a DWG drawing, whose format is not public; save it as DXF 2010 or later")
    try:
        document, _ = recover.read(io.BytesIO(content))
    except (OSError, DXFError, *DAMAGED) as error:
        raise MapError(f"{path}: no DXF drawing ({error}); export it again, as DXF 2010 or later") from error
    return document


def _entities(entities: Iterable[Any], block_layer: str = "0", depth: int = 0) -> Iterator[tuple[str, Any]]:
    """Entities with their layers; blocks are left whole on layers of doors and taken apart on others.

    What lies on layer 0 of a block is on the layer that the block is inserted on.
    """
    for entity in entities:
        layer = _layer(entity) if _layer(entity) != "0" else block_layer
        if entity.dxftype() == "INSERT" and not LAYERS["door"].search(layer) and depth < MAX_BLOCKS:
            yield from _entities(entity.virtual_entities(), layer, depth + 1)
        else:
            yield layer, entity


def _geometry(entity: Any, kind: str) -> Any:
    """A shapely geometry in units of the drawing; None for text, dimensions and other things without one."""
    import shapely
    from ezdxf import path as paths

    if entity.dxftype() == "INSERT":
        parts = [shape for part in entity.virtual_entities() if (shape := _geometry(part, "")) is not None]
        return shapely.oriented_envelope(shapely.union_all(parts)) if parts else None
    if entity.dxftype() == "POINT":
        return shapely.Point(*entity.dxf.location.vec2)
    if entity.dxftype() == "ARC" and kind == "door":
        # The way of a leaf: shut, it lies on one of the two radii.
        ends = ((entity.dxf.center, entity.start_point), (entity.dxf.center, entity.end_point))
        return shapely.MultiLineString([[(a.x, a.y), (b.x, b.y)] for a, b in ends])
    try:
        line = paths.make_path(entity)
    except TypeError:
        return None
    points = np.array([(vertex.x, vertex.y) for vertex in line.flattening(_sagitta(line))])
    points = points[np.append(True, np.abs(np.diff(points, axis=0)).max(axis=1) > 0)] if len(points) else points
    if len(points) < 2:
        return None
    closed = bool(getattr(entity, "is_closed", False)) or bool((points[0] == points[-1]).all())
    return shapely.Polygon(points) if closed and len(points) > 3 else shapely.LineString(points)


def _doors(doors: list[Any], walls: list[Any]) -> list[Any]:
    """Lines and polygons of doors; of an arc, the radius that ends at walls."""
    import shapely

    solid = shapely.union_all(walls) if walls else shapely.Polygon()
    found = []
    for door in doors:
        if door.geom_type != "MultiLineString":
            found.append(door)
            continue
        radii = shapely.get_parts(door)
        found.append(min(radii, key=lambda line: shapely.distance(solid, shapely.points(line.coords)).sum()))
    return found


def _sagitta(line: Any) -> float:
    """A fraction of the size of an entity, which of a closed one is not the way from its start to its end."""
    points = np.array([(vertex.x, vertex.y) for vertex in line.control_vertices()])
    return max(float(np.ptp(points, axis=0).max()), 1e-6) * ARC if len(points) else 1e-6


def _scale(document: Any, shapes: Mapping[str, list[Any]], builder: BuildingBuilder, level: int) -> float:
    """Metres for one unit of the drawing: that of its header, unless what is drawn fits another one only."""
    bounds = np.array([shape.bounds for part in shapes.values() for shape in part])
    size = float((bounds[:, 2:].max(axis=0) - bounds[:, :2].min(axis=0)).max())
    parts = [(name, length) for name, find in (("door", _door), ("tread", _tread)) if (length := find(shapes))]

    def seen(scale: float) -> str:
        of_parts = "".join(f", a {name} {length * scale:.3g} m" for name, length in parts)
        return f"{size * scale:.3g} m across{of_parts}"

    scales = {name: scale for name, scale in UNITS.items() if _misfit(size * scale, parts, scale) < np.inf}
    likely = min(scales, key=lambda name: _misfit(size * scales[name], parts, scales[name]), default="m")
    stated = UNITS_M.get(int(document.header.get("$INSUNITS", 0)))
    if stated is None:
        what = f"the drawing names no unit: {size:.4g} units across, taken for {likely}: {seen(UNITS[likely])}"
        builder.note("units assumed", what, level)
        return UNITS[likely]
    is_possible = POSSIBLE_M[0] < size * stated < POSSIBLE_M[1]
    if UNITS[likely] == stated or (is_possible and not parts):
        return stated
    if not scales:
        builder.note("units doubtful", f"by its $INSUNITS the drawing is {seen(stated)}; {_SETTLE}", level)
        return stated
    ours, theirs = (_misfit(size * scale, parts, scale) for scale in (UNITS[likely], stated))
    if theirs < ours + np.log(MIN_LIKELIER):
        return stated
    doors_m = [length * stated for name, length in parts if name == "door"]
    chosen = stated if theirs < np.inf and doors_m and DOOR_M[0] <= doors_m[0] <= DOOR_M[1] else UNITS[likely]
    builder.note(
        "units doubtful",
        f"by its $INSUNITS the drawing is {seen(stated)}; in {likely} it would be {seen(UNITS[likely])}, "
        f"{'and the first is taken' if chosen == stated else 'which is taken'}; {_SETTLE}",
        level,
    )
    return chosen


_SETTLE: Final = 'a plan.toml with unit = "mm", or whichever is right, settles it'


def _misfit(size_m: float, parts: Sequence[tuple[str, float]], scale: float) -> float:
    """How far sizes are from usual ones, as a logarithm; infinite where one of them cannot be."""
    if not POSSIBLE_M[0] < size_m < POSSIBLE_M[1]:
        return float(np.inf)
    off = 0.0 if LIKELY_M[0] <= size_m <= LIKELY_M[1] else float(np.log(2.0))
    for name, length in parts:
        low, high = DOOR_M if name == "door" else TREAD_M
        width_m = length * scale
        if not low * 0.8 <= width_m <= (DOUBLE_DOOR_M if name == "door" else high * 1.2):
            return float(np.inf)
        off += abs(float(np.log(width_m / (low * high) ** 0.5)))
    return off


def _door(shapes: Mapping[str, list[Any]]) -> float:
    """Median width of what is on layers of doors, in units of the drawing; 0 where there is none."""
    import shapely

    widths = []
    for shape in shapes["door"]:
        line = shapely.get_parts(shape)[0] if shape.geom_type == "MultiLineString" else shape
        corners = shapely.get_coordinates(shapely.oriented_envelope(line))
        widths.append(float(np.hypot(*np.diff(corners[:3], axis=0).T).max()) if len(corners) > 1 else 0.0)
    widths = [width for width in widths if width > 0.0]
    return float(np.median(widths)) if widths else 0.0


def _tread(shapes: Mapping[str, list[Any]]) -> float:
    """Median distance of lines on layers of stairs from the nearest parallel one; 0 where there are few."""
    lines = [np.array(shape.coords)[[0, -1]] for shape in shapes["stairs"] if shape.geom_type == "LineString"]
    if len(lines) < MIN_TREADS:
        return 0.0
    ends = np.array(lines)
    along = ends[:, 1] - ends[:, 0]
    length = np.hypot(*along.T)
    unit = along / np.maximum(length, 1e-9)[:, None]
    middle = ends.mean(axis=1)
    off = middle[:, None] - middle[None]
    across = np.abs(off[..., 0] * unit[:, None, 1] - off[..., 1] * unit[:, None, 0])
    beside = np.abs((off * unit[:, None]).sum(axis=2)) < 0.5 * length[:, None]
    parallel = np.abs(unit @ unit.T) > 0.99
    across[~(beside & parallel) | (across < 1e-6 * length.max())] = np.inf
    nearest = across.min(axis=1)
    nearest = nearest[np.isfinite(nearest)]
    return float(np.median(nearest)) if len(nearest) >= MIN_TREADS else 0.0


def _outline(walls: list[Any]) -> Any:
    """What the outer walls enclose once gaps as wide as doors are closed."""
    import shapely

    drawn = shapely.union_all(
        [wall.exterior if wall.geom_type == "Polygon" and wall.area > 25.0 else wall for wall in walls]
    )
    closed = drawn.buffer(CLOSE_M, join_style="mitre")
    filled = [shapely.Polygon(part.exterior) for part in shapely.get_parts(closed)]
    outline = shapely.union_all(filled).buffer(-CLOSE_M, join_style="mitre")
    return None if outline.area < 2.0 else outline


def sniff(head: Head) -> bool:
    """True for a DXF file, as text or binary, and a TOML file that names some; and for DWG, which is refused."""
    content = head.content.lstrip()
    if head.path.suffix == ".toml":
        return b"[[level]]" in content and b"drawing" in content
    if head.path.is_dir():
        return bool(head.members()) and all(name.lower().endswith(".dxf") for name in head.members())
    return (
        bool(_DWG.match(content))
        or content.startswith(b"AutoCAD Binary DXF")
        or (content.startswith((b"0\r\nSECTION", b"0\nSECTION", b"999")) and b"SECTION" in content[:2000])
    )


_DWG: Final = re.compile(rb"AC10\d\d\0")
READER: Final = Reader(read, sniff)
