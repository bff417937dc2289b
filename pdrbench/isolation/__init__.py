"""Localizers in processes of their own: protections of the system, messages, time limits."""

from __future__ import annotations

from pdrbench.isolation.budget import Budget, LocalizerExit, LocalizerTimeout, SuiteBudget, TimeAccount

__all__ = ["Budget", "LocalizerExit", "LocalizerTimeout", "SuiteBudget", "TimeAccount"]
