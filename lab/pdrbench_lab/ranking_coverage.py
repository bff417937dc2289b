"""How often intervals of ratios and of ranks hold, in simulated boards: `python -m pdrbench_lab.ranking_coverage`."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from typing import Final

import numpy as np

from pdrbench.metrics.ranking import rank

ENTRIES: Final = 6
# Units and walks of each environment of a board: generated ones, a set of outings, eight routes, one person
BOARDS: Final = {
    "one environment, 200 buildings": ((200, 1),),
    "one environment, 100 buildings": ((100, 1),),
    "200 buildings and 88 outings of two walks": ((200, 1), (88, 2)),
    "200 buildings and 8 routes": ((200, 1), (8, 1)),
    "23 walks of one person": ((23, 1),),
    "200 buildings, 31 outings of five walks, 11 of six, four of two": ((200, 1), (31, 5), (11, 6), (4, 2)),
}
LOST_FRACTION: Final = 0.1  # of walks on which an entry errs eight times as much, which gives a long upper tail


def draw(rng: np.random.Generator, units: int, per_unit: int) -> np.ndarray:
    """(ENTRIES, W) errors of equal entries: walks differ, entries on a unit and on a walk, and some walks are lost."""
    count = units * per_unit
    unit = np.repeat(rng.normal(0, 0.3, (ENTRIES, units)), per_unit, axis=1)
    lost = np.log(8.0) * (rng.random((ENTRIES, count)) < LOST_FRACTION)
    return np.asarray(np.exp(rng.normal(0, 0.6, count) + unit + rng.normal(0, 0.3, (ENTRIES, count)) + lost))


def coverage(rng: np.random.Generator, sizes: tuple[tuple[int, int], ...], runs: int) -> tuple[float, float]:
    """Fraction of intervals that hold the ratio 1, and of boards on which every rank interval holds every place."""
    held, ranks = [], []
    units = {f"E{k}": np.repeat(np.arange(of[0]), of[1]) for k, of in enumerate(sizes)}
    for _ in range(runs):
        drawn = {env: draw(rng, *of) for env, of in zip(units, sizes, strict=True)}
        values = {str(row): {env: of[row] for env, of in drawn.items()} for row in range(ENTRIES)}
        found = rank(values, units=units, noise_m=dict.fromkeys(units, 0.01), rng=rng, draws=3000)
        ends = [found.pairs.ratio(i, j)[1:] for i, j in itertools.combinations(range(ENTRIES), 2)]
        held.append(np.mean([low <= 1.0 <= high for low, high in ends]))
        ranks.append(all(of.rank == (1, ENTRIES) for of in found.standings))
    return float(np.mean(held)), float(np.mean(ranks))


def lines(runs: int = 1000) -> Iterator[str]:
    """A line of Markdown for each board."""
    yield "| board | ratios | ranks |"
    yield "|---|---|---|"
    for name, sizes in BOARDS.items():
        ratios, ranks = coverage(np.random.default_rng(20261128), sizes, runs)
        yield f"| {name} | {100 * ratios:.1f} % | {100 * ranks:.1f} % |"


if __name__ == "__main__":
    for line in lines():
        print(line, flush=True)  # noqa: T201
