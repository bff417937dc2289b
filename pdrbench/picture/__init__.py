"""Plans, exploded buildings, trails, particles, frames; matplotlib is loaded when a picture is first asked for."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pdrbench.picture.cloud import Dots, dots_of, draw_dots
    from pdrbench.picture.exploded import draw_exploded
    from pdrbench.picture.marks import draw_arrow, draw_pairs, draw_path, draw_region, draw_zone
    from pdrbench.picture.panels import exploded_figure, level_panels
    from pdrbench.picture.plan import draw_level
    from pdrbench.picture.renderer import Renderer
    from pdrbench.picture.trail import REFERENCE, TrailStyle, draw_trail, estimate_style
    from pdrbench.picture.view import PLAN, View, exploded_view, floor_height_m, level_height_m
    from pdrbench.picture.window import Window, show

_HOMES = {
    "PLAN": "view",
    "REFERENCE": "trail",
    "Dots": "cloud",
    "Renderer": "renderer",
    "TrailStyle": "trail",
    "View": "view",
    "Window": "window",
    "dots_of": "cloud",
    "draw_arrow": "marks",
    "draw_dots": "cloud",
    "draw_exploded": "exploded",
    "draw_level": "plan",
    "draw_pairs": "marks",
    "draw_path": "marks",
    "draw_region": "marks",
    "draw_trail": "trail",
    "draw_zone": "marks",
    "estimate_style": "trail",
    "exploded_figure": "panels",
    "exploded_view": "view",
    "floor_height_m": "view",
    "level_height_m": "view",
    "level_panels": "panels",
    "show": "window",
}

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
    "show",
]


def __getattr__(name: str) -> Any:
    """Loads a public name when it is first asked for, so that a run without pictures never loads matplotlib."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pdrbench.picture' has no attribute {name!r}")
    return getattr(importlib.import_module(f"pdrbench.picture.{_HOMES[name]}"), name)
