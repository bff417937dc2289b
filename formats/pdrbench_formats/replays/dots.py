"""Clouds of particles as pictures need them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from pdrbench.building import Building
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench_formats.replays.view import floor_height_m

ZERO_WEIGHT_COLOUR: Final = "#000000"  # Woodman & Harle 2008, Fig. 4: black where w = 0
LEVEL_COLOURS: Final = ("#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9")  # Okabe & Ito 2008, estimates are blue


@dataclass(frozen=True, slots=True)
class Dots:
    """Particles as pictures need them.

    Attributes:
        xy_m: (N, 2).
        level: (N,) int.
        height_m: (N,) above level 0.
        weight: (N,) not negative; 0 where a particle hit a wall.
    """

    xy_m: FloatArray
    level: IntArray
    height_m: FloatArray
    weight: FloatArray

    def __len__(self) -> int:
        return len(self.weight)

    @property
    def alive(self) -> BoolArray:
        """(N,) True where the weight is positive."""
        alive: BoolArray = self.weight > 0
        return alive

    def only(self, keep: BoolArray | IntArray) -> Dots:
        """Some of the particles."""
        return Dots(self.xy_m[keep], self.level[keep], self.height_m[keep], self.weight[keep])

    def on_level(self, level: int) -> Dots:
        """The particles of one level."""
        return self.only(self.level == level)

    def thinned(self, max_count: int) -> Dots:
        """At most `max_count` particles, evenly chosen from their order."""
        if len(self) <= max_count:
            return self
        return self.only(np.linspace(0, len(self) - 1, max_count).round().astype(np.int64))


def dots_of(debug: Mapping[str, NDArray[Any]], building: Building | None = None) -> Dots | None:
    """The particles in what a localizer's `debug()` returns; None where it has none.

    `particles_xy_m` (N, 2) must be there; `particles_level`, `particles_polygon` and `particles_weight` (N,) may be.
    Heights are those of the polygons, else of the floor found below; 0 without a map. Arrays are copied.
    """
    if "particles_xy_m" not in debug:
        return None
    xy_m = np.array(debug["particles_xy_m"], dtype=np.float64).reshape(-1, 2)
    weight = np.array(debug.get("particles_weight", np.ones(len(xy_m))), dtype=np.float64)
    polygon = None if building is None else debug.get("particles_polygon")
    if building is not None and polygon is not None and (np.asarray(polygon) >= 0).all():
        level, height_m = building.level(polygon), building.height(polygon)
    else:
        level = np.array(debug.get("particles_level", np.zeros(len(xy_m))), dtype=np.int64)
        height_m = np.zeros(len(xy_m)) if building is None else floor_height_m(building, xy_m, level)
    shown = np.isfinite(xy_m).all(axis=1) & np.isfinite(height_m)
    return Dots(xy_m, np.array(level), np.array(height_m), weight).only(shown)
