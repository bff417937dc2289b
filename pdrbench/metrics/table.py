"""Every metric by name: what a table may show, and where it is computed. Those of other packages follow ours."""

from __future__ import annotations

import importlib
import inspect
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, Literal

import msgspec

from pdrbench.registry import PluginError, Table

INPUTS: Final = (  # what a metric can take, as `scoring.score` has it
    *("held", "answered", "resampled", "reference", "building", "step_s", "period_s", "reset_s", "missing"),
    *("peak_mb", "mounting"),
)


@dataclass(frozen=True, slots=True)
class Metric:
    """One column of a table.

    Attributes:
        name: With its unit.
        unit: As printed; empty for a fraction, a count or a ratio.
        better: "lower", "higher", or "none" where a value says nothing about better or worse.
        family: Group of metrics, as a heading of the page on metrics.
        what: One sentence: the formula, and how a row of a table is made of the walks.
        target: `module:function`.
        constants: Keyword arguments of the function, printed with the score; `method` is that of the percentile.
        takes: Names of the arguments of the function, in order: see `scoring.score`.
        over_walks: What makes a row of a table of its walks, of `statistics.SUMMARIES`; "median" for times that may be
            infinite.
    """

    name: str
    unit: str
    better: Literal["lower", "higher", "none"]
    family: str
    what: str
    target: str
    constants: Mapping[str, float | str] = field(default_factory=dict)
    takes: tuple[str, ...] = ("held", "reference")
    over_walks: Literal["mean", "median"] = "mean"

    @property
    def scale(self) -> Literal["any", "size", "fraction"]:
        """What its values can be, as `statistics.mean_interval` takes it; a fraction beyond 1 counts as a size."""
        return "fraction" if not self.unit else "any" if self.better == "none" else "size"

    def __post_init__(self) -> None:
        object.__setattr__(self, "constants", MappingProxyType(dict(self.constants)))


def _declared() -> Mapping[str, Metric]:
    """What `metrics.toml` declares, by name and in its order."""
    sections = tomllib.loads(Path(__file__).with_name("metrics.toml").read_text(encoding="utf-8"))
    return {name: msgspec.convert({"name": name, **facts}, Metric) for name, facts in sections.items()}


_DECLARED: Final = _declared()
POOLED: Final = MappingProxyType({name: metric for name, metric in _DECLARED.items() if metric.family == "pooled"})
BUILTIN: Final = MappingProxyType({name: metric for name, metric in _DECLARED.items() if name not in POOLED})


def check_metric(name: str, metric: Any) -> None:
    """Raises `PluginError` where a metric of another package could not be computed or shown, and says why."""
    try:
        if not isinstance(metric, Metric):
            raise TypeError(f"it is {type(metric).__name__}, not a pdrbench.metrics.Metric")
        facts = {one.name: getattr(metric, one.name) for one in fields(Metric)}
        msgspec.convert(facts | {"constants": dict(metric.constants)}, Metric)
        if metric.name != name or name in POOLED:
            raise ValueError(f"it calls itself {metric.name!r}, or as a pooled one")
        if unknown := [taken for taken in metric.takes if taken not in INPUTS]:
            raise ValueError(f"it takes {unknown[0]!r}; a metric can take {', '.join(INPUTS)}")
        module, _, function = metric.target.partition(":")
        inspect.signature(getattr(importlib.import_module(module), function)).bind(*metric.takes, **metric.constants)
    except Exception as error:  # a plug-in may raise anything when it is imported
        raise PluginError(f"metric {name!r} cannot be used: {type(error).__name__}: {error}") from error


METRICS: Final[Table[Metric]] = Table("pdrbench.metrics", "metric", BUILTIN, check_metric)
