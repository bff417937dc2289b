"""Flags: what an honest submission rarely looks like. A flag refuses nothing; it is shown to maintainers."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.evaluation.scoring import Scored
from pdrbench.evaluation.tables import Results
from pdrbench.geometry import FloatArray
from pdrbench.trajectory import Estimates
from pdrbench_leaderboard.entry import Entry
from pdrbench_leaderboard.suites import SuiteEnvironment

FROZEN_S: Final = 60.0  # ours: no pause in a generated walk is longer
MAX_FROZEN_FRACTION: Final = 0.5
MAX_OUTSIDE_PCT: Final = 5.0  # ours: walls are thin, and a baseline with a map has less than 1 %
MAX_SPEED_MPS: Final = 3.0  # [R] faster than people run indoors
SPEED_WINDOW_S: Final = 5.0  # a stride arrives at once: 1.4 m in a moment
MAX_FAST_FRACTION: Final = 0.01  # of all windows
MIN_AVAILABILITY: Final = 0.95
UNISOLATED: Final = frozenset({"none", "process", "unknown"})


@dataclass(frozen=True, slots=True)
class Finding:
    """One rule or flag."""

    name: str  # what was looked at
    passed: bool  # whether it is as it should be
    why: str = ""  # what was found
    is_flag: bool = False  # true where it refuses nothing


def flags(entry: Entry, listed: SuiteEnvironment, scored: Sequence[Scored] | None = None) -> list[Finding]:
    """Looks at one entry.

    Args:
        entry: With estimates.
        listed: The environment in the suite of the entry.
        scored: Of each of its results; computed where None.
    """
    scored = Results(entry.results).scored if scored is None else scored
    played = [(result, of_walk) for result, of_walk in zip(entry.results, scored, strict=True) if of_walk.scores]
    answers = [result.estimates for result, _ in played]

    def mean(metric: str) -> float:
        values = np.array([of_walk.scores[metric] for _, of_walk in played])
        values = values[np.isfinite(values)]
        return float(np.mean(values)) if len(values) else math.nan

    p75_m = mean("p75_m")
    why = f"75 % within {p75_m:.3g} m, the reference knows {listed.noise_m:g} m"
    found = [("no better than the reference", not p75_m < listed.noise_m, why), _seeds(entry, bool(played))]
    if not listed.still:
        frozen = float(np.mean([longest_frozen_s(of_walk) >= FROZEN_S for of_walk in answers])) if answers else 0.0
        why = f"{frozen:.0%} of walks stand still for {FROZEN_S:g} s"
        found.append(("keeps moving", frozen < MAX_FROZEN_FRACTION, why))
    outside_pct = mean("outside_pct")
    why = f"{outside_pct:.3g} % of estimates are outside"
    found.append(("inside the building", not outside_pct > MAX_OUTSIDE_PCT, why))
    windows = np.concatenate([is_fast(of_walk) for of_walk in answers] or [np.zeros(0)])
    fast = float(windows.mean()) if len(windows) else 0.0
    why = f"{fast:.1%} of all {SPEED_WINDOW_S:g} s are faster"
    found.append((f"no faster than {MAX_SPEED_MPS:g} m/s", fast <= MAX_FAST_FRACTION, why))
    availability = mean("availability")
    why = f"{availability:.1%} of observations are answered"
    found.append(("answers when unsure, too", not availability < MIN_AVAILABILITY, why))
    sigma_m = np.concatenate([of_walk.sigma_m for of_walk in answers] or [np.zeros(0)])
    sigma_m = sigma_m[~np.isnan(sigma_m)]
    wrong = int((~((sigma_m > 0) & (sigma_m < np.inf))).sum())
    found.append(("claims that make sense", not wrong, f"{wrong} of {len(sigma_m)} claimed sigmas are none"))
    modes = entry.isolation_modes
    found.append(("was isolated", not set(modes) & UNISOLATED, ", ".join(modes)))
    return [Finding(f"{entry.env}: {name}", passed, why, is_flag=True) for name, passed, why in found]


def _seeds(entry: Entry, is_played: bool) -> tuple[str, bool, str]:
    """Whether the estimates of a localizer that draws random numbers depend on the seed."""
    seeds = {record.seed for record in entry.record.walks}
    if entry.record.deterministic or len(seeds) < 2 or not is_played:
        return "seeds differ", True, "deterministic: one seed"
    by_walk: dict[str, set[bytes]] = {}
    for result in entry.sent:
        by_walk.setdefault(result.walk, set()).add(result.estimates.columns.tobytes())
    same = sum(len(of_walk) == 1 for of_walk in by_walk.values())
    why = f"{same} of {len(by_walk)} walks are the same for all {len(seeds)} seeds"
    return "seeds differ", same < len(by_walk), why


def longest_frozen_s(estimates: Estimates) -> float:
    """Longest time during which the same place was answered."""
    if not len(estimates):
        return 0.0
    places = np.nan_to_num(estimates.xy_m, nan=np.inf)
    changes = np.flatnonzero((places[1:] != places[:-1]).any(axis=1)) + 1
    first = np.concatenate([[0], changes])
    last = np.concatenate([changes - 1, [len(estimates) - 1]])
    return float(np.max(estimates.t_s[last] - estimates.t_s[first]))


def is_fast(estimates: Estimates) -> FloatArray:
    """(n,) 1 for each moment with an answer that is further from the one before the window than a pedestrian gets."""
    given = estimates.given
    t_s, xy_m = estimates.t_s[given], estimates.xy_m[given]
    before = np.searchsorted(t_s, t_s - SPEED_WINDOW_S, side="right") - 1
    moved_m = np.hypot(*(xy_m - xy_m[np.maximum(before, 0)]).T)
    return np.asarray((moved_m > MAX_SPEED_MPS * SPEED_WINDOW_S)[before >= 0], dtype=np.float64)
