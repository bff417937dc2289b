"""Plots, tables, films and pages from results. Importing it loads matplotlib: callers import it late."""

from __future__ import annotations

from pdrbench.report.folder import write_report
from pdrbench.report.pages import comparison_page, environment_page, localizer_page, metrics_page
from pdrbench.report.replay import WalkReplay, plan_replay, write_replay

__all__ = [
    "WalkReplay",
    "comparison_page",
    "environment_page",
    "localizer_page",
    "metrics_page",
    "plan_replay",
    "write_replay",
    "write_report",
]
