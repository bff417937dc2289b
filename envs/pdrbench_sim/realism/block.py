"""What is compared of real and synthetic recordings: statistics, grouped in blocks by sensor."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final, Literal

from pdrbench.geometry import FloatArray
from pdrbench.registry import PluginError

Part = Literal["fit", "judge"]  # recordings that parameters were fitted on, and the rest
Values = Mapping[str, FloatArray]  # by statistic: (n,) one value per unit of replication

MAX_KS: Final = 0.25
MAX_AUC: Final = 0.75
CLASSIFIER: Final = "classifier"  # statistic of the row of the classifier


@dataclass(frozen=True, slots=True)
class Distribution:
    """The real median lies in the middle 80 % of the synthetic values, and the two are at most `max_ks` apart."""

    max_ks: float = MAX_KS


@dataclass(frozen=True, slots=True)
class Figure:
    """One figure of a whole set: the real one lies in the middle 80 % of what synthetic sets give."""


@dataclass(frozen=True, slots=True)
class Within:
    """A published figure that no recording here gives: the synthetic median lies in the range.

    Attributes:
        low: Least.
        high: Most.
        source: Where the range stands.
    """

    low: float
    high: float
    source: str


@dataclass(frozen=True, slots=True)
class Order:
    """One figure for each of a fixed list of competitors: both sides put them in the same order.

    Attributes:
        min_tau: Least of Kendall's tau between the real and the synthetic figures; 1 is the same order.
    """

    min_tau: float = 1.0


@dataclass(frozen=True, slots=True)
class Inseparable:
    """The area under the ROC curve of a classifier that separates real from synthetic walks is at most `max_auc`."""

    max_auc: float = MAX_AUC


Rule = Distribution | Figure | Within | Order | Inseparable


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
            tell real from synthetic walks.
    """

    name: str
    statistics: tuple[RealismStatistic, ...]
    datasets: tuple[str, ...]
    real: Callable[[Part], Values]
    synthetic: Callable[[int, int], Values]
    count: int = 100
    controls: Mapping[str, Control] = field(default_factory=dict)
    features: tuple[str, ...] = ()

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
        return (*self.statistics, RealismStatistic(CLASSIFIER, what, "", "walk", Inseparable()))
