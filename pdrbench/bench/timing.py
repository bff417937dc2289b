"""Medians of wall time, of several things in turns."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

Prepared = Callable[[], Callable[[], object]]


@dataclass(frozen=True, slots=True)
class Timing:
    """One row.

    Attributes:
        name: What was timed.
        value: In `unit`.
        unit: Of the value.
        against: What it is compared with, or empty.
        ratio: How many times better than that, from the same run; None where nothing is compared.
    """

    name: str
    value: float
    unit: str
    against: str = ""
    ratio: float | None = None


def median_s(things: Mapping[str, Prepared], rounds: int) -> dict[str, float]:
    """Median wall time of each thing over `rounds` rounds; in every round all have their turn.

    Other load of the machine then affects all of them alike, and the ratio of two medians is more stable than seconds.

    Args:
        things: By name a function that prepares, not timed, and returns what is timed.
        rounds: At least 1.
    """
    taken: dict[str, list[float]] = {name: [] for name in things}
    for _ in range(rounds):
        for name, prepare in things.items():
            act = prepare()
            began = time.perf_counter()
            act()
            taken[name].append(time.perf_counter() - began)
    return {name: statistics.median(times) for name, times in taken.items()}
