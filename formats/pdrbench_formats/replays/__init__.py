"""A walk played once more, as a page for a browser."""

from __future__ import annotations

from pdrbench_formats.replays.page import write_replay
from pdrbench_formats.replays.replay import WalkReplay, plan_replay

__all__ = ["WalkReplay", "plan_replay", "write_replay"]
