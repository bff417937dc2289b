"""Procedural shopping centres: wide concourses round islands of shops, shop fronts, voids, entrances.

A loop of concourses lies inside four rows of shops. More concourses cut what the loop encloses into islands, two rows
of shops back to back or one large shop. The widest crossing is the atrium; on upper levels its middle is a void. Levels
share concourses and stairwells and have shops of their own. Service passages lead from the loop behind the shops.
Walls have no thickness, neighbours share a line; those of passages are thick, as round any way of escape.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.errors import MapError
from pdrbench_sim.buildings.assembly import Cell, Draft, Pose, Ring, Span, mm, rectangle
from pdrbench_sim.buildings.stairwell import StairParams, StairPlace, StairSize, add_stairwell, draw_stair

MIN_LEVEL_M2: Final = 7000.0  # four rows of shops, the loop and one island need about this
MAX_ASPECT: Final = 2.0  # a plan that would be longer has one more concourse along it; ours
_MAX_BANDS: Final = 12
STAIR_DOOR_M: Final = 1.2  # wide enough for two; ours
_MIN_ISLAND_M: Final = 10.0  # long; a smaller one is a kiosk
_MIN_FRONT_M: Final = 4.0  # that a passage leaves of a shop; ours


@dataclass(frozen=True, slots=True)
class MallParams:
    """Sizes of what a shopping centre is made of; pairs are ranges of a uniform draw.

    [M]: read off the plans of site 1 of the Indoor Location Competition 2.0, whose concourses measure 6 to 15 m across
    and whose shops measure 4 to 280 m2 (5 to 95 %) with some above 600 m2.
    """

    concourse_width_m: tuple[float, float] = (7.0, 13.0)  # [M]
    crossing_width_m: tuple[float, float] = (6.0, 10.0)  # [M]
    atrium_width_m: tuple[float, float] = (13.0, 17.0)  # [M]
    rail_m: float = 3.5  # of floor left on each side of the void; ours
    shop_depth_m: tuple[float, float] = (9.0, 15.0)  # [M]
    shop_width_m: tuple[float, float] = (5.0, 13.0)  # [M]
    large_width_m: tuple[float, float] = (18.0, 30.0)  # [M]
    large_fraction: float = 0.15  # of the draws of a width; [M]
    island_depth_m: tuple[float, float] = (18.0, 30.0)  # [M]
    island_length_m: tuple[float, float] = (28.0, 50.0)  # [M]
    one_shop_fraction: float = 0.3  # of the islands are one large shop; [M]
    open_front_fraction: float = 0.4  # of the shops have no front at all; ours
    front_door_m: tuple[float, float] = (1.6, 3.0)  # in the glass of the others; ours
    entrance_width_m: tuple[float, float] = (5.0, 8.0)  # [M]
    passage_every_m: float = 50.0  # of shop fronts along the loop; [M] about ten passages on a level of site 1
    passage_width_m: tuple[float, float] = (2.2, 3.6)  # [M]
    passage_wall_m: float = 0.2  # masonry that fire has to stop; ours
    passage_long_fraction: float = 0.5  # of the passages go on behind a second shop; [M] they are 10 to 30 m long
    level_height_m: tuple[float, float] = (4.6, 5.4)  # about the 5 m that are assumed for recorded malls; ours
    stairs: StairParams = field(default_factory=StairParams)


@dataclass(frozen=True, slots=True)
class _ShopRow:
    """A strip of shops along one concourse."""

    id: str  # unique in a level
    pose: Pose  # u runs along the fronts, v away from the concourse
    span: Span  # part of the u axis that the row takes
    front: Span  # part of it that faces the concourse
    depth_m: float  # of the shops
    gap: Span  # what a stairwell or an entrance takes, where there is one
    is_entrance: bool  # which of the two


@dataclass(frozen=True, slots=True)
class _Passage:
    """A way from the concourse along a shop and on behind it, in the frame of its row."""

    u: Span  # of the part along the shop
    end_m: float  # where the part behind the shops ends, along u
    first: int  # number of the shop
    last: int  # number of the last shop that it leads behind


@dataclass(frozen=True, slots=True)
class _MallFrame:
    """What all levels share."""

    loop: Ring
    islands: tuple[Ring, ...]
    is_one_shop: tuple[bool, ...]
    void: Ring
    rows: tuple[_ShopRow, ...]
    stair: StairSize
    level_height_m: float


def make_mall(
    rng: np.random.Generator,
    *,
    num_levels: int = 1,
    area_m2: float = 12000.0,
    name: str = "mall",
    params: MallParams | None = None,
) -> Building:
    """Draws a shopping centre.

    Args:
        rng: Two buildings from generators in the same state are equal byte for byte.
        num_levels: Levels 0 to num_levels - 1, at least 1, joined by stairwells where there are several.
        area_m2: Of the outline, all levels together: concourse, shops, passages with their walls, voids and stairs. The
            two upper levels of site 1 have about 11 000 m2 each, its basement 29 000 m2.
        name: Name of the building.
        params: Sizes; None for the defaults.

    Returns:
        A building whose zones are its shops, its concourse and its passages; walks of visitors begin and end in the
        concourse.

    Raises:
        MapError: The area is too small for concourses round an island.
    """
    params = params or MallParams()
    if num_levels < 1:
        raise MapError(f"a mall has at least 1 level; got num_levels={num_levels}")
    if not MIN_LEVEL_M2 <= area_m2 / num_levels < np.inf:
        raise MapError(
            f"a mall needs {MIN_LEVEL_M2:g} m2 per level; got {area_m2 / num_levels:.0f} m2: "
            f"ask for more area or fewer levels"
        )
    frame_rng, *level_rngs = rng.spawn(num_levels + 1)
    frame = _draw_frame(frame_rng, area_m2 / num_levels, params)
    draft = Draft()
    for level, level_rng in enumerate(level_rngs):
        _add_level(level_rng, draft, frame, level, num_levels, params)
    return draft.building(name, ("shop", "concourse", "passage"))


# The frame: loop, crossings, islands, rows.


def _draw_frame(rng: np.random.Generator, area_m2: float, params: MallParams) -> _MallFrame:
    north_m, south_m, west_m, east_m = (mm(rng.uniform(*params.shop_depth_m)) for _ in range(4))
    west_way_m, east_way_m = (mm(rng.uniform(*params.concourse_width_m)) for _ in range(2))
    bands, loop_y = _draw_bands(rng, south_m, area_m2, params)
    width_m = mm(loop_y.high + north_m)
    length_m = mm(area_m2 / width_m)
    loop = Span(west_m, mm(length_m - east_m)), loop_y
    inner = Span(mm(loop[0].low + west_way_m), mm(loop[0].high - east_way_m))
    drawn = [_draw_islands(rng, inner, band, params) for band in bands]
    islands = [island for band_islands, _ in drawn for island in band_islands]
    void = drawn[len(drawn) // 2][1]
    level_height_m = mm(rng.uniform(*params.level_height_m))
    stair = draw_stair(rng, level_height_m, params.stairs)
    whole = Span(0.0, length_m)
    stairs_m, door_m = (stair.width_m, stair.width_m), params.entrance_width_m
    south, north = Pose((0.0, south_m), across=(0.0, -1.0)), Pose((0.0, loop[1].high))
    west, east = Pose((west_m, 0.0), (0.0, 1.0), (-1.0, 0.0)), Pose((loop[0].high, 0.0), (0.0, 1.0), (1.0, 0.0))
    rows = (
        _ShopRow("south", south, whole, loop[0], south_m, _draw_gap(rng, loop[0], stairs_m), is_entrance=False),
        _ShopRow("north", north, whole, loop[0], north_m, _draw_gap(rng, loop[0], stairs_m), is_entrance=False),
        _ShopRow("west", west, loop[1], loop[1], west_m, _draw_gap(rng, loop[1], door_m), is_entrance=True),
        _ShopRow("east", east, loop[1], loop[1], east_m, _draw_gap(rng, loop[1], door_m), is_entrance=True),
    )
    is_one_shop = tuple(bool(rng.random() < params.one_shop_fraction) for _ in islands)
    return _MallFrame(
        loop=rectangle(loop[0].low, loop[1].low, loop[0].high, loop[1].high),
        islands=tuple(islands),
        is_one_shop=is_one_shop,
        void=void,
        rows=rows,
        stair=stair,
        level_height_m=level_height_m,
    )


def _draw_bands(
    rng: np.random.Generator, south_m: float, area_m2: float, params: MallParams
) -> tuple[list[Span], Span]:
    """Where the islands lie along y, as many one above the other as a compact plan needs; and the loop round them."""
    widths_m = rng.uniform(*params.concourse_width_m, size=_MAX_BANDS + 1)
    depths_m = rng.uniform(*params.island_depth_m, size=_MAX_BANDS)
    bands: list[Span] = []
    y_m = mm(south_m + widths_m[0])
    for width_m, depth_m in zip(widths_m[1:], depths_m, strict=True):
        bands.append(Span(y_m, mm(y_m + depth_m)))
        y_m = mm(bands[-1].high + width_m)
        if (y_m + south_m) ** 2 * MAX_ASPECT > area_m2:
            break
    return bands, Span(south_m, y_m)


def _draw_islands(rng: np.random.Generator, x: Span, y: Span, params: MallParams) -> tuple[list[Ring], Ring]:
    """Islands between x.low and x.high, and the void of the atrium, which is the crossing nearest to the middle."""
    most = int((x.length + params.atrium_width_m[1]) / (_MIN_ISLAND_M + params.atrium_width_m[1]))
    count = min(most, max(2, round(x.length / rng.uniform(*params.island_length_m))))
    if count < 2:
        raise MapError("no two islands fit between the concourses; ask for more area")
    widths_m = [rng.uniform(*params.crossing_width_m) for _ in range(count - 1)]
    atrium = int(np.argmin(np.abs(np.arange(count - 1) - (count - 2) / 2)))
    widths_m[atrium] = rng.uniform(*params.atrium_width_m)
    fraction = rng.uniform(0.7, 1.3, count)
    left_m = x.length - sum(widths_m)
    if left_m < count * _MIN_ISLAND_M:
        raise MapError("no two islands fit between the concourses; ask for more area")
    lengths_m = (x.length - sum(widths_m)) * fraction / fraction.sum()
    islands, void, at_m = [], Span(0.0, 0.0), x.low
    for number, length_m in enumerate(lengths_m):
        end_m = x.high if number == count - 1 else mm(at_m + length_m)
        islands.append(rectangle(at_m, y.low, end_m, y.high))
        if number < count - 1:
            at_m = mm(end_m + widths_m[number])
            if number == atrium:
                void = Span(mm(end_m + params.rail_m), mm(at_m - params.rail_m))
    return islands, rectangle(void.low, mm(y.low + params.rail_m), void.high, mm(y.high - params.rail_m))


def _draw_gap(rng: np.random.Generator, front: Span, width_m: tuple[float, float]) -> Span:
    """A piece near the middle of a front."""
    wide_m = mm(rng.uniform(*width_m))
    low_m = mm(front.low + (front.length - wide_m) * rng.uniform(0.35, 0.65))
    return Span(low_m, mm(low_m + wide_m))


# Levels: the concourse, shops along it, stairwells and entrances.


def _add_level(
    rng: np.random.Generator, draft: Draft, frame: _MallFrame, level: int, num_levels: int, params: MallParams
) -> None:
    height_m = level * frame.level_height_m
    concourse = f"{level}/concourse"
    passage_rng = rng.spawn(1)[0]
    holes = [ring[::-1] for ring in frame.islands] + ([frame.void[::-1]] if level > 0 else [])
    draft.cells.append(Cell(concourse, frame.loop, height_m, level, use="concourse", holes=holes))

    def add_shop(shop: str, ring: Ring, fronts: list[tuple[Pose, Span]]) -> None:
        draft.cells.append(Cell(shop, ring, height_m, level, use="shop"))
        for pose, front in fronts:
            draft.join(concourse, shop, pose, _draw_opening(rng, front, params), 0.0)

    for row in frame.rows:
        strips = [row.span]
        if level == 0 if row.is_entrance else num_levels > 1:
            strips = [Span(row.span.low, row.gap.low), Span(row.gap.high, row.span.high)]
            _add_gap(draft, frame, row, level, num_levels)
        first = 0
        for strip in strips:
            shops = _split(rng, strip, row.front, params)
            passages = _draw_passages(passage_rng, shops, row.front, params)
            for passage in passages:
                name = f"{level}/passage-{row.id}-{first + passage.first:02d}"
                draft.cells.append(Cell(name, _passage_ring(row, passage), height_m, level, use="passage"))
                draft.join(concourse, name, row.pose, passage.u, 0.0)
            for number, span in enumerate(shops):
                left, depth_m = _beside_passages(number, span, row.depth_m, passages, params)
                front = Span(max(left.low, row.front.low), min(left.high, row.front.high))
                ring = row.pose.rectangle(left, Span(0.0, depth_m))
                add_shop(f"{level}/shop-{row.id}-{first + number:02d}", ring, [(row.pose, front)])
            first += len(shops)
    for number, (ring, is_one_shop) in enumerate(zip(frame.islands, frame.is_one_shop, strict=True)):
        name, (south, north) = f"{level}/shop-island-{number}", _island_poses(ring)
        span, depth_m = Span(ring[0][0], ring[1][0]), ring[2][1] - ring[1][1]
        if is_one_shop:
            add_shop(name, ring, [(south, span), (north, span)])
            continue
        back_m = mm(depth_m * rng.uniform(0.4, 0.6))
        for side, pose, deep_m in (("s", south, back_m), ("n", north, mm(depth_m - back_m))):
            for shop, part in enumerate(_split(rng, span, span, params)):
                add_shop(f"{name}{side}-{shop:02d}", pose.rectangle(part, Span(0.0, deep_m)), [(pose, part)])


def _island_poses(ring: Ring) -> tuple[Pose, Pose]:
    """Frames of the shops that face south and north."""
    return Pose((0.0, ring[0][1])), Pose((0.0, ring[2][1]), across=(0.0, -1.0))


def _split(rng: np.random.Generator, strip: Span, front: Span, params: MallParams) -> list[Span]:
    """Shops of a strip; those at its ends reach past the corner of the concourse by the width of a shop."""
    low_m, high_m = max(strip.low, front.low), min(strip.high, front.high)
    widths_m: list[float] = []
    while sum(widths_m) < high_m - low_m:
        is_large = rng.random() < params.large_fraction
        widths_m.append(rng.uniform(*(params.large_width_m if is_large else params.shop_width_m)))
    if len(widths_m) > 1 and sum(widths_m) - (high_m - low_m) > widths_m[-1] / 2:
        widths_m.pop()  # whichever number of shops needs less of a change
    cuts_m = low_m + np.cumsum(widths_m)[:-1] * (high_m - low_m) / sum(widths_m)
    ends_m = [strip.low, *(mm(cut) for cut in cuts_m), strip.high]
    return [Span(low, high) for low, high in itertools.pairwise(ends_m)]


def _draw_passages(rng: np.random.Generator, shops: Sequence[Span], front: Span, params: MallParams) -> list[_Passage]:
    """Passages beside some of the shops of a strip, but not in its corners."""
    passages: list[_Passage] = []
    for number, span in enumerate(shops):
        width_m = mm(rng.uniform(*params.passage_width_m))
        is_wanted, is_long = rng.random(2) < (span.length / params.passage_every_m, params.passage_long_fraction)
        is_taken = bool(passages) and number <= passages[-1].last
        walled_m = width_m + 2 * params.passage_wall_m
        is_inside = front.low <= span.low - walled_m and span.high <= front.high
        if not is_wanted or is_taken or not is_inside or span.length < walled_m + _MIN_FRONT_M:
            continue
        last = number
        if is_long and number + 1 < len(shops) and shops[number + 1].high <= front.high:
            last += 1
        low_m = mm(span.low + params.passage_wall_m)
        end_m = mm(shops[last].high - params.passage_wall_m)
        passages.append(_Passage(Span(low_m, mm(low_m + width_m)), end_m, number, last))
    return passages


def _passage_ring(row: _ShopRow, passage: _Passage) -> Ring:
    """Counter-clockwise."""
    low_m, high_m = passage.u
    back_m = mm(row.depth_m - passage.u.length)
    corners = (
        (low_m, 0.0),
        (high_m, 0.0),
        (high_m, back_m),
        (passage.end_m, back_m),
        (passage.end_m, row.depth_m),
        (low_m, row.depth_m),
    )
    ring = [row.pose.point(*corner) for corner in corners]
    (along_x, along_y), (across_x, across_y) = row.pose.along, row.pose.across
    return ring if along_x * across_y > along_y * across_x else ring[::-1]


def _beside_passages(
    number: int, span: Span, depth_m: float, passages: Sequence[_Passage], params: MallParams
) -> tuple[Span, float]:
    """What passages leave of a shop: its part of the strip and its depth."""
    for passage in passages:
        if passage.first <= number <= passage.last:
            low_m = mm(passage.u.high + params.passage_wall_m) if number == passage.first else span.low
            return Span(low_m, span.high), mm(depth_m - passage.u.length - params.passage_wall_m)
    return span, depth_m


def _draw_opening(rng: np.random.Generator, front: Span, params: MallParams) -> Span:
    """The part of a front that people pass: nearly all of it, or a door somewhere in the glass."""
    if rng.random() < params.open_front_fraction:
        return Span(mm(front.low + 0.3), mm(front.high - 0.3))
    width_m = min(rng.uniform(*params.front_door_m), front.length - 0.6)
    low_m = mm(front.low + 0.3 + rng.random() * (front.length - width_m - 0.6))
    return Span(low_m, mm(low_m + width_m))


def _add_gap(draft: Draft, frame: _MallFrame, row: _ShopRow, level: int, num_levels: int) -> None:
    """A stairwell with its door, or an entrance as wide as the way in."""
    way, name = row.gap, f"entrance-{row.id}" if row.is_entrance else f"stairwell-{row.id}"
    if row.is_entrance:
        ring = row.pose.rectangle(row.gap, Span(0.0, row.depth_m))
        draft.cells.append(Cell(f"{level}/{name}", ring, level * frame.level_height_m, level, use="entrance"))
    else:
        place = StairPlace(name, row.pose, row.gap, row.depth_m, up_left=row.id == "north")
        add_stairwell(draft, frame.stair, place, level, num_levels, frame.level_height_m)
        way = row.gap.middle(STAIR_DOOR_M)
    draft.join(f"{level}/concourse", f"{level}/{name}", row.pose, way, 0.0)
