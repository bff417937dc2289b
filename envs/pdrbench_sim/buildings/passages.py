"""Where a path passes from one floor polygon to the next: doors that slow a walker down, treads that take one step."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import FloatArray, IntArray

MAX_TREAD_M: Final = 0.6  # walked length; what is longer in a "stairs" polygon is a landing
DOOR_WIDTH_M: Final = 1.4  # a connection up to this wide slows a walker down


@dataclass(frozen=True, slots=True)
class Passage:
    """The part of a path that lies in one floor polygon; `exit_width_m` is that of the connection at its end."""

    start_m: float
    end_m: float
    kind: str
    height_m: float
    exit_width_m: float

    @property
    def middle_m(self) -> float:
        return (self.start_m + self.end_m) / 2

    @property
    def is_tread(self) -> bool:
        return self.kind == "stairs" and self.end_m - self.start_m < MAX_TREAD_M


def passages(building: Building, xy_m: FloatArray, polygon: IntArray, s_m: FloatArray) -> list[Passage]:
    """Cuts a path where it passes from one floor polygon to the next."""
    changes = np.flatnonzero(np.diff(polygon))
    crossings = [_crossing(building, polygon[i], polygon[i + 1], xy_m[i], xy_m[i + 1]) for i in changes]
    at_m = [
        float(s_m[i] + fraction * (s_m[i + 1] - s_m[i])) for i, (fraction, _) in zip(changes, crossings, strict=True)
    ]
    owners = [building.polygons[i] for i in polygon[np.concatenate([changes, [len(polygon) - 1]])]]
    widths_m = [*(width_m for _, width_m in crossings), math.inf]
    return [
        Passage(start_m, end_m, owner.kind, owner.height_m, width_m)
        for start_m, end_m, owner, width_m in zip([0.0, *at_m], [*at_m, float(s_m[-1])], owners, widths_m, strict=True)
    ]


def _crossing(building: Building, one: int, other: int, a: FloatArray, b: FloatArray) -> tuple[float, float]:
    """Fraction of the step a to b at which it passes from one floor polygon to another, and the width of the passage.

    One half and infinity where the step passes a third polygon between them.
    """
    edges = np.arange(building.first_edge[one], building.first_edge[one + 1])
    edges = edges[building.edge_neighbour[edges] == other]
    start, end = building.edge_start_xy_m[edges], building.edge_end_xy_m[edges]
    along, step = end - start, b - a
    across = step[0] * along[:, 1] - step[1] * along[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        fraction = ((start - a)[:, 0] * along[:, 1] - (start - a)[:, 1] * along[:, 0]) / across
        where = ((start - a)[:, 0] * step[1] - (start - a)[:, 1] * step[0]) / across
    hit = np.flatnonzero(
        (across > 0) & (where >= -1e-9) & (where <= 1 + 1e-9) & (fraction >= -1e-9) & (fraction <= 1 + 1e-9)
    )
    if not len(hit):
        return 0.5, math.inf
    return float(np.clip(fraction[hit[0]], 0, 1)), float(np.hypot(*along[hit[0]]))
