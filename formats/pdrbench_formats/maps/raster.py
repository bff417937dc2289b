"""Plans as pictures: walls by threshold, outlines by tracing. A PNG with a scale beside it, and maps of ROS map_server.

`plan.toml` names them and their scales. A picture is drawn with x right and y up, (0, 0) in its lower left corner.
"""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import msgspec
import numpy as np
import numpy.typing as npt
import shapely
from scipy import ndimage

from pdrbench.errors import MapError
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.io.reader import Head, Reader
from pdrbench_formats.maps import files
from pdrbench_formats.maps.builder import BuildingBuilder, finished
from pdrbench_formats.maps.layers import UNITS, Unit, scale_of
from pdrbench_formats.maps.plan import Plan, PlanAlignment

MAX_PIXELS: Final = 40_000_000
BAND: Final = 64  # rows that are made grey at once: copies of all of a picture took 1.2 GB
MAX_TRACED: Final = 1_000_000  # a larger picture is thinned: one of 1 kB and 15 million pixels took 21 s
DARK: Final = 0.5  # of white: darker pixels are wall
MIN_BRIGHT: Final = 0.2  # of a picture of dark walls; less in one of light walls on dark paper
ENTRANCES_M: Final = (1.1, 1.6, 2.0)  # wall to wall: one leaf, two leaves
MIN_OF_HULL: Final = 0.1  # of what walls span: less floor is what letters enclose
MIN_ROOM_M2: Final = 4.0  # smaller ones all round which another room lies are tables, columns and letters
CLOSE_M: Final = 0.06  # of walls: gaps narrower than this are faults of a scan, specks smaller than this are dirt
SIMPLIFY_PIXELS: Final = 0.75
MIN_AREA_M2: Final = 0.5
MIN_SIDE_M: Final = 2.0  # of a picture: less is no plan, and an entrance would be wider than all of it
MIN_HOLE_PIXELS: Final = 2.0  # single dark pixels are dirt
MAX_PARTS: Final = 300  # of the floor of a level, and as many holes: noise has thousands, which took 20 s
MAX_EDGES: Final = 100_000  # of pixels between floor and wall: a room for each 40 by 40 pixels of `MAX_TRACED`
MAX_CORNERS: Final = 5_000  # of the outlines of a level: noise has 50 000, which took 8 s
MIN_HOUSE: Final = 0.5  # of the floor inside of a frame, which is one part of it: a block of rooms in a ring is many
MIN_FILLED: Final = 0.125  # of a frame, either way, by the largest thing in it
NECK_PIXELS: Final = 500_000  # of a picture in which necks are measured: a larger one is thinned
NECK_RADII: Final = 32
MIN_DEPTH: Final = 1.5  # of a room, in widths of its door
ByteArray = npt.NDArray[np.uint8]


class Picture(msgspec.Struct, forbid_unknown_fields=True):
    """One level of a `plan.toml`."""

    image: str
    metres_per_pixel: float
    level: int = 0
    height_m: float | None = None
    dark: float | None = None
    frame: bool | None = None
    origin_m: tuple[float, float] = (0.0, 0.0)


class _Plan(msgspec.Struct, forbid_unknown_fields=True):
    level: list[Picture]
    name: str = ""
    unit: Unit = ""


