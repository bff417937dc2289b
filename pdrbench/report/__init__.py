"""Plots, tables and pages from results. Importing it loads matplotlib: callers import it late."""

from __future__ import annotations

from pdrbench.report.folder import FigureOptions, write_report
from pdrbench.report.pages import comparison_page

__all__ = ["FigureOptions", "comparison_page", "write_report"]
