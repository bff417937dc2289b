"""The replica of a laboratory building: 8725 m2 on three levels, wings along a street (Woodman & Harle 2008).

Other than in `office`, walls have thickness: floor polygons are the net floor between them, and a doorway is a polygon
of its own, as deep as the wall. How thick walls are, and how deep rooms, is matched on purpose: the 4.53 million
particles of the paper's uniform prior (W11) mean 1.44 occupied cubes of 1 m per square metre of floor (sources.md, note
2), so much more than 1 that walls, ducts and cupboards must take a quarter of the building. A building with thinner
walls would be as plausible, and its prior a fifth smaller.

Wings repeat along the street, mirrored or turned, and levels repeat the one below, so that a walker may be in several
places at once (Fig. 5); some rooms differ, so that in the end there is one. The street lies along x at y = 0, wings
along y.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.building import Building, Zone
from pdrbench.errors import MapError
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench_lab.papers.woodman2008.lab_stride.frame import TRACKED_M, draw_plan
from pdrbench_lab.papers.woodman2008.lab_stride.plan import ALL_LEVELS, LabParams, Plan, Stairwell
from pdrbench_lab.papers.woodman2008.lab_stride.rooms import Layout, add_door, add_hall, add_rows, draw_layouts
from pdrbench_lab.papers.woodman2008.lab_stride.theatre import add_theatre
from pdrbench_sim.buildings.assembly import Cell, Draft, Span, mm
from pdrbench_sim.buildings.stairwell import add_stairwell

AREA_M2: Final = 8725.0  # W1
AREA_TOLERANCE: Final = 0.003  # it is met this closely; the promise is 0.01
TRACKED: Final = "tracked"
ROOMS: Final = frozenset({"office", "meeting", "laboratory", "hall"})  # kinds of zones that are one floor polygon each
_ZONES: Final = ROOMS | {"corridor", "theatre stage"}


def make_lab(rng: np.random.Generator, *, name: str = "lab", params: LabParams | None = None) -> Building:
    """Draws a laboratory building of 8725 m2 within 1 % on levels 0, 1 and 2.

    The draws fix everything but the length of the wings, which is solved for the area. The zone of kind "tracked" is
    the part of a wing on level 2 in which positions are scored.

    Args:
        rng: Two buildings from generators in the same state are equal byte for byte.
        name: Name of the building.
        params: Sizes; None for the defaults.

    Raises:
        MapError: The sizes allow no building of that area.
    """
    params = params or LabParams()
    for _ in range(8):
        drawn = _fit_length(int(rng.integers(2**62)), params)
        if drawn is not None:
            plan, draft = drawn
            return draft.building(name, _ZONES, _zones(plan))
    raise MapError(f"no building of {AREA_M2:g} m2 found with {params}; change the sizes of its parts")


def tracked_outline(building: Building) -> FloatArray:
    """(4, 2) corners of the part of a wing of level 2 in which positions are scored."""
    for zone in building.zones:
        if zone.kind == TRACKED:
            return zone.outline_xy_m
    raise MapError(f"building {building.name!r} has no zone of kind {TRACKED!r}; take one from make_lab")


def in_tracked_wing(building: Building, xy_m: FloatArray, level: IntArray) -> BoolArray:
    """(N,) True for places (N, 2) on levels (N,) in the zone of kind "tracked"; its boundary counts as inside (W1)."""
    import shapely

    outline = shapely.Polygon(tracked_outline(building))
    on_level = np.array([zone.level for zone in building.zones if zone.kind == TRACKED])[0] == np.asarray(level)
    inside: BoolArray = shapely.intersects_xy(outline, np.asarray(xy_m, dtype=np.float64)) & on_level
    return inside


def _fit_length(seed: int, params: LabParams) -> tuple[Plan, Draft] | None:
    """The building of the wanted area, or None where the number of rooms jumps to and fro or wings get too short."""
    length_m = 28.0
    for _ in range(16):
        plan, draft = _draw_cells(seed, length_m, params)
        missing_m2 = AREA_M2 - sum(cell.area_m2 for cell in draft.cells)
        if abs(missing_m2) <= AREA_TOLERANCE * AREA_M2:
            return plan, draft
        length_m *= 1 + missing_m2 / sum(plan.wings_m2)
        if length_m * params.length_ratio[0] < TRACKED_M[1]:
            return None
    return None


def _draw_cells(seed: int, length_m: float, params: LabParams) -> tuple[Plan, Draft]:
    plan_rng, *level_rngs = (np.random.default_rng([seed, i]) for i in range(len(ALL_LEVELS) + 1))
    plan = draw_plan(plan_rng, length_m, params)
    draft, layouts = Draft(), dict[str, Layout]()
    for level, rng in zip(ALL_LEVELS, level_rngs, strict=True):
        height_m = level * plan.level_height_m
        _add_corridors(draft, plan, level, height_m)
        rows = [row for row in plan.rows if level <= row.top]
        layouts = draw_layouts(rng, rows, layouts, params)
        add_rows(draft, rows, layouts, level, height_m, params)
        for hall in plan.halls:
            if level in hall.levels:
                add_hall(draft, hall, level, height_m)
        for theatre in plan.theatres:
            if level in theatre.hall.levels:
                add_theatre(draft, theatre, level, height_m)
        for stairwell in plan.stairwells:
            _add_stairwell(draft, plan, stairwell, level, params)
    return plan, draft


def _add_corridors(draft: Draft, plan: Plan, level: int, height_m: float) -> None:
    for corridor in plan.corridors:
        if level <= corridor.top:
            holes = list(corridor.voids) if level > 0 else []
            draft.cells.append(
                Cell(f"{level}/{corridor.id}", corridor.ring, height_m, level, use="corridor", holes=holes)
            )
    for joint in plan.joints:
        if level <= joint.top:
            draft.join(f"{level}/{joint.one}", f"{level}/{joint.other}", joint.pose, joint.u, joint.v_m)


def _add_stairwell(draft: Draft, plan: Plan, stairwell: Stairwell, level: int, params: LabParams) -> None:
    place = stairwell.place
    add_stairwell(draft, plan.stair, place, level, len(ALL_LEVELS), plan.level_height_m)
    doorway = place.span.middle(params.door_m), Span(-stairwell.gap_m, 0.0)
    name = f"{level}/{place.name}"
    door = Cell(f"{name}-door", place.pose.rectangle(*doorway), level * plan.level_height_m, level, use="door")
    add_door(draft, door, f"{level}/{stairwell.corridor}", name, place.pose, *doorway)


def _zones(plan: Plan) -> list[Zone]:
    """The theatre as a whole, and where positions are scored."""
    top = ALL_LEVELS[-1]
    outlines = [(f"{top}/tracked", ring, top, TRACKED) for ring in plan.tracked]
    for theatre in plan.theatres:
        hall = theatre.hall
        ring = hall.pose.rectangle(hall.span, Span(hall.gap_m, mm(hall.gap_m + hall.depth_m)))
        outlines.append((f"0/{hall.id}-whole", ring, 0, "theatre"))
    return [Zone(id=i, name=i, outline_xy_m=np.array(r), level=n, kind=k) for i, r, n, k in outlines]
