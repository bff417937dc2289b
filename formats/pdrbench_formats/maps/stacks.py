"""Stairs and lifts of which a plan says only where they are on each level: those above one another are joined."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import shapely

from pdrbench_formats.maps.builder import BuildingBuilder

MIN_OVERLAP: Final = 0.3  # of the smaller of two outlines on neighbouring levels


@dataclass(frozen=True, slots=True)
class Outline:
    """The outline of a stair, an escalator or a lift on one level.

    Attributes:
        kind: "stairs", "escalator" or "lift".
        level: IMDF ordinal.
        shape: shapely polygon, metres.
        name: As the plan names it.
        is_opening: Whether it is an opening of the floor, under which a stair from the level below may end.
        is_walled: Whether its outline is a wall where no door is.
    """

    kind: str
    level: int
    shape: Any
    name: str
    is_opening: bool = False
    is_walled: bool = False


def join_stacks(builder: BuildingBuilder, outlines: Sequence[Outline]) -> None:
    """Connects every outline with the one that overlaps it most on the next level up.

    An opening of a floor that no stair ends in is a wall. An outline that is above and below no other is reported.
    """
    joined: set[int] = set()
    levels = sorted({outline.level for outline in outlines})
    for lower, upper in itertools.pairwise(levels):
        if upper != lower + 1:
            continue
        above = [outline for outline in outlines if outline.level == upper]
        taken: set[int] = set()
        for outline in (outline for outline in outlines if outline.level == lower and not outline.is_opening):
            overlaps = {
                k: _overlap(outline.shape, other.shape)
                for k, other in enumerate(above)
                if other.kind == outline.kind and k not in taken
            }
            best = max(overlaps, key=lambda k: overlaps[k], default=None)
            if best is None or overlaps[best] < MIN_OVERLAP:
                continue
            taken.add(best)
            joined |= {id(outline), id(above[best])}
            builder.connect(
                outline.kind,  # type: ignore[arg-type]
                levels=(lower, upper),
                polygon={lower: outline.shape, upper: above[best].shape},
                id=f"{outline.kind}-{outline.name}",
                walled=outline.is_walled or above[best].is_walled,
            )
    for outline in (outline for outline in outlines if id(outline) not in joined):
        if outline.is_opening:
            builder.add_wall(outline.shape, outline.level)
        else:
            what = f"{outline.kind} {outline.name!r} of {outline.shape.area:.1f} m² is above or below no other: floor"
            builder.note("stairs not joined" if outline.kind != "lift" else "lift not joined", what, outline.level)
            builder.add_walkable(
                outline.shape, outline.level, id=f"{outline.kind}-{outline.name}", walled=outline.is_walled
            )


def _overlap(one: Any, other: Any) -> float:
    """Common area, as a fraction of the smaller."""
    # Of an outline that crosses itself hundreds of times GEOS takes ten seconds to say that it has no intersection.
    one, other = shapely.make_valid([one, other], method="structure", keep_collapsed=False)
    return float(shapely.intersection(one, other).area / max(min(one.area, other.area), 1e-9))
