"""A localizer in a process of its own: messages, time limits, and what starts such processes."""

from __future__ import annotations

from pdrbench.process.budget import Budget, LocalizerExit, LocalizerTimeout, TimeAccount

__all__ = ["Budget", "LocalizerExit", "LocalizerTimeout", "TimeAccount"]
