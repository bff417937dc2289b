"""Figures of papers: exploded buildings, clouds of particles, paths, regions, plans side by side."""

from __future__ import annotations

from pdrbench_lab.drawing.cloud import draw_dots
from pdrbench_lab.drawing.exploded import draw_exploded
from pdrbench_lab.drawing.marks import draw_arrow, draw_pairs, draw_path, draw_region, draw_zone
from pdrbench_lab.drawing.panels import exploded_figure, level_panels

__all__ = [
    "draw_arrow",
    "draw_dots",
    "draw_exploded",
    "draw_pairs",
    "draw_path",
    "draw_region",
    "draw_zone",
    "exploded_figure",
    "level_panels",
]
