"""Streams that a recording lacks, computed from those that it has: attitude, strides, position, changes of level.

Every row is computed from rows that are not later than itself, so that a walk with derived streams can be replayed like
any other. Their specs have `derived=True`, which a briefing passes on.
"""

from __future__ import annotations

from pdrbench_formats.derive.attitude import attitude
from pdrbench_formats.derive.streams import DERIVED, derive, derived_streams, missing_reason

__all__ = ["DERIVED", "attitude", "derive", "derived_streams", "missing_reason"]
