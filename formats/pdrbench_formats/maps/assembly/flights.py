"""Treads for the outline of a stair: where landings and treads lie, and how high each of them is.

A plan usually draws a stair as one polygon on each level. Treads are laid out in the frame of that polygon: u across, v
along; for a stair that turns about a centre, u is the radius and v the arc. Two forms are tried in all directions: a
straight flight from one end to the other, and two parallel flights with a landing half way, back to the same end. The
one with the deepest treads is taken.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
import shapely

from pdrbench.building.polygons import signed_area_m2
from pdrbench.geometry import FloatArray

RISER_M: Final = 0.17  # usual height of a riser
TREAD_M: Final = 0.29  # usual depth of a tread
MIN_TREAD_M: Final = 0.12  # less deep treads are not laid out
GOOD_TREAD_M: Final = 0.24  # where treads would be less deep, there are fewer of them
MIN_LANDING_M: Final = 0.8
HALF_LANDING_M: Final = 1.2
MIN_ACCESS_M: Final = 0.5  # length of the way in that has to lie at a landing
MIN_FLIGHT_WIDTH_M: Final = 0.5
MAX_SECTOR_RMS_M: Final = 0.1
MAX_RECTANGLE_FILL: Final = 0.8  # an outline that fills less of its rectangle may turn about a centre

Form = Literal["straight", "half_turn"]


@dataclass(frozen=True, slots=True)
class StairFrame:
    """Coordinates across (u) and along (v) a stair, metres.

    Attributes:
        origin: (2,) of u and v; of a stair that turns, its centre.
        along: (2,) unit vector of v; of a stair that turns, towards v = 0.
        radius_m: Mean radius of a stair that turns; 0 of a straight one.
    """

    origin: FloatArray
    along: FloatArray
    radius_m: float = 0.0

    def to_uv(self, xy_m: FloatArray) -> FloatArray:
        """(N, 2) across and along, of places (N, 2) in metres."""
        off = np.asarray(xy_m) - self.origin
        ahead, left = off @ self.along, off @ np.array([-self.along[1], self.along[0]])
        if not self.radius_m:
            return np.column_stack([-left, ahead])
        return np.column_stack([np.hypot(ahead, left), self.radius_m * np.arctan2(left, ahead)])

    def to_xy(self, uv_m: FloatArray) -> FloatArray:
        """(N, 2) the inverse of `to_uv`."""
        u, v = np.asarray(uv_m, dtype=np.float64).T
        if self.radius_m:
            ahead, left = u * np.cos(v / self.radius_m), u * np.sin(v / self.radius_m)
        else:
            ahead, left = v, -u
        across = np.array([-self.along[1], self.along[0]])
        xy_m: FloatArray = self.origin + ahead[:, None] * self.along + left[:, None] * across
        return xy_m


@dataclass(frozen=True, slots=True)
class StairLayout:
    """Where landings and flights of a stair lie in its frame.

    Attributes:
        frame: Coordinates.
        form: "straight", or "half_turn" with two flights and a landing half way.
        core: shapely polygon in (u, v): the outline that all levels share.
        near_m: Flights begin at this v.
        far_m: Flights end at this v.
        num_risers: From a level to the next, by index of the lower one.
        tread_m: Least depth of a tread.
        comfort: 1 for usual treads and landings that reach all of the way in, towards 0 the steeper it is.
    """

    frame: StairFrame
    form: Form
    core: Any
    near_m: float
    far_m: float
    num_risers: tuple[int, ...]
    tread_m: float
    comfort: float

    def chord(self, v_m: float) -> tuple[float, float] | None:
        """Lowest and highest u of the longest piece of the outline at a v; None where there is none."""
        x0, _, x1, _ = self.core.bounds
        line = shapely.intersection(self.core, shapely.LineString([(x0 - 1, v_m), (x1 + 1, v_m)]))
        pieces = [piece for piece in shapely.get_parts(line) if piece.geom_type == "LineString"]
        if not pieces:
            return None
        longest = max(pieces, key=shapely.length)
        low, _, high, _ = longest.bounds
        return low, high


@dataclass(frozen=True, slots=True)
class Tread:
    """A tread or a landing half way, before it becomes a floor polygon.

    Attributes:
        ring_xy_m: (K, 2) counter-clockwise.
        before: Numbers of the edges that lead to the tread before, or, of the first one, to the landing below.
        after: To the tread after, or to the landing above.
        height_m: Above level 0.
        is_upper: Whether it belongs to the upper level.
    """

    ring_xy_m: FloatArray
    before: int
    after: int
    height_m: float
    is_upper: bool


def frames_of(core: Any) -> Iterator[StairFrame]:
    """Frames to try: the rectangle round the outline in four directions, or its centre where it turns about one."""
    rectangle = shapely.oriented_envelope(core)
    if rectangle.geom_type != "Polygon":
        return
    if core.area < MAX_RECTANGLE_FILL * rectangle.area:
        yield from _sector_frames(core)
    corners = shapely.get_coordinates(shapely.orient_polygons(rectangle))[:4]
    for k in range(4):
        side = corners[(k + 1) % 4] - corners[k]
        if np.hypot(*side) > 0:
            yield StairFrame(corners[k], side / np.hypot(*side))


def _sector_frames(core: Any) -> Iterator[StairFrame]:
    """Frames of a sector of a ring: a circle through the part of its outline that lies on its convex hull."""
    hull = shapely.get_coordinates(core.convex_hull)[:-1]
    hull = hull[np.hypot(*(hull - np.roll(hull, 1, axis=0)).T) > 1e-6]
    if len(hull) < 6:
        return
    on_circle = _on_one_circle(hull)
    if len(on_circle) < 5:
        return
    centre = _circle_centre(on_circle)
    radius = np.hypot(*(on_circle - centre).T)
    if radius.std() > MAX_SECTOR_RMS_M or core.covers(shapely.Point(*centre)):
        return
    points = shapely.get_coordinates(core)[:-1] - centre
    middle = np.arctan2(*points.mean(axis=0)[::-1])
    turn = (np.arctan2(points[:, 1], points[:, 0]) - middle + np.pi) % (2 * np.pi) - np.pi
    mean_m = float((np.hypot(*points.T).min() + np.hypot(*points.T).max()) / 2)
    if turn.max() - turn.min() < math.pi * 1.5:
        first = middle + turn.min()
        yield StairFrame(centre, np.array([math.cos(first), math.sin(first)]), mean_m)


def _on_one_circle(hull: FloatArray) -> FloatArray:
    """(N, 2) most points of a hull that lie on one circle: those of the ends of a sector do not."""
    some = hull[np.linspace(0, len(hull) - 1, min(len(hull), 16)).astype(int)]
    best = hull[:0]
    for triple in itertools.combinations(some, 3):
        centre = _circle_centre(np.array(triple))
        radius_m = np.hypot(*(hull - centre).T)
        near = hull[np.abs(radius_m - np.hypot(*(triple[0] - centre))) <= MAX_SECTOR_RMS_M / 2]
        if len(near) > len(best) and radius_m.max() < 20.0:
            best = near
    return best


def _circle_centre(points: FloatArray) -> FloatArray:
    """(2,) centre of the circle of least squares (Kasa 1976)."""
    middle = points.mean(axis=0)
    x, y = (points - middle).T
    solution = np.linalg.lstsq(np.column_stack([x, y, np.ones(len(x))]), x * x + y * y, rcond=None)[0]
    centre: FloatArray = middle + solution[:2] / 2
    return centre


def lay_out(
    core: Any,
    accesses: Sequence[Any],
    heights_m: Sequence[float],
    *,
    straight_only: bool = False,
    up: tuple[float, float] | None = None,
) -> StairLayout | None:
    """The layout with the deepest treads, or None where none has room.

    Args:
        core: shapely polygon that the outlines on all levels share, metres.
        accesses: Of each level, lowest first: shapely lines where the outline is open.
        heights_m: Of each level.
        straight_only: Leave out flights that turn back, as for an escalator.
        up: Direction (x, y) in which a straight flight leads up; None for either.
    """
    found: list[StairLayout] = []
    for frame in frames_of(core):
        local = shapely.transform(core, frame.to_uv)
        if not local.is_valid:
            continue
        _, low, _, high = local.bounds
        profiles = [_profile(access, frame) for access in accesses]
        forms: tuple[Form, ...] = ("straight",) if straight_only else ("straight", "half_turn")
        if up is not None and not frame.radius_m and frame.along @ np.array(up) < 0.5 * math.hypot(*up):
            forms = forms[1:]
        for form, access_m in itertools.product(forms, (MIN_ACCESS_M, math.inf)):
            layout = _fit(frame, form, local, (low, high), profiles, heights_m, access_m)
            if layout is not None:
                found.append(layout)
    # A sector is never cut by straight lines where it can be cut by rays.
    return max(found, key=lambda layout: (layout.frame.radius_m > 0, layout.comfort), default=None)


def _profile(access: Any, frame: StairFrame) -> FloatArray:
    """(N,) v of points every few centimetres of the way in, ascending."""
    points = shapely.get_coordinates(shapely.segmentize(access, 0.05))
    return np.sort(frame.to_uv(points)[:, 1]) if len(points) else np.zeros(0)


def _landing_m(profiles: Sequence[FloatArray], low: float, access_m: float) -> float:
    """Depth of a landing from the end `low` that reaches so much of the way in of each level, or all of it."""
    needed = [profile[int(min(len(profile) - 1, access_m / 0.05))] - low for profile in profiles if len(profile)]
    return float(max([MIN_LANDING_M, *needed]))


def _fit(
    frame: StairFrame,
    form: Form,
    core: Any,
    span: tuple[float, float],
    profiles: Sequence[FloatArray],
    heights_m: Sequence[float],
    access_m: float,
) -> StairLayout | None:
    low, high = span
    rises_m = np.diff(heights_m)
    if form == "straight":
        near = low + _landing_m(profiles[:-1], low, access_m)
        far = high - _landing_m([-profile[::-1] for profile in profiles[1:]], -high, access_m)
        lanes, width = 1, MIN_FLIGHT_WIDTH_M
    else:
        near = low + _landing_m(profiles, low, access_m)
        half_m = min(HALF_LANDING_M, max(MIN_LANDING_M, (high - near) / 3))
        far, lanes, width = high - half_m, 2, 2 * MIN_FLIGHT_WIDTH_M
    length = far - near
    if length < 3 * MIN_TREAD_M:
        return None
    risers: list[int] = []
    depth = math.inf
    for rise_m in rises_m:
        count = max(2, round(rise_m / RISER_M))
        count = max(2, min(count, lanes * (1 + int(length / GOOD_TREAD_M))))
        count += count % 2 if lanes == 2 else 0
        risers.append(count)
        depth = min(depth, length / max(1, count // lanes - 1))
    if depth > TREAD_M:  # the rest goes to the landing
        extra = length - TREAD_M * max(1, max(risers) // lanes - 1)
        near, far = (near + extra / 2, far - extra / 2) if form == "straight" else (near + extra, far)
        depth = TREAD_M
    riser_m = max(rise / count for rise, count in zip(rises_m, risers, strict=True))
    comfort = min(depth / TREAD_M, 1.0) * min(RISER_M / riser_m, 1.0) * (1.0 if access_m > 1e6 else 0.8)
    layout = StairLayout(frame, form, core, near, far, tuple(risers), depth, comfort)
    chords = [layout.chord(v) for v in np.linspace(near, far, 9)]
    if depth < MIN_TREAD_M or any(chord is None or chord[1] - chord[0] < width for chord in chords):
        return None
    return layout


Edge = tuple[FloatArray, FloatArray]


def flight_of(
    layout: StairLayout, number: int, heights_m: tuple[float, float], below: Edge, above: Edge
) -> list[Tread]:
    """Treads from one level to the next.

    Args:
        layout: Of the stair.
        number: Index of the lower level in the layout.
        heights_m: Of both levels.
        below: Edge of the landing below that leads to the flight, in the direction of that landing's outline.
        above: The same of the landing above.

    Returns:
        Lowest first; none where the outline has a gap that they would have to cross.
    """
    risers = layout.num_risers[number]
    riser_m = (heights_m[1] - heights_m[0]) / risers
    make = _straight if layout.form == "straight" else _half_turn
    rings = make(layout, risers, below, above)
    return [
        Tread(ring, before, after, heights_m[0] + (k + 1) * riser_m, k + 1 > risers / 2)
        for k, (ring, before, after) in enumerate(rings)
    ]


_Ring = tuple[FloatArray, int, int]


def _straight(layout: StairLayout, risers: int, below: Edge, above: Edge) -> list[_Ring]:
    cuts = _cuts(layout, np.linspace(layout.near_m, layout.far_m, risers), None)
    if not cuts:
        return []
    cuts[0], cuts[-1] = _aligned(cuts[0], below), _aligned(cuts[-1], above)
    return [_quad(a, b) for a, b in itertools.pairwise(cuts)]


def _half_turn(layout: StairLayout, risers: int, below: Edge, above: Edge) -> list[_Ring]:
    v_m = np.linspace(layout.near_m, layout.far_m, risers // 2)
    up, down = _cuts(layout, v_m, 0), _cuts(layout, v_m, 1)
    _, _, _, high = layout.core.bounds
    end = layout.chord(high - 0.02) or layout.chord((layout.far_m + high) / 2)
    if not up or end is None:
        return []
    up[0], down[0] = _aligned(up[0], below), _aligned(down[0], above)
    rings = [_quad(a, b) for a, b in itertools.pairwise(up)]
    left, middle = up[-1]
    right = down[-1][1]
    far = layout.frame.to_xy(np.array([[end[0], high - 0.02], [end[1], high - 0.02]]))
    half = np.array([left, middle, right, far[1], far[0]])
    rings.append((half, 0, 1) if signed_area_m2(half) > 0 else (half[::-1].copy(), 3, 2))
    back = [_quad(a, b) for a, b in itertools.pairwise(down)]
    return rings + [(ring, after, before) for ring, before, after in reversed(back)]


def _cuts(layout: StairLayout, v_m: FloatArray, lane: int | None) -> list[Edge]:
    """Lines between treads; of the lane with lower u (0), with higher u (1), or all across; [] over a gap."""
    cuts = []
    for v in v_m:
        chord = layout.chord(float(v))
        if chord is None:
            return []
        low, high = chord
        ends = {None: (low, high), 0: (low, (low + high) / 2), 1: ((low + high) / 2, high)}[lane]
        first, last = layout.frame.to_xy(np.array([[ends[0], v], [ends[1], v]]))
        cuts.append((first, last))
    return cuts


def _aligned(cut: Edge, edge: Edge) -> Edge:
    """The edge of a landing, in the direction of a cut."""
    forward = np.hypot(*(cut[0] - edge[0])) + np.hypot(*(cut[1] - edge[1]))
    return edge if forward <= np.hypot(*(cut[0] - edge[1])) + np.hypot(*(cut[1] - edge[0])) else (edge[1], edge[0])


def _quad(a: Edge, b: Edge) -> _Ring:
    """The tread between two cuts, counter-clockwise, and the numbers of its edges along them."""
    ring = np.array([a[0], a[1], b[1], b[0]])
    return (ring, 0, 2) if signed_area_m2(ring) > 0 else (ring[::-1].copy(), 2, 0)


def parts_on_level(layout: StairLayout, outline: Any, *, leaves: bool, arrives: bool) -> Mapping[str, Any]:
    """Landings and what flights take of an outline on one level, as shapely geometries by name.

    Args:
        layout: Of the stair.
        outline: On this level.
        leaves: Whether a flight leads up from here.
        arrives: Whether one arrives from below.

    Returns:
        "landing" and, of a straight stair between two others, "upper landing"; "up" and "down" are taken by flights.
    """
    local = shapely.transform(outline, layout.frame.to_uv)
    x0, y0, x1, y1 = shapely.union_all([local, layout.core]).bounds
    taken = shapely.intersection(layout.core, shapely.box(x0, layout.near_m, x1, layout.far_m))

    def band(low: float, high: float) -> Any:
        return shapely.intersection(local, shapely.box(x0 - 1, low, x1 + 1, high))

    parts: dict[str, Any] = {}
    if layout.form == "straight":
        if leaves:
            parts["landing"], parts["up"] = band(y0 - 1, layout.near_m), taken
        if arrives:
            parts["upper landing" if leaves else "landing"] = band(layout.far_m, y1 + 1)
            parts["up" if leaves else "down"] = taken
    else:
        parts["landing"] = band(y0 - 1, layout.near_m)
        chord = layout.chord(layout.near_m)
        assert chord is not None
        middle = sum(chord) / 2
        parts["up"] = shapely.intersection(taken, shapely.box(x0 - 1, y0 - 1, middle, y1 + 1))
        parts["down"] = shapely.intersection(taken, shapely.box(middle, y0 - 1, x1 + 1, y1 + 1))
    return {name: shapely.transform(part, layout.frame.to_xy) for name, part in parts.items()}
