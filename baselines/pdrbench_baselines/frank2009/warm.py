"""Compiles what fingerprints are matched by, or loads it from the cache of compiled code."""

from __future__ import annotations

import numpy as np

from pdrbench.recording import RadioMap
from pdrbench_baselines.frank2009.histograms import HistogramTable


def warm_up() -> None:
    """Matches a scan with a survey of one."""
    one = np.zeros(1, dtype=np.int64)
    survey = RadioMap(np.zeros((1, 2)), one, one, np.array([0, 1]), one, np.array([-50.0]), np.zeros(1))
    HistogramTable.from_radio_map(survey).distance([0], [-60.0])
