"""How small a ratio so many walks can tell, and how many walks a ratio needs.

The logarithm of the ratio of two localizers differs between units such as buildings, between walks of a unit, and
between seeds of a walk. Each kind of spread is measured on some walks, and gives the standard error on others.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.metrics.ranking import environment_weights, smallest_ratio
from pdrbench.metrics.statistics import MIN_UNITS, Units, unit_codes

MAX_FACTOR: Final = 1e6  # times as many walks: beyond, no number of walks is worth a line


@dataclass(frozen=True, slots=True)
class Spread:
    """Variances of the logarithm of a ratio.

    Attributes:
        unit: Between units.
        walk: Between walks of a unit; 0 where each unit has one walk, whose spread is in `unit`.
        seed: Between seeds of a walk; 0 where there is one seed, whose spread is in `walk` or `unit`.
    """

    unit: float
    walk: float
    seed: float


@dataclass(frozen=True, slots=True)
class Design:
    """How many walks are played, one seed each.

    Attributes:
        units: Units, each with as many walks as any other; walks where there are too few of them.
        walks: Walks.
        declared_units: Units, however few: by these the environment weighs in a score.
    """

    units: float
    walks: float
    declared_units: float


def measured_spread(differences: FloatArray, units: Units) -> Spread:
    """Variances between units, walks and seeds, by an analysis of variance of nested means.

    With mean squares B between K units and S within: walk = S, unit = (B - S) / n0, n0 = (W - sum n_k^2 / W) / (K - 1).

    Args:
        differences: (W, S) logarithms of the ratio by walk and seed; a walk with a NaN is left out.
        units: (W,) unit of each walk; below `MIN_UNITS` units each walk counts as one.
    """
    known = np.isfinite(differences).all(axis=1)
    values, code = differences[known], unit_codes(units, len(differences))[known]
    if len(np.unique(code)) < MIN_UNITS:
        code = np.arange(len(code))
    num_seeds = values.shape[1]
    seed = float(values.var(axis=1, ddof=1).mean()) if num_seeds > 1 else 0.0
    walks = values.mean(axis=1)
    _, member, sizes = np.unique(code, return_inverse=True, return_counts=True)
    count, num_units = len(walks), len(sizes)
    if num_units < 2:
        return Spread(math.nan, math.nan, math.nan)
    means = np.bincount(member, walks) / sizes
    between = float(sizes @ (means - walks.mean()) ** 2) / (num_units - 1)
    within = float(np.sum((walks - means[member]) ** 2)) / (count - num_units) if count > num_units else 0.0
    per_unit = (count - float(sizes @ sizes) / count) / (num_units - 1)
    of_chance = seed / num_seeds  # in the mean of a walk
    if count == num_units:
        return Spread(max(between - of_chance, 0.0), 0.0, seed)
    return Spread(max(between - within, 0.0) / per_unit, max(within - of_chance, 0.0), seed)


def neighbour_error(spreads: Sequence[Mapping[str, Spread]], designs: Mapping[str, Design]) -> tuple[float, float]:
    """Median over pairs of the standard error of the logarithm of the ratio, and its degrees of freedom; NaN without.

    se^2 = sum over environments of w^2 (unit / K + (walk + seed) / W) with w of `environment_weights`; degrees of
    freedom are K - 1 of each, and Welch's over all.

    Args:
        spreads: For each pair of neighbours, by environment.
        designs: Of every environment.
    """
    errors, of_degrees = [], []
    for pair in spreads:
        weights = environment_weights([designs[env].declared_units for env in pair])
        variances = weights**2 * np.array(
            [(of.unit / designs[env].units + (of.walk + of.seed) / designs[env].walks) for env, of in pair.items()]
        )
        if not np.isfinite(variances).all() or not variances.sum() > 0:
            continue
        degrees = np.array([designs[env].units - 1 for env in pair])
        errors.append(math.sqrt(variances.sum()))
        of_degrees.append(float(variances.sum() ** 2 / np.sum(variances**2 / degrees)))
    return (float(np.median(errors)), float(np.median(of_degrees))) if errors else (math.nan, math.nan)


def walks_for(ratio: float, error: float, degrees: float, walks: int) -> int | None:
    """Walks that tell a ratio among `NUM_ENTRIES` entries, in as many units per walk; None where no number does.

    Args:
        ratio: Above 1.
        error: Standard error of the logarithm of the ratio with `walks` walks.
        degrees: Of freedom of that.
        walks: Walks that give this error.
    """

    def tells(factor: float) -> bool:
        return smallest_ratio(error / math.sqrt(factor), max(degrees * factor, 1.0)) <= ratio

    if not math.isfinite(error) or not tells(MAX_FACTOR):
        return None
    low, high = 1 / walks, MAX_FACTOR
    while high / low > 1 + 1e-6:
        middle = math.sqrt(low * high)
        low, high = (low, middle) if tells(middle) else (middle, high)
    return math.ceil(high * walks - 1e-3)
