"""What is compared of real and synthetic recordings: statistics with the rules they pass by, in blocks by sensor."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from scipy import stats

from pdrbench.geometry import FloatArray
from pdrbench.registry import PluginError
from pdrbench_lab.realism.two_samples import (
    MIN_CLUSTERS,
    MIN_POWER,
    Comparison,
    Sample,
    compare_laws,
    compare_sets,
    stated_size,
)

Part = Literal["fit", "judge"]  # recordings that parameters were fitted on, and the rest
Values = Mapping[str, FloatArray]  # by statistic: (n,) one value per unit of replication; see `clustered`

MIN_REAL_VALUES: Final = 5  # fewer have no distribution
MIN_SYNTHETIC_VALUES: Final = 10  # fewer have no tenth
CLUSTER: Final = ":cluster"  # after the name of a statistic: the key of the clusters of its values
CLASSIFIER: Final = "classifier"  # statistic of the row of the classifier


def clustered(name: str, by_cluster: Iterable[FloatArray]) -> dict[str, FloatArray]:
    """Values of a statistic and, under the key that tells clusters apart, the number of the cluster of each.

    Args:
        name: Of the statistic.
        by_cluster: Values of each cluster: of a person, a session, a walk.
    """
    arrays = [np.asarray(values, dtype=np.float64).ravel() for values in by_cluster]
    numbers = np.repeat(np.arange(len(arrays), dtype=np.float64), [len(values) for values in arrays])
    return {name: np.concatenate([np.zeros(0), *arrays]), f"{name}{CLUSTER}": numbers}


@dataclass(frozen=True, slots=True)
class Verdict:
    """What a rule says: it holds without `reasons`; `unknown` is why it cannot be decided, `remark` is for a pass.

    `size` and `power` are those of the shift that the rule is asked to find; NaN where a rule has none.
    """

    distance: float = math.nan
    reasons: tuple[str, ...] = ()
    unknown: str = ""
    remark: str = ""
    size: float = math.nan
    power: float = math.nan


@dataclass(frozen=True, slots=True)
class Distribution:
    """Both sides may be of one law, up to a KS distance of `max_ks`; fewer than five real clusters are few draws."""

    max_ks: float = 0.25

    def __str__(self) -> str:
        return f"KS ≤ {self.max_ks:g} or what chance makes of so many clusters"

    def judge(self, real: Sample, synthetic: Sample) -> Verdict:
        """Verdict on real and synthetic values."""
        too_few = _too_few(real, MIN_REAL_VALUES, "real") or _too_few(synthetic, MIN_SYNTHETIC_VALUES, "synthetic")
        if too_few:
            return Verdict(unknown=too_few)
        size = stated_size(real, synthetic)
        if min(len(real.sizes), len(synthetic.sizes)) >= MIN_CLUSTERS:
            return _verdict(compare_laws(real, synthetic, self.max_ks, size))
        return _of_sets(real, synthetic, size)


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of a whole set, the median where there are several: the real one is a further draw of synthetic sets.

    Attributes:
        scale: Of which a shift by 30 % has to be found; None for the size of the real figure.
    """

    scale: float | None = None

    def __str__(self) -> str:
        return "real figure within the interval of a further synthetic set"

    def judge(self, real: Sample, synthetic: Sample) -> Verdict:
        """Verdict on real and synthetic values; real ones are of one set."""
        too_few = _too_few(real, 1, "real") or _too_few(synthetic, MIN_SYNTHETIC_VALUES, "synthetic")
        if too_few:
            return Verdict(unknown=too_few)
        one = Sample.of(real.values, np.zeros(len(real)))
        return _of_sets(one, synthetic, stated_size(one, synthetic, self.scale))


@dataclass(frozen=True, slots=True)
class Within:
    """A published figure that no recording here gives: the synthetic median lies in the range.

    Attributes:
        low, high: Ends of the range.
        source: Where the range stands.
    """

    low: float
    high: float
    source: str

    def __str__(self) -> str:
        return f"synthetic median within {self.low:g} to {self.high:g} ({self.source})"

    def judge(self, real: Sample, synthetic: Sample) -> Verdict:
        """Verdict on synthetic values; no real ones are needed."""
        too_few = _too_few(synthetic, 1, "synthetic")
        if too_few:
            return Verdict(unknown=too_few)
        middle = float(np.median(synthetic.values))
        if self.low <= middle <= self.high:
            return Verdict()
        return Verdict(reasons=(f"synthetic median {middle:.3g} outside {self.low:g} to {self.high:g}",))


