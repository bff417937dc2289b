"""A window that shows frames, where there is a display."""

from __future__ import annotations

import importlib
import os
import sys
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pdrbench.errors import PdrbenchError

TOOLKITS: Final = {  # matplotlib backend by the package that it needs
    "matplotlib.backends.backend_qtagg": "PyQt6 or PySide6",
    "matplotlib.backends.backend_tkagg": "tkinter",
    "matplotlib.backends.backend_gtk4agg": "PyGObject",
}
REMEDY: Final = "use render_mode='rgb_array' and save the frames"


class Window:
    """One window; `show` replaces what it displays.

    Raises:
        PdrbenchError: There is no display, or no toolkit to open a window with.
    """

    def __init__(self, title: str = "pdrbench") -> None:
        canvas_class = _canvas_class()
        self._figure = Figure(figsize=(8, 8))
        canvas_class(self._figure)
        self._manager = canvas_class.new_manager(self._figure, 1)
        self._manager.set_window_title(title)
        self._image: Any = None

    def show(self, frame: NDArray[np.uint8]) -> None:
        """Displays a frame (H, W, 3) and returns at once."""
        if self._image is None:
            ax = self._figure.add_axes((0, 0, 1, 1))
            ax.set_axis_off()
            self._image = ax.imshow(frame)
            self._manager.show()
        self._image.set_data(frame)
        self._figure.canvas.draw()
        self._figure.canvas.flush_events()

    def close(self) -> None:
        """Closes the window."""
        self._manager.destroy()


def _canvas_class() -> Any:
    if sys.platform.startswith("linux") and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise PdrbenchError(
            f"render_mode='human' needs a display, and neither DISPLAY nor WAYLAND_DISPLAY is set; {REMEDY}"
        )
    for module_name in TOOLKITS:
        try:
            return importlib.import_module(module_name).FigureCanvas
        except (ImportError, ValueError):  # ValueError: the toolkit is there in a version that matplotlib refuses
            continue
    raise PdrbenchError(f"render_mode='human' needs one of {', '.join(TOOLKITS.values())}; install one, or {REMEDY}")
