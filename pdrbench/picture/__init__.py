"""Floor plans, trails and frames; matplotlib is loaded when a picture is first asked for."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pdrbench.picture.plan import draw_level
    from pdrbench.picture.renderer import Renderer
    from pdrbench.picture.trail import REFERENCE, TrailStyle, draw_trail, estimate_style
    from pdrbench.picture.window import Window, show

_HOMES = {
    "REFERENCE": "trail",
    "Renderer": "renderer",
    "TrailStyle": "trail",
    "Window": "window",
    "draw_level": "plan",
    "draw_trail": "trail",
    "estimate_style": "trail",
    "show": "window",
}

__all__ = [
    "REFERENCE",
    "Renderer",
    "TrailStyle",
    "Window",
    "draw_level",
    "draw_trail",
    "estimate_style",
    "show",
]


def __getattr__(name: str) -> Any:
    """Loads a public name when it is first asked for, so that a run without pictures never loads matplotlib."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pdrbench.picture' has no attribute {name!r}")
    return getattr(importlib.import_module(f"pdrbench.picture.{_HOMES[name]}"), name)
