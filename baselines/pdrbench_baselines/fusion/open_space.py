"""A plan for a walk without one: open floor on every level that is surveyed or begun on, wide enough for the walk."""

from __future__ import annotations

from collections.abc import Collection
from typing import Final

import numpy as np

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.geometry import FloatArray
from pdrbench.recording import RadioMap
from pdrbench.trajectory import Start

MARGIN_M: Final = 40.0  # around a survey: corridors that nobody surveyed
REACH_M: Final = 300.0  # around a start: four minutes straight on


def open_space(radio_map: RadioMap | None, start: Start | None, levels: Collection[int] = ()) -> Building:
    """A rectangle for each level, around the whole survey and the start; nothing joins levels.

    Args:
        radio_map: None where there is none.
        start: None where it is not known.
        levels: That there are besides.
    """
    corners_m, levels = [], set(levels)
    if radio_map is not None and len(radio_map.level):
        corners_m += [radio_map.xy_m.min(axis=0) - MARGIN_M, radio_map.xy_m.max(axis=0) + MARGIN_M]
        levels |= set(radio_map.level.tolist())
    if start is not None:
        corners_m += [np.asarray(start.xy_m) - REACH_M, np.asarray(start.xy_m) + REACH_M]
        levels.add(start.level)
    low_m, high_m = np.min(corners_m, axis=0), np.max(corners_m, axis=0)
    return Building(name="open space", polygons=tuple(_rectangle(low_m, high_m, level) for level in sorted(levels)))


def _rectangle(low_m: FloatArray, high_m: FloatArray, level: int) -> FloorPolygon:
    outline_m = np.array([low_m, (high_m[0], low_m[1]), high_m, (low_m[0], high_m[1])])
    return FloorPolygon(f"level {level}", outline_m, np.full(4, WALL), height_m=0.0, level=level)