def read(path: Path | str, *, strict: bool = False) -> Plan:
    """Reads a `plan.toml` and the pictures that it names; or a picture with a file of its name and `.toml` beside it.

    Raises:
        MapError: Names file and remedy.
    """
    path = Path(path)
    if not path.suffix == ".toml" and files.member(files.opened(path), path.name).lstrip().startswith(_DRAWINGS):
        raise MapError(f"{path}: a drawing of lines, no picture of pixels; save the page as PNG")
    table = path if path.suffix == ".toml" else path.with_suffix(".toml")
    if not table.is_file():
        raise MapError(
            f"{path}: a picture says nothing of its scale; write {table.name} beside it with\n"
            f'    [[level]]\n    image = "{path.name}"\n    metres_per_pixel = 0.05'
        )
    plan: _Plan = files.toml_table(table, _Plan, "it needs [[level]] with image and metres_per_pixel")
    builder = BuildingBuilder(plan.name or table.stem, strict=strict)
    for picture in plan.level:
        if not 0.0 < picture.metres_per_pixel < np.inf:
            raise MapError(f"{table}: metres_per_pixel is {picture.metres_per_pixel:g}; expected more than 0")
        place = files.beside(table, picture.image)
        builder.add_level(picture.level, height_m=picture.height_m)
        pixels = _grey(place)
        dark = DARK if picture.dark is None else picture.dark
        light_walls = bool((pixels > 255 * dark).mean() < MIN_BRIGHT and picture.dark is None)
        pixels, step = _thinned(pixels, builder, picture.level, walls_are_bright=light_walls)
        grey = pixels / 255.0
        bright = (grey > dark) ^ light_walls
        if light_walls:
            builder.note("light walls", f"{bright.mean():.0%} of the picture is dark: what is light was taken for wall")
        picture = msgspec.structs.replace(picture, metres_per_pixel=picture.metres_per_pixel * step)
        picture = _in_metres(picture, bright, plan.unit, builder)
        if not 1e-4 < picture.metres_per_pixel < 10:
            raise MapError(
                f"{table}: a pixel is {picture.metres_per_pixel:g} m; expected 0.0001 to 10 m, or name a unit"
            )
        if min(grey.shape) * picture.metres_per_pixel < MIN_SIDE_M:
            raise MapError(f"{place}: a side is less than {MIN_SIDE_M:g} m long; is metres_per_pixel wrong?")
        free = _inside(grey, bright, builder, picture, place)
        _add_free(builder, free, picture.level, place, PlanAlignment(scale=picture.metres_per_pixel), picture.origin_m)
    return finished(builder, "picture")


def _grey(path: Path) -> ByteArray:
    """(H, W) brightness from 0, black, to 255, white; transparent is white."""
    from PIL import Image

    content = files.member(files.opened(path), path.name)
    try:
        with Image.open(io.BytesIO(content)) as image:
            if image.width * image.height > MAX_PIXELS:
                raise MapError(
                    f"{path}: {image.width} × {image.height} pixels; scale it down to {MAX_PIXELS // 10**6} million"
                )
            grey: ByteArray = np.empty((image.height, image.width), np.uint8)
            for top in range(0, image.height, BAND):
                band: Any = image.crop((0, top, image.width, min(top + BAND, image.height)))
                if image.mode in ("RGBA", "LA", "PA") or "transparency" in image.info:
                    band = Image.alpha_composite(Image.new("RGBA", band.size, "white"), band.convert("RGBA"))
                grey[top : top + BAND] = band.convert("L")
    except MapError:
        raise
    except Exception as error:  # of damaged files Pillow's readers raise whatever they stumble upon
        raise MapError(f"{path}: no picture that can be read ({error}); save it as PNG") from error
    return grey


