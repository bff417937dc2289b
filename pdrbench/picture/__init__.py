"""Plans, trails, particles, frames. Importing it loads matplotlib: callers import it late."""

from __future__ import annotations

from pdrbench.picture.cloud import Dots, dots_of
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
    "draw_level",
    "draw_trail",
    "estimate_style",
    "exploded_view",
    "floor_height_m",
    "level_height_m",
    "styles_of",
]
