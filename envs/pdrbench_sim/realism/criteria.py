"""Rows of the scorecard: whether synthetic values pass beside real ones, and why not."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy import stats

from pdrbench.geometry import FloatArray
from pdrbench_sim.realism.block import (
    Block,
    Distribution,
    Figure,
    Inseparable,
    Order,
    RealismStatistic,
    Rule,
    Values,
    Within,
)
from pdrbench_sim.realism.classifier import SeparabilityResult, separability
from pdrbench_sim.realism.targets import Target

LOW, HIGH = 0.1, 0.9  # shares of the synthetic values between which a real median has to lie
DIGITS: Final = 6  # that are written
MIN_REAL_VALUES: Final = 5  # values: fewer have no distribution
MIN_SYNTHETIC_VALUES: Final = 10  # values: fewer have no tenth
CHANCE_KS: Final = 1.358  # times sqrt(1/n + 1/m): the KS distance that chance alone exceeds in 5 % of cases (Smirnov)

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
    passed: bool
    judged: bool
    why: str

    def plain(self) -> dict[str, Any]:
        """As in JSON."""
        plain = dataclasses.asdict(self)
        plain |= {"pass": plain.pop("passed"), "real": _written(self.real), "synthetic": _written(self.synthetic)}
        return plain | {"distance": None if math.isnan(self.distance) else round(self.distance, DIGITS)}


@dataclass(frozen=True, slots=True)
class _Verdict:
    """What a rule says: it holds without `reasons`; `unknown` is why it cannot be decided, `remark` is for a pass."""

    distance: float = math.nan
    reasons: tuple[str, ...] = ()
    unknown: str = ""
    remark: str = ""


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
    if isinstance(statistic.rule, Inseparable):
        found = separability(real.features, synthetic, block.features)
        verdict, counts = _inseparable(statistic.rule, found), (found.num_real, found.num_synthetic)
        return _row(name, block.name, statistic, verdict, counts)
    stored = real.statistics.get(statistic.name)
    ours = np.array(stored.values if stored else (), dtype=np.float64)
    theirs = np.asarray(synthetic.get(statistic.name, ()), dtype=np.float64).ravel()
    theirs = theirs[~np.isnan(theirs)]
    if np.isinf(theirs).any():
        verdict = _Verdict(unknown="a synthetic value is infinite")
    elif statistic.name not in synthetic:
        verdict = _Verdict(unknown="the synthetic side does not give it")
    else:
        verdict = _RULES[type(statistic.rule)](statistic.rule, ours, theirs)
    counts = (stored.num if stored else 0, len(theirs))
    spreads = _spread(ours, (0.25, 0.5, 0.75)), _spread(theirs, (LOW, 0.5, HIGH))
    return _row(name, block.name, statistic, verdict, counts, *spreads)


def unmeasured(name: str, block: Block | None, why: str) -> list[ScorecardRow]:
    """Rows of a block that gave no values; one for the whole block where not even that could be loaded."""
    if block is None:
        every = RealismStatistic("all", "every statistic of the block", "", "", None)
        return [_row(name, name, every, _Verdict(unknown=why))]
    return [_row(name, block.name, statistic, _Verdict(unknown=why)) for statistic in block.criteria]


def _row(
    name: str,
    title: str,
    statistic: RealismStatistic,
    verdict: _Verdict,
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
        rule="" if statistic.rule is None else rule_text(statistic.rule),
        real=real,
        synthetic=synthetic,
        num_real=counts[0],
        num_synthetic=counts[1],
        distance=verdict.distance,
        passed=not verdict.reasons and not verdict.unknown,
        judged=not verdict.unknown,
        why=verdict.unknown or "; ".join(verdict.reasons) or verdict.remark,
    )


def _spread(values: FloatArray, fractions: tuple[float, float, float]) -> Triple | None:
    if not len(values) or np.isinf(values).any():
        return None
    low, middle, high = (float(value) for value in np.quantile(values, fractions))
    return low, middle, high


def _distribution(rule: Distribution, real: FloatArray, synthetic: FloatArray) -> _Verdict:
    too_few = _too_few(real, MIN_REAL_VALUES, "real") or _too_few(synthetic, MIN_SYNTHETIC_VALUES, "synthetic")
    if too_few:
        return _Verdict(unknown=too_few)
    distance = float(stats.ks_2samp(real, synthetic, method="asymp").statistic)
    reasons = _outside(real, synthetic)
    if distance > rule.max_ks:
        chance = CHANCE_KS * math.sqrt(1 / len(real) + 1 / len(synthetic))
        remark = f", within the {chance:.2f} that chance alone makes of so few" if distance <= chance else ""
        reasons = (*reasons, f"KS {distance:.2f} > {rule.max_ks:g}{remark}")
    return _Verdict(distance, reasons)


def _figure(rule: Figure, real: FloatArray, synthetic: FloatArray) -> _Verdict:
    too_few = _too_few(real, 1, "real") or _too_few(synthetic, MIN_SYNTHETIC_VALUES, "synthetic")
    return _Verdict(unknown=too_few) if too_few else _Verdict(reasons=_outside(real, synthetic))


def _within(rule: Within, real: FloatArray, synthetic: FloatArray) -> _Verdict:
    too_few = _too_few(synthetic, 1, "synthetic")
    if too_few:
        return _Verdict(unknown=too_few)
    middle = float(np.median(synthetic))
    if rule.low <= middle <= rule.high:
        return _Verdict()
    return _Verdict(reasons=(f"synthetic median {middle:.3g} outside {rule.low:g} to {rule.high:g}",))


def _order(rule: Order, real: FloatArray, synthetic: FloatArray) -> _Verdict:
    if len(real) != len(synthetic) or len(real) < 2:
        return _Verdict(unknown=f"{len(real)} real and {len(synthetic)} synthetic figures: no order to compare")
    tau = float(stats.kendalltau(real, synthetic).statistic)
    if math.isnan(tau):
        return _Verdict(unknown="all figures of one side are equal")
    if tau >= rule.min_tau:
        return _Verdict(tau)
    return _Verdict(tau, (f"Kendall's tau {tau:.2f} < {rule.min_tau:g}",))


def _inseparable(rule: Inseparable, found: SeparabilityResult) -> _Verdict:
    if not math.isfinite(found.auc):
        return _Verdict(found.auc, unknown=found.why)
    if found.auc <= rule.max_auc:
        return _Verdict(found.auc, remark=found.why)
    return _Verdict(found.auc, (f"AUC {found.auc:.2f} > {rule.max_auc:g}: {found.why}",))


_RULES: Final[Mapping[type, Callable[[Any, FloatArray, FloatArray], _Verdict]]] = {
    Distribution: _distribution,
    Figure: _figure,
    Within: _within,
    Order: _order,
}


def _too_few(values: FloatArray, fewest: int, which: str) -> str:
    if len(values) >= fewest:
        return ""
    if not len(values):
        return f"no {which} values"
    return f"only {len(values)} {which} value{'s' * (len(values) > 1)}; at least {fewest} are needed"


def _written(triple: Triple | None) -> list[float] | None:
    """Rounded: sums differ in the last bits between machines."""
    return None if triple is None else [float(f"{value:.{DIGITS}g}") for value in triple]


def _outside(real: FloatArray, synthetic: FloatArray) -> tuple[str, ...]:
    middle = float(np.median(real))
    low, high = (float(value) for value in np.quantile(synthetic, (LOW, HIGH)))
    if low <= middle <= high:
        return ()
    which = "figure" if len(real) == 1 else "median"
    return (f"real {which} {middle:.3g} outside P10 to P90, {low:.3g} to {high:.3g}",)


def rule_text(rule: Rule) -> str:
    """A rule in words.

    >>> rule_text(Within(0.73, 0.93, "a paper"))
    'synthetic median within 0.73 to 0.93 (a paper)'
    """
    match rule:
        case Distribution(max_ks):
            return f"real median within P10 to P90, KS ≤ {max_ks:g}"
        case Figure():
            return "real figure within P10 to P90"
        case Within(low, high, source):
            return f"synthetic median within {low:g} to {high:g} ({source})"
        case Inseparable(max_auc):
            return f"AUC ≤ {max_auc:g}"
        case Order(min_tau):
            return f"same order, tau ≥ {min_tau:g}"