@dataclass(frozen=True, slots=True)
class Order:
    """One figure for each of a fixed list of competitors: Kendall's tau of both sides is at least `min_tau`."""

    min_tau: float = 1.0

    def __str__(self) -> str:
        return f"same order, tau ≥ {self.min_tau:g}"

    def judge(self, real: Sample, synthetic: Sample) -> Verdict:
        """Verdict on the figures of both sides, competitors in one order."""
        if len(real) != len(synthetic) or len(real) < 2:
            return Verdict(unknown=f"{len(real)} real and {len(synthetic)} synthetic figures: no order to compare")
        tau = float(stats.kendalltau(real.values, synthetic.values).statistic)
        if math.isnan(tau):
            return Verdict(unknown="all figures of one side are equal")
        return Verdict(tau, () if tau >= self.min_tau else (f"Kendall's tau {tau:.2f} < {self.min_tau:g}",))


@dataclass(frozen=True, slots=True)
class Inseparable:
    """The area under the ROC curve of a classifier that separates real from synthetic walks is at most `max_auc`."""

    max_auc: float = 0.75

    def __str__(self) -> str:
        return f"AUC ≤ {self.max_auc:g}"


Rule = Distribution | Figure | Within | Order | Inseparable


def _too_few(values: Sample, fewest: int, which: str) -> str:
    if len(values) >= fewest:
        return ""
    if not len(values):
        return f"no {which} values"
    return f"only {len(values)} {which} value{'s' * (len(values) > 1)}; at least {fewest} are needed"


def _of_sets(real: Sample, synthetic: Sample, size: float) -> Verdict:
    if len(synthetic.sizes) < MIN_SYNTHETIC_VALUES:
        return Verdict(
            unknown=f"only {len(synthetic.sizes)} synthetic sets; at least {MIN_SYNTHETIC_VALUES} are needed"
        )
    return _verdict(compare_sets(real, synthetic, size))


def _verdict(found: Comparison) -> Verdict:
    """A row that passes must have been able to fail: with too little power it cannot be decided."""
    reasons = (found.reason,) if found.is_apart else ()
    unknown = (
        "" if reasons or found.power >= MIN_POWER else f"a shift of {found.size:.3g} is found in {found.power:.0%}"
    )
    return Verdict(found.distance, reasons, unknown, size=found.size, power=found.power)


@dataclass(frozen=True, slots=True)
class RealismStatistic:
    """One row of the scorecard.

    Attributes:
        name: Key in `Values`.
        what: Part of a sentence: what is computed, of what.
        unit: As printed; "" for a ratio.
        per: Unit of replication: "stride", "leg", "walk", "floor".
        rule: When a row passes; None of a block that could not be loaded.
    """

    name: str
    what: str
    unit: str
    per: str
    rule: Rule | None


def statistics(per: str, rule: Rule, *each: tuple[str, str, str]) -> tuple[RealismStatistic, ...]:
    """Statistics of one unit of replication that pass by one rule, from (name, what, unit) of each."""
    return tuple(RealismStatistic(name, what, unit, per, rule) for name, what, unit in each)


@dataclass(frozen=True, slots=True)
class Control:
    """Synthetic values that are wrong on purpose.

    Attributes:
        what: What was done to them.
        synthetic: As `Block.synthetic`.
        statistic: The one that has to fail; "classifier" for the classifier of the block.
    """

    what: str
    synthetic: Callable[[int, int], Values]
    statistic: str


@dataclass(frozen=True, slots=True)
class Block:
    """Statistics of one kind of sensor.

    Attributes:
        name: As printed.
        statistics: Rows.
        datasets: Names of the registered datasets that `real` reads; empty where every rule is `Within`.
        real: Values of real recordings of one part; deterministic.
        synthetic: Values from a seed and the number of synthetic walks (floors, ...); deterministic.
        count: Of synthetic walks that the scorecard asks for.
        controls: By name.
        features: Statistics per walk, of equal length and in the same order of walks, by which a classifier tries to
            separate real from synthetic walks.
        max_auc: Largest area under its ROC curve that passes.
    """

    name: str
    statistics: tuple[RealismStatistic, ...]
    datasets: tuple[str, ...]
    real: Callable[[Part], Values]
    synthetic: Callable[[int, int], Values]
    count: int = 100
    controls: Mapping[str, Control] = field(default_factory=dict)
    features: tuple[str, ...] = ()
    max_auc: float = 0.75

    def __post_init__(self) -> None:
        names = [statistic.name for statistic in self.criteria]
        if len(set(names)) != len(names):
            raise PluginError(f"block {self.name!r}: two statistics have one name: {names}")
        for key, control in self.controls.items():
            if control.statistic not in names:
                raise PluginError(
                    f"block {self.name!r}: control {key!r} needs the statistic {control.statistic!r}, which it lacks"
                )
        if not self.datasets and any(not isinstance(statistic.rule, Within) for statistic in self.statistics):
            raise PluginError(f"block {self.name!r}: without datasets every rule is Within")

    @property
    def criteria(self) -> tuple[RealismStatistic, ...]:
        """The rows of the block: its statistics, and the classifier where it has features."""
        if not self.features:
            return self.statistics
        what = f"area under the curve of a classifier on {', '.join(self.features)}"
        return (*self.statistics, RealismStatistic(CLASSIFIER, what, "", "walk", Inseparable(self.max_auc)))
