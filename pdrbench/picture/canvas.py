"""Figures whose pixels are read, rather than saved to a file."""

from __future__ import annotations

from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

Pixels = NDArray[np.uint8]


def new_canvas(size_px: tuple[float, float], dpi: int) -> tuple[Figure, Any]:
    """A figure of this width and height, and its canvas, whose methods matplotlib leaves untyped."""
    figure = Figure(figsize=(size_px[0] / dpi, size_px[1] / dpi), dpi=dpi)
    return figure, FigureCanvasAgg(figure)


def painted(canvas: Any) -> Pixels:
    """(H, W, 3) copy of what is painted on a canvas."""
    rgba: Pixels = np.asarray(canvas.buffer_rgba(), dtype=np.uint8)
    return rgba[:, :, :3].copy()
