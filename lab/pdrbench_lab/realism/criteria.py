"""Rows of the scorecard: whether synthetic values pass beside real ones, and why not."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench_lab.realism.block import CLUSTER, Block, Inseparable, RealismStatistic, Values, Verdict
from pdrbench_lab.realism.classifier import separability
from pdrbench_lab.realism.targets import Target
from pdrbench_lab.realism.two_samples import HIGH, LOW, Sample

DIGITS: Final = 6  # that are written

Triple = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class ScorecardRow:
    """One line of the scorecard.

    Attributes:
        block: Name under which the block is registered.
        title: The block's own name.
        statistic, what, unit, per: As in `RealismStatistic`.
        rule: When it passes, in words.
        real: First quartile, median, third quartile; None where there is no real value.
        synthetic: First decile, median, last decile; None where there is no synthetic value.
        num_real, num_synthetic: How many values.
        distance: Kolmogorov-Smirnov distance; area under the curve of the classifier; Kendall's tau of an order; else
            NaN.
        size, power: Shift that the rule has to find, and the chance that it does; NaN of rules without one.
        passed: Whether the rule holds.
        judged: False where it could not be decided; such a row does not pass.
        why: Why it does not pass or could not be judged, else a remark or "".
    """

    block: str
    title: str
    statistic: str
    what: str
    unit: str
    per: str
    rule: str
    real: Triple | None
    synthetic: Triple | None
    num_real: int
    num_synthetic: int
    distance: float
    size: float
    power: float
    passed: bool
    judged: bool
    why: str

    def plain(self) -> dict[str, Any]:
        """As in JSON."""
        plain = dataclasses.asdict(self)
        plain |= {"pass": plain.pop("passed"), "real": _written(self.real), "synthetic": _written(self.synthetic)}
        numbers = {name: getattr(self, name) for name in ("distance", "size", "power")}
        return plain | {name: None if math.isnan(value) else _digits(value) for name, value in numbers.items()}


def block_rows(name: str, block: Block, real: Target, synthetic: Values) -> list[ScorecardRow]:
    """A row for every statistic of a block, and one for its classifier where it has features.

    Args:
        name: Under which the block is registered.
        block: The block.
        real: Its real values.
        synthetic: Its synthetic values: (n,) by statistic; NaN is left out.
    """
    return [statistic_row(name, block, statistic, real, synthetic) for statistic in block.criteria]


def statistic_row(
    name: str, block: Block, statistic: RealismStatistic, real: Target, synthetic: Values
) -> ScorecardRow:
    """The row of one statistic, or of the classifier two-sample test."""
    rule = statistic.rule
    if isinstance(rule, Inseparable):
        verdict, counts = separability(real.features, synthetic, block.features, rule.max_auc)
        return _row(name, block.name, statistic, verdict, counts)
    assert rule is not None
    stored = real.statistics.get(statistic.name)
    ours = Sample.of(np.array(stored.values), np.array(stored.clusters)) if stored else Sample.of(np.zeros(0))
    theirs = Sample.of(synthetic.get(statistic.name, np.zeros(0)), synthetic.get(f"{statistic.name}{CLUSTER}"))
    if np.isinf(theirs.values).any():
        verdict = Verdict(unknown="a synthetic value is infinite")
    elif statistic.name not in synthetic:
        verdict = Verdict(unknown="the synthetic side does not give it")
    else:
        verdict = rule.judge(ours, theirs)
    counts = (stored.num if stored else 0, len(theirs))
    spreads = _spread(ours.values, (0.25, 0.5, 0.75)), _spread(theirs.values, (LOW, 0.5, HIGH))
    return _row(name, block.name, statistic, verdict, counts, *spreads)


def unmeasured(name: str, block: Block | None, why: str) -> list[ScorecardRow]:
    """Rows of a block that gave no values; one for the whole block where not even that could be loaded."""
    if block is None:
        every = RealismStatistic("all", "every statistic of the block", "", "", None)
        return [_row(name, name, every, Verdict(unknown=why))]
    return [_row(name, block.name, statistic, Verdict(unknown=why)) for statistic in block.criteria]


def _row(
    name: str,
    title: str,
    statistic: RealismStatistic,
    verdict: Verdict,
    counts: tuple[int, int] = (0, 0),
    real: Triple | None = None,
    synthetic: Triple | None = None,
) -> ScorecardRow:
    return ScorecardRow(
        block=name,
        title=title,
        statistic=statistic.name,
        what=statistic.what,
        unit=statistic.unit,
        per=statistic.per,
        rule="" if statistic.rule is None else str(statistic.rule),
        real=real,
        synthetic=synthetic,
        num_real=counts[0],
        num_synthetic=counts[1],
        distance=verdict.distance,
        size=verdict.size,
        power=verdict.power,
        passed=not verdict.reasons and not verdict.unknown,
        judged=not verdict.unknown,
        why=verdict.unknown or "; ".join(verdict.reasons) or verdict.remark,
    )


def _spread(values: FloatArray, fractions: tuple[float, float, float]) -> Triple | None:
    if not len(values) or np.isinf(values).any():
        return None
    low, middle, high = (float(value) for value in np.quantile(values, fractions))
    return low, middle, high


def _written(triple: Triple | None) -> list[float] | None:
    """Rounded: sums differ in the last bits between machines."""
    return None if triple is None else [_digits(value) for value in triple]


def _digits(value: float) -> float:
    return float(f"{value:.{DIGITS}g}")
