"""Settings of the foot filter: those of `pdrbench.inertial`."""

from __future__ import annotations

from pdrbench.inertial import REWEIGHTED

__all__ = ["REWEIGHTED"]
