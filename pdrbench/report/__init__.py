"""Plots, tables, films and pages from results; matplotlib is loaded when a report is first asked for."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pdrbench.report.folder import write_report
    from pdrbench.report.pages import environment_page, localizer_page, metrics_page
    from pdrbench.report.replay import Replay, plan_replay, write_replay

_HOMES = {
    "Replay": "replay",
    "environment_page": "pages",
    "localizer_page": "pages",
    "metrics_page": "pages",
    "plan_replay": "replay",
    "write_replay": "replay",
    "write_report": "folder",
}

__all__ = [
    "Replay",
    "environment_page",
    "localizer_page",
    "metrics_page",
    "plan_replay",
    "write_replay",
    "write_report",
]


def __getattr__(name: str) -> Any:
    """Loads a public name when it is first asked for."""
    if name not in _HOMES:
        raise AttributeError(f"module 'pdrbench.report' has no attribute {name!r}")
    return getattr(importlib.import_module(f"pdrbench.report.{_HOMES[name]}"), name)
