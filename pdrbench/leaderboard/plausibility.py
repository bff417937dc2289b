"""Flags: what an honest submission rarely looks like. A flag refuses nothing; it is shown to maintainers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.evaluation.scoring import Scored
from pdrbench.evaluation.tables import Results
from pdrbench.geometry import FloatArray
from pdrbench.leaderboard.entry import Entry
from pdrbench.leaderboard.suites import SuiteEnvironment
from pdrbench.result import UNSUITABLE, Result
from pdrbench.trajectory import Estimates

FROZEN_S: Final = 60.0  # ours: no pause in a generated walk is longer
MAX_FROZEN_FRACTION: Final = 0.5
MAX_OUTSIDE_PCT: Final = 5.0  # ours: walls are thin, and a baseline with a map has less than 1 %
MAX_SPEED_MPS: Final = 3.0  # [R] faster than people run indoors
SPEED_WINDOW_S: Final = 5.0  # a stride arrives at once: 1.4 m in a moment
MAX_FAST_FRACTION: Final = 0.01  # of all windows
MIN_AVAILABILITY: Final = 0.95
UNISOLATED: Final = ("none", "process", "")


@dataclass(frozen=True, slots=True)
class Finding:
    """One rule or flag.

    Attributes:
        name: What was looked at.
        passed: Whether it is as it should be.
        why: What was found.
        is_flag: True where it refuses nothing.
    """

    name: str
    passed: bool
    why: str = ""
    is_flag: bool = False


def flags(entry: Entry, listed: SuiteEnvironment, scored: Sequence[Scored] | None = None) -> list[Finding]:
    """Looks at one entry.

    Args:
        entry: With estimates.
        listed: The environment in the suite of the entry.
        scored: Of each of its results; computed where None.
    """
    scored = Results(entry.results).scored if scored is None else scored
    played = [pair for pair in zip(entry.results, scored, strict=True) if pair[0].status != UNSUITABLE]
    answered = [result for result, _ in played]
    found = [
        _precision([one for _, one in played], listed),
        _spread(entry, answered),
        *([] if listed.still else [_frozen(answered)]),
        _outside([one for _, one in played]),
        _speed(answered),
        _selective([one for _, one in played]),
        _sigmas(answered),
        _isolation(entry),
    ]
    return [Finding(f"{entry.env}: {name}", passed, why, is_flag=True) for name, passed, why in found]


Flag = tuple[str, bool, str]


def _mean(scored: Sequence[Scored], metric: str) -> float:
    values = np.array([one.scores[metric] for one in scored])
    return float(np.mean(values[np.isfinite(values)])) if np.isfinite(values).any() else float("nan")


def _precision(scored: Sequence[Scored], listed: SuiteEnvironment) -> Flag:
    p75_m = _mean(scored, "p75_m")
    passed = not p75_m < listed.noise_m
    return (
        "no better than the reference",
        passed,
        f"75 % within {p75_m:.3g} m, the reference knows {listed.noise_m:g} m",
    )


def _spread(entry: Entry, results: Sequence[Result]) -> Flag:
    seeds = {record.seed for record in entry.record.walks}
    digests: dict[str, set[str]] = {}
    for record in entry.record.walks:
        digests.setdefault(record.walk, set()).add(record.sha256)
    if entry.record.deterministic or len(seeds) < 2 or not results:
        return "seeds differ", True, "deterministic: one seed"
    same = sum(len(of_walk) == 1 for of_walk in digests.values())
    return (
        "seeds differ",
        same < len(digests),
        f"{same} of {len(digests)} walks are the same for all {len(seeds)} seeds",
    )


def _share_of(results: Sequence[Result], is_so: Callable[[Estimates], bool]) -> float:
    return float(np.mean([is_so(result.estimates) for result in results])) if results else 0.0


def _frozen(results: Sequence[Result]) -> Flag:
    share = _share_of(results, lambda estimates: longest_frozen_s(estimates) >= FROZEN_S)
    return "keeps moving", share < MAX_FROZEN_FRACTION, f"{share:.0%} of walks stand still for {FROZEN_S:g} s"


def longest_frozen_s(estimates: Estimates) -> float:
    """Longest time during which the same place was answered."""
    if not len(estimates):
        return 0.0
    places = np.nan_to_num(estimates.xy_m, nan=np.inf)
    changes = np.flatnonzero((places[1:] != places[:-1]).any(axis=1)) + 1
    first = np.concatenate([[0], changes])
    last = np.concatenate([changes - 1, [len(estimates) - 1]])
    return float(np.max(estimates.t_s[last] - estimates.t_s[first]))


def _outside(scored: Sequence[Scored]) -> Flag:
    outside_pct = _mean(scored, "outside_pct")
    return "inside the building", not outside_pct > MAX_OUTSIDE_PCT, f"{outside_pct:.3g} % of estimates are outside"


def _speed(results: Sequence[Result]) -> Flag:
    fast = [is_fast(result.estimates) for result in results]
    share = float(np.concatenate(fast).mean()) if sum(map(len, fast)) else 0.0
    return (
        f"no faster than {MAX_SPEED_MPS:g} m/s",
        share <= MAX_FAST_FRACTION,
        f"{share:.1%} of all {SPEED_WINDOW_S:g} s are faster",
    )


def is_fast(estimates: Estimates) -> FloatArray:
    """(n,) 1 for each moment with an answer that is further from the one before the window than a pedestrian gets."""
    given = estimates.given
    t_s, xy_m = estimates.t_s[given], estimates.xy_m[given]
    before = np.searchsorted(t_s, t_s - SPEED_WINDOW_S, side="right") - 1
    moved_m = np.hypot(*(xy_m - xy_m[np.maximum(before, 0)]).T)
    return np.asarray((moved_m > MAX_SPEED_MPS * SPEED_WINDOW_S)[before >= 0], dtype=np.float64)


def _selective(scored: Sequence[Scored]) -> Flag:
    availability = _mean(scored, "availability")
    why = f"{availability:.1%} of observations are answered"
    return "answers when unsure, too", not availability < MIN_AVAILABILITY, why


def _sigmas(results: Sequence[Result]) -> Flag:
    claimed = np.concatenate([result.estimates.sigma_m for result in results]) if results else np.zeros(0)
    claimed = claimed[~np.isnan(claimed)]
    senseless = int((~((claimed > 0) & (claimed < np.inf))).sum())
    return "claims that make sense", not senseless, f"{senseless} of {len(claimed)} claimed sigmas are none"


def _isolation(entry: Entry) -> Flag:
    modes = sorted({str(way.get("mode", "")) for way in entry.submission.run.isolation} or {""})
    passed = not any(mode in UNISOLATED for mode in modes)
    return "was isolated", passed, ", ".join(mode or "unknown" for mode in modes)
