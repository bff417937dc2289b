"""Localizers in processes of their own: what they may do, what they are told, how much time they have."""

from __future__ import annotations

from pdrbench.isolation.budget import Account, Budget, LocalizerExit, LocalizerTimeout

__all__ = ["Account", "Budget", "LocalizerExit", "LocalizerTimeout"]