def _thinned(pixels: Any, builder: BuildingBuilder, level: int, *, walls_are_bright: bool = False) -> tuple[Any, int]:
    """One pixel for each square of pixels, that which is most like a wall, and how many are a side of the square."""
    step = max(1, math.ceil(math.sqrt(pixels.size / MAX_TRACED)))
    if step > 1:
        builder.note("picture thinned", f"of {step} by {step} pixels the one most like a wall was read", level)
    rows, columns = (-size % step for size in pixels.shape)
    padded = np.pad(pixels, ((rows, 0), (0, columns)), mode="edge")
    squares = padded.reshape(len(padded) // step, step, -1, step)
    return (squares.max if walls_are_bright else squares.min)(axis=(1, 3)), step


def _far2(mask: BoolArray) -> IntArray:
    """(H, W) pixels, squared, from each true pixel to the nearest that is false."""
    off = ndimage.distance_transform_edt(mask, return_distances=False, return_indices=True)
    off[0] -= np.arange(len(mask), dtype=np.int32)[:, None]
    off[1] -= np.arange(mask.shape[1], dtype=np.int32)
    return np.asarray(np.einsum("kij,kij->ij", off, off))  # without a copy of it


def _in_metres(picture: Picture, bright: BoolArray, unit: Unit, builder: BuildingBuilder) -> Picture:
    """The table of a picture in metres: in the unit that is named, else in one in which the plan can be so large."""
    per_pixel = picture.metres_per_pixel
    rows, columns = np.nonzero(~bright)
    if unit or not len(rows):
        scale = UNITS[unit or "m"]
    else:
        width = _neck(bright) * per_pixel
        parts = [("door", width)] if width else []
        size = float(max(np.ptp(rows), np.ptp(columns)) + 1) * per_pixel
        scale = scale_of(size, parts, 1.0, builder, picture.level, keeps_possible=True)
    x, y = picture.origin_m
    return msgspec.structs.replace(picture, metres_per_pixel=per_pixel * scale, origin_m=(x * scale, y * scale))


def _neck(bright: BoolArray) -> float:
    """Width in pixels at which most bright parts come apart, as rooms do at their doors; 0 where none do."""
    step = int(np.ceil(np.sqrt(bright.size / NECK_PIXELS)))
    far2 = _far2(bright[::step, ::step])
    radii = np.geomspace(1.0, max(float(far2.max()) ** 0.5 / 2.0, 2.0), NECK_RADII)
    counts = []
    for radius in radii:
        labels, _ = ndimage.label(far2 > radius**2)
        deep = far2 > (MIN_DEPTH * radius) ** 2  # a room is wider than its door
        counts.append(np.count_nonzero(np.bincount(labels[deep])))
    more = np.diff(counts)
    return 2.0 * float(radii[1 + int(more.argmax())]) * step if more.max() > 0 else 0.0


def _skimage() -> Any:
    try:
        import skimage.filters
        import skimage.measure
        import skimage.morphology
    except ImportError:
        raise MapError("reading pictures needs scikit-image: pip install pdrbench[maps]") from None
    return skimage


def _inside(grey: FloatArray, bright: BoolArray, builder: BuildingBuilder, picture: Picture, place: Path) -> BoolArray:
    """Bright pixels that walls enclose; walls are found by a threshold between theirs and that of the paper."""
    if bright.mean() < MIN_BRIGHT:
        raise MapError(f"{place}: {1 - bright.mean():.0%} of the picture is wall: a wrong `dark`? Set it in the table")
    bright = _without_frame(bright, picture, builder)
    inside = _enclosed(bright, picture.metres_per_pixel)
    if inside is None and picture.dark is None and np.ptp(grey) > 0.1:
        level = float(_skimage().filters.threshold_otsu(grey))
        inside = _enclosed(grey > level, picture.metres_per_pixel)
        if inside is not None:
            bright = grey > level
            builder.note("threshold found", f"walls are pale: what is darker than {level:.2f} of white", picture.level)
    if inside is None:
        builder.note("walls not closed", "no wall encloses any floor: all that is bright was taken", picture.level)
        return bright
    if inside[1]:
        what = f"the outer wall has gaps of up to {inside[1]:g} m, which were closed to find what is inside"
        builder.note("walls not closed", what, picture.level)
    hull = _skimage().morphology.convex_hull_image(~bright)
    if inside[0].sum() < MIN_OF_HULL * hull.sum():
        what = f"{inside[0].sum() / hull.sum():.0%} of what walls span is floor: is the outer wall open, `dark` wrong?"
        builder.note("floor doubtful", what, picture.level)
    return inside[0]


def _without_frame(bright: BoolArray, picture: Picture, builder: BuildingBuilder) -> BoolArray:
    """Bright pixels, with those of a line round everything that is the frame of the drawing.

    A frame it is where the table says so, or where what lies inside of it hangs together as a house does. The line is a
    dark part, a rectangle without a gap round all others, and touches none. A house has ways between rooms: one room is
    an office in a hall. So are rooms that one can enter and that fill less than half of the line's length or width.
    """
    parts, _ = ndimage.label(~bright, np.ones((3, 3)))
    boxes = ndimage.find_objects(parts)
    if picture.frame is False or len(boxes) < 2:
        return bright
    sides = np.array([[one.stop - one.start for one in box] for box in boxes])
    outer = int(sides.prod(axis=1).argmax())
    margin = 2 + int(sides[outer].max()) // 50
    inner = tuple(slice(one.start + margin, one.stop - margin) for one in boxes[outer])
    fills = (np.delete(sides, outer, axis=0) / sides[outer]).min(axis=1).max()
    line = parts == 1 + outer
    if fills < MIN_FILLED or line[inner].any():
        return bright
    beside = ndimage.label(np.pad(~line, 1, constant_values=True))[0]
    if not picture.frame and (beside[1:-1, 1:-1][inner] == beside[0, 0]).any():
        return bright
    within, pixel_m2 = bright | line, picture.metres_per_pixel**2
    found = _enclosed(within, picture.metres_per_pixel)
    floor, way_in_m = found or (np.zeros_like(bright), 0.0)
    rooms = np.bincount(ndimage.label(floor)[0].ravel(), minlength=2)[1:]
    hangs_together = rooms.max() >= MIN_HOUSE * rooms.sum() and _neck(floor) > 0.0
    is_frame = bool(picture.frame) or (hangs_together and (fills >= MIN_HOUSE or not way_in_m))
    what = (
        f"a line round {sides[outer].prod() * pixel_m2:.0f} m² touches nothing, and without it "
        f"{floor.sum() * pixel_m2:.0f} m² are floor: taken for {'the frame of the drawing' if is_frame else 'a wall'}; "
        f"`frame = {'false' if is_frame else 'true'}` below [[level]] says otherwise"
    )
    builder.note("frame", what, picture.level)
    return within if is_frame else bright


def _enclosed(bright: BoolArray, metres_per_pixel: float) -> tuple[BoolArray, float] | None:
    """Bright pixels where no disc gets from the border of the picture, and how wide that is; None where there are none.

    The disc is a point, or as wide as an open entrance where that leaves rooms inside that are wider than it.
    """
    if bright.all():
        return None
    radius = max(1, round(CLOSE_M / metres_per_pixel / 2))
    walls = _far2(bright) <= radius**2  # closed by discs: grown, and shrunk again
    walls = walls if walls.all() else _far2(walls) > radius**2
    margin = int(ENTRANCES_M[-1] / metres_per_pixel / 2) + 2  # of paper, from which the disc comes
    clear2 = _far2(~np.pad(walls, margin))
    labels = ndimage.label(clear2 > 0)[0]
    within = slice(margin, -margin)
    inside, wide_m = ~walls & (labels != labels[0, 0])[within, within], 0.0
    for entrance_m in ENTRANCES_M:
        half2 = (entrance_m / metres_per_pixel / 2) ** 2
        labels = ndimage.label(clear2 > half2)[0]
        beside = labels != labels[0, 0]
        is_core = ((labels > 0) & beside)[within, within] & ~inside
        if not is_core.any():
            continue
        parts, _ = ndimage.label(~walls & ~inside & (_far2(beside) > half2)[within, within])
        is_room = np.bincount(parts.ravel()) * metres_per_pixel**2 >= MIN_ROOM_M2
        is_room[0] = False
        is_room &= np.bincount(parts.ravel(), is_core.ravel()) > 0
        if is_room.any():
            inside, wide_m = inside | is_room[parts], entrance_m
    return (inside, wide_m) if inside.sum() * metres_per_pixel**2 >= MIN_AREA_M2 else None


def _add_free(
    builder: BuildingBuilder, free: BoolArray, level: int, place: Path, to_m: PlanAlignment, origin_m: Sequence[float]
) -> None:
    """Adds the outlines of free pixels; row 0 of the picture is its upper edge, its lower left corner at `origin_m`."""

    def to_metres(rows: FloatArray) -> FloatArray:
        return to_m(np.column_stack([rows[:, 0], free.shape[0] - rows[:, 1]])) + origin_m

    pixels = MIN_AREA_M2 / to_m.scale**2
    free, num_parts = _without_specks(free, pixels)
    walls, num_holes = _without_specks(~free, MIN_HOLE_PIXELS + 1, np.ones((3, 3)))
    free = ~walls
    for count, what in ((num_parts, "parts of the floor"), (num_holes, "holes in it")):
        if count > MAX_PARTS:
            builder.note("picture", f"{count} {what}: all but the {MAX_PARTS} largest are left out", level)
    noise = f"{place}: its walls run to and fro as noise or a photograph does, not a plan; clean it, or scale it down"
    if sum(np.count_nonzero(np.diff(free, axis=axis)) for axis in (0, 1)) > MAX_EDGES:
        raise MapError(noise)
    polygons = [polygon for polygon in trace(free) if polygon.area * to_m.scale**2 >= MIN_AREA_M2]
    corners = np.cumsum(shapely.get_num_coordinates(polygons))
    if len(polygons) and corners[0] > MAX_CORNERS:
        raise MapError(noise)
    if left := int((corners > MAX_CORNERS).sum()):
        builder.note("picture", f"{left} parts of the floor, the smallest, are left out: too many corners", level)
        polygons = polygons[:-left]
    if not polygons:
        raise MapError(f"{place}: no free area of {MIN_AREA_M2} m²; is the picture inverted, or its scale wrong?")
    filled = shapely.union_all([shapely.Polygon(hole) for polygon in polygons for hole in polygon.interiors])
    shapely.prepare(filled)
    small = [p.area * to_m.scale**2 < MIN_ROOM_M2 and filled.contains(p) for p in polygons]
    if any(small):
        builder.note("furniture left out", f"{sum(small)} small areas inside of rooms are no rooms", level)
    for number, polygon in enumerate(p for p, is_small in zip(polygons, small, strict=True) if not is_small):
        builder.add_walkable(shapely.transform(polygon, to_metres), level, id=f"floor-{number}", walled=False)


def _without_specks(mask: BoolArray, pixels: float, beside: Any = None) -> tuple[BoolArray, int]:
    """(H, W) without the parts of fewer pixels, and without all but the largest; how many are not smaller."""
    parts, _ = ndimage.label(mask, beside)
    sizes = np.bincount(parts.ravel())
    sizes[0] = 0  # what is no part
    count = int((sizes >= pixels).sum())
    sizes[np.argsort(-sizes, kind="stable")[MAX_PARTS:]] = 0
    return (sizes >= pixels)[parts], count


def trace(mask: BoolArray) -> list[Any]:
    """shapely polygons of the true pixels of (H, W), x along rows and y along columns, pixels as units."""
    skimage = _skimage()
    padded = np.pad(mask, 1)
    contours = skimage.measure.find_contours(padded.astype(np.float64), 0.5)
    rings = [shapely.LinearRing(contour[:, ::-1] - 0.5) for contour in contours if len(contour) > 3]
    if not rings:
        return []
    lines = shapely.get_parts(shapely.make_valid(shapely.simplify(shapely.polygons(rings), SIMPLIFY_PIXELS)))
    lines = lines[shapely.get_type_id(lines) == shapely.GeometryType.POLYGON]
    # Contours are nested: an even number of others round one makes it an outline, an odd number a hole.
    lines = lines[np.argsort(-shapely.area(lines), kind="stable")]
    outer, inner = shapely.STRtree(shapely.point_on_surface(lines)).query(lines, predicate="contains")
    outer, inner = outer[outer < inner], inner[outer < inner]
    depth = np.bincount(inner, minlength=len(lines))
    is_hole = (depth[inner] == depth[outer] + 1) & (shapely.area(lines[inner]) > MIN_HOLE_PIXELS)
    holes = {int(i): lines[inner[is_hole & (outer == i)]] for i in np.unique(outer[is_hole])}
    found = []
    for i in np.flatnonzero(depth % 2 == 0).tolist():
        rest = shapely.difference(lines[i], shapely.union_all(holes[i])) if i in holes else lines[i]
        found += [part for part in shapely.get_parts(rest) if part.geom_type == "Polygon" and part.area > 0]
    return found


def sniff(head: Head) -> bool:
    """True for a TOML file that names pictures, and for a picture, also those of lines, which are refused."""
    if head.path.suffix == ".toml":
        return b"metres_per_pixel" in head.content
    return head.content.startswith(_MAGIC) or (head.content.startswith(b"RIFF") and head.content[8:12] == b"WEBP")


_DRAWINGS: Final = (b"%PDF", b"<svg", b"<?xml")
_MAGIC: Final = (b"\x89PNG", b"\xff\xd8\xff", b"BM", b"GIF8", b"II*\0", b"MM\0*", b"%PDF", b"<svg")
READER: Final = Reader(read, sniff)


# ROS map_server.

UNKNOWN_GREY: Final = 205  # map_saver of ROS 1 and 2


class RosMap(msgspec.Struct):
    """The fields of the YAML file of map_server."""

    image: str
    resolution: float
    origin: tuple[float, float, float]
    negate: bool | int = 0
    occupied_thresh: float = 0.65
    free_thresh: float = 0.196
    mode: str = "trinary"


def read_ros(path: Path | str, *, strict: bool = False) -> Plan:
    """Reads the YAML file and the picture that it names.

    Raises:
        MapError: Names file and remedy.
    """
    path = Path(path)
    fields = _flat_yaml(files.member(files.opened(path), path.name).decode(errors="replace"), path)
    try:
        ros = msgspec.convert(fields, RosMap, strict=False)
    except msgspec.ValidationError as error:
        raise MapError(f"{path}: {error}; a map needs image, resolution and origin") from error
    if not 1e-4 < ros.resolution < 10:
        raise MapError(f"{path}: resolution is {ros.resolution:g}; expected metres a pixel")
    if not np.isfinite(ros.origin).all():
        raise MapError(f"{path}: origin is {list(ros.origin)}; expected x and y in metres and a turn in radians")
    pixels, levels = _grey(files.beside(path, ros.image)), np.arange(256) / 255.0
    occupied = levels if ros.negate else 1.0 - levels
    free = occupied < ros.free_thresh
    if ros.mode == "trinary":  # map_saver marks unknown cells so, also where free_thresh would take them for free
        free[UNKNOWN_GREY] = False
    builder = BuildingBuilder(path.stem, strict=strict).add_level(0)
    unknown = int((~free & (occupied <= ros.occupied_thresh))[pixels].sum())
    if unknown:
        builder.note("unknown cells", f"{unknown} of {pixels.size} cells are unknown: taken for wall", 0)
    cells, step = _thinned(free[pixels], builder, 0)
    _add_free(builder, cells, 0, path, PlanAlignment(ros.origin[2], ros.resolution * step), ros.origin[:2])
    return finished(builder, "ros_map")


def _flat_yaml(text: str, path: Path) -> dict[str, Any]:
    """Fields of a YAML file that is as flat as those of map_server are: no anchors, nothing nested."""
    fields: dict[str, Any] = {}
    lines = [line.partition("#")[0].rstrip() for line in text.splitlines()]
    for number, line in enumerate(lines, start=1):
        if not line or line in ("---", "..."):
            continue
        key, colon, value = line.partition(":")
        if line.startswith("- ") and fields:  # a list over several lines
            fields[list(fields)[-1]] = [*(fields[list(fields)[-1]] or []), line[2:].strip()]
            continue
        if not colon or line[0].isspace() or "&" in value or "*" in value:
            raise MapError(f"{path}: line {number}: expected `name: value`; got {line[:60]!r}")
        value = value.strip().strip("\"'")
        is_list = value.startswith("[") and value.endswith("]")
        fields[key.strip()] = [part.strip() for part in value[1:-1].split(",")] if is_list else value
    return fields


def sniff_ros(head: Head) -> bool:
    """True for YAML with `image`, `resolution` and `origin`."""
    keys = (b"image:", b"resolution:", b"origin:")
    return head.path.suffix in (".yaml", ".yml") and all(key in head.content for key in keys)


ROS: Final = Reader(read_ros, sniff_ros)
