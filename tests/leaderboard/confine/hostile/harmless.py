"""Localizers that do no harm; they stand before, between and behind the others."""

from __future__ import annotations

from hostile.common import Honest


class HonestFirst(Honest):
    """Adds up strides."""


class HonestToo(Honest):
    """The same under another name."""


class HonestLast(Honest):
    """The same once more."""
