"""Plans, trails, frames. Importing it loads matplotlib: callers import it late."""

from __future__ import annotations

from pdrbench.picture.plan import draw_level
from pdrbench.picture.renderer import Renderer
from pdrbench.picture.trail import REFERENCE, TrailStyle, draw_trail, estimate_style, styles_of
from pdrbench.picture.window import Window

__all__ = ["REFERENCE", "Renderer", "TrailStyle", "Window", "draw_level", "draw_trail", "estimate_style", "styles_of"]
