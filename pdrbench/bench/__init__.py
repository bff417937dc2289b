"""Timings, each beside what it is compared with, measured in turns in one run: ratios travel, seconds do not."""

from __future__ import annotations

from pdrbench.bench.timing import Timing

# By name: `module:function`, called with `quick` and a function that reports progress; returns rows.
BENCHES = {
    "isolation": "pdrbench.bench.isolation:run",
}

__all__ = ["BENCHES", "Timing"]
