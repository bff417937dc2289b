"""A localizer in a process of its own: messages, time limits, and what starts such processes."""

from __future__ import annotations

from pdrbench.process.budget import Budget, LocalizerExit, LocalizerTimeout, SuiteBudget, TimeAccount

__all__ = ["Budget", "LocalizerExit", "LocalizerTimeout", "SuiteBudget", "TimeAccount"]
