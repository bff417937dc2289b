"""Scores: pure functions of (held estimate, reference, building), their table, and statistics over walks."""

from __future__ import annotations

from pdrbench.metrics.hold import Held, hold_at
from pdrbench.metrics.pooling import pooled
from pdrbench.metrics.position import ecdf, errors_m
from pdrbench.metrics.scoring import score
from pdrbench.metrics.table import METRICS, POOLED, Metric

__all__ = ["METRICS", "POOLED", "Held", "Metric", "ecdf", "errors_m", "hold_at", "pooled", "score"]
