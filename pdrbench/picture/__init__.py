"""Plans, exploded buildings, trails, particles, frames. Importing it loads matplotlib: callers import it late."""

from __future__ import annotations

from pdrbench.picture.cloud import Dots, dots_of, draw_dots
from pdrbench.picture.exploded import draw_exploded
from pdrbench.picture.marks import draw_arrow, draw_pairs, draw_path, draw_region, draw_zone
from pdrbench.picture.panels import exploded_figure, level_panels
from pdrbench.picture.plan import draw_level
from pdrbench.picture.renderer import Renderer
from pdrbench.picture.trail import REFERENCE, TrailStyle, draw_trail, estimate_style, styles_of
from pdrbench.picture.view import PLAN, View, exploded_view, floor_height_m, level_height_m
from pdrbench.picture.window import Window

__all__ = [
    "PLAN",
    "REFERENCE",
    "Dots",
    "Renderer",
    "TrailStyle",
    "View",
    "Window",
    "dots_of",
    "draw_arrow",
    "draw_dots",
    "draw_exploded",
    "draw_level",
    "draw_pairs",
    "draw_path",
    "draw_region",
    "draw_trail",
    "draw_zone",
    "estimate_style",
    "exploded_figure",
    "exploded_view",
    "floor_height_m",
    "level_height_m",
    "level_panels",
    "styles_of",
]
