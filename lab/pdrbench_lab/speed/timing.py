"""Timings, each beside what it is compared with, in turns in one run: ratios are comparable, seconds are not."""

from __future__ import annotations

import statistics
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

# Entry points by name: `module:function`, called with `quick` and a function that reports progress; returns rows.
BENCHES_GROUP: Final = "pdrbench.benches"
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


def median_s(
    things: Mapping[str, Prepared], rounds: int, clock: Callable[[], float] = time.perf_counter
) -> dict[str, float]:
    """Median time of each thing over `rounds` rounds; in every round all have their turn.

    Other load of the machine then affects all of them alike, and the ratio of two medians is more stable than seconds.

    Args:
        things: By name a function that prepares, not timed, and returns what is timed.
        rounds: At least 1.
        clock: `time.process_time` for what the processors spent instead of what a clock on the wall shows.
    """
    taken: dict[str, list[float]] = {name: [] for name in things}
    for _ in range(rounds):
        for name, prepare in things.items():
            act = prepare()
            began = clock()
            act()
            taken[name].append(clock() - began)
    return {name: statistics.median(times) for name, times in taken.items()}
