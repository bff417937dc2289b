"""DXF drawings (`ezdxf`), one for each level: what a layer holds is read from its name.

Layers are read as `maps.layers` says. Lines, arcs and blocks on layers of doors show which gaps in walls are doors.
Drawings of several levels share an origin, and a `plan.toml` beside them says which is which.
"""

from __future__ import annotations

import io
import logging
import re
from collections import Counter
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import shapely

from pdrbench.errors import MapError
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.maps import files
from pdrbench_formats.maps.builder import BuildingBuilder, finished
from pdrbench_formats.maps.layers import LAYERS, Drawn, Unit, add_levels, in_metres, kind_of
from pdrbench_formats.maps.plan import Plan

UNITS_M: Final = {1: 0.0254, 2: 0.3048, 4: 0.001, 5: 0.01, 6: 1.0, 7: 1000.0, 10: 0.9144, 14: 0.1}  # by $INSUNITS
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
    builder = BuildingBuilder(plan.name or files.name_of(path), strict=strict)
    skipped: Counter[str] = Counter()
    drawn = []
    for entry in plan.level:
        builder.add_level(entry.level, height_m=entry.height_m if len(plan.level) > 1 else 0.0)
        shapes, stated = _drawing(files.beside(path, entry.drawing), skipped)
        drawn.append((entry.level, in_metres(shapes, plan.unit, stated, builder, entry.level)))
    add_levels(builder, drawn, path)
    return finished(builder, "dxf", None, skipped)


class _Entry(msgspec.Struct, forbid_unknown_fields=True):
    drawing: str
    level: int = 0
    height_m: float | None = None


class _Plan(msgspec.Struct, forbid_unknown_fields=True):
    level: list[_Entry]
    name: str = ""
    unit: Unit = ""


def _plan(path: Path) -> _Plan:
    """What a `plan.toml` says; of a drawing alone, that it is level 0."""
    if path.is_dir():
        names = sorted(place.name for place in path.glob("*.[dD][xX][fF]"))
        raise MapError(f"{path}: {len(names)} drawings; say in a plan.toml beside them which level each is:\n"
                       f'    [[level]]\n    drawing = "{names[0]}"\n    level = 0\n    height_m = 0.0')  # fmt: skip
    if path.suffix != ".toml":
        return _Plan([_Entry(path.name)])
    found: _Plan = files.toml_table(path, _Plan, "it needs [[level]] with drawing and level")
    if len({entry.level for entry in found.level}) != len(found.level) or not found.level:
        raise MapError(f"{path}: give one drawing for each level; levels are {[entry.level for entry in found.level]}")
    return found


def _drawing(path: Path, skipped: Counter[str]) -> tuple[Drawn, float | None]:
    """Geometry of a drawing by what its layer holds, and metres for one of its units where the header says it."""
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
    return shapes, UNITS_M.get(int(document.header.get("$INSUNITS", 0)))


def _drawn(document: Any, skipped: Counter[str]) -> dict[str, list[Any]]:
    """Geometry by what its layer holds; counts what is on other layers or has none."""
    shapes: dict[str, list[Any]] = {name: [] for name in LAYERS}
    for layer, entity in _entities(document.modelspace()):
        kind = kind_of(layer)
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
    logging.getLogger("ezdxf").setLevel(logging.CRITICAL)  # it prints what a file holds, as it is
    content = files.member(files.opened(path), path.name)
    if _DWG.match(content):
        raise MapError(f"{path}: a DWG drawing, whose format is not public; save it as DXF 2010 or later")
    try:
        document, _ = recover.read(io.BytesIO(content))
    except (OSError, DXFError, *DAMAGED) as error:
        raise MapError(f"{path}: no DXF drawing ({error}); export it again, as DXF 2010 or later") from error
    return document


def _entities(
    entities: Iterable[Any], block_layer: str = "0", within: tuple[str, ...] = (), *, whole: str = "door"
) -> Iterator[tuple[str, Any]]:
    """Entities with their layers; blocks are left whole on layers of doors (`whole`) and taken apart on others.

    What lies on layer 0 of a block is on the layer that the block is inserted on. A block in itself is left out.
    """
    for entity in entities:
        layer = _layer(entity) if _layer(entity) != "0" else block_layer
        if entity.dxftype() != "INSERT" or kind_of(layer) == whole:
            yield layer, entity
        elif len(within) < MAX_BLOCKS and (name := str(entity.dxf.get("name")).lower()) not in within:
            yield from _entities(entity.virtual_entities(), layer, (*within, name), whole=whole)


def _geometry(entity: Any, kind: str) -> Any:
    """A shapely geometry in units of the drawing; None for text, dimensions and other things without one."""
    from ezdxf import path as paths

    if entity.dxftype() == "INSERT":
        inner = (_geometry(part, "") for _, part in _entities([entity], whole="all"))
        parts = [shape for shape in inner if shape is not None]
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
    sagitta = _sagitta(line)
    points = np.array([(vertex.x, vertex.y) for vertex in (line.flattening(sagitta) if sagitta < np.inf else ())])
    points = points[np.append(True, np.abs(np.diff(points, axis=0)).max(axis=1) > 0)] if len(points) else points
    if len(points) < 2:
        return None
    closed = bool(getattr(entity, "is_closed", False)) or bool((points[0] == points[-1]).all())
    return shapely.Polygon(points) if closed and len(points) > 3 else shapely.LineString(points)


def _sagitta(line: Any) -> float:
    """A fraction of the size of an entity, above what floats resolve; NaN where it is nowhere: ezdxf never ends."""
    points = np.array([vertex.xyz for vertex in line.control_vertices()])
    return max(np.ptp(points, axis=0).max(), 1e-6, 1e-9 * np.abs(points).max()) * ARC if len(points) else 1e-6


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
