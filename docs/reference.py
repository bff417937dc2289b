"""Pages of what is registered: environments, localizers, metrics; texts in `templates/`."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import itertools
import re
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from docstrings import docstring_markdown

from pdrbench.metrics.table import METRICS, POOLED, Metric
from pdrbench.registry import load_localizer, localizers
from pdrbench.task import Task, no_survey

TEMPLATES: Final = Path(__file__).with_name("templates")
UNITS: Final = {  # by the suffix of a column or metric name
    **{name: name for name in ("s", "m", "rad", "ms")},
    **{"mps": "m/s", "mps2": "m/s²", "radps": "rad/s", "deg": "°", "ut": "µT", "hpa": "hPa"},
    **{"dbm": "dBm", "mhz": "MHz", "hz": "Hz", "mb": "MB", "pct": "%"},
}
START: Final = {
    "pose": "The place and level where the walk begins, and the heading where it was measured.",
    "area": "A disc that holds the place where the walk begins, and its level.",
    "unknown": "Nothing: `briefing.start` is `None`.",
}


def unit_of(column: str) -> str:
    """The unit that the suffix of a name stands for; "–" where it has none.

    >>> unit_of("z_mps2"), unit_of("access_point")
    ('m/s²', '–')
    """
    return UNITS.get(column.rpartition("_")[2], "–") if "_" in column else "–"


def environment_page(task: Task) -> str:
    """Everything that a participant must know about an environment, as Markdown, without loading a recording."""
    return _render(
        "environment.md",
        task=task,
        splits=[split for split, walks in task.walks.items() if walks],
        start=START[task.start],
        has_survey=task.radio_map is not no_survey,
    )


def localizer_page(name: str) -> str:
    """What a registered localizer does, from its docstring, and how to run it, as Markdown."""
    found = load_localizer(name)
    return _render(
        "localizer.md",
        entry=localizers()[name],
        text=docstring_markdown(inspect.getdoc(found) or "").strip(),
        parameters=list(_parameters(found)),
        needs_reference=hasattr(found, "tell"),
    )


def metrics_page() -> str:
    """Every registered metric: a table for each family, then the formulas, as Markdown."""
    families: dict[str, list[Metric]] = {}
    for metric in (*METRICS.values(), *POOLED.values()):
        families.setdefault(metric.family, []).append(metric)
    return _render("metrics.md", families=families, prose=_prose)


def _render(template: str, **values: Any) -> str:
    """Fills one of `templates/`."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(TEMPLATES), undefined=StrictUndefined, trim_blocks=True, keep_trailing_newline=True
    )
    return environment.get_template(f"{template}.jinja").render(values, one_line=_one_line, unit_of=unit_of)


def _parameters(found: type) -> Iterator[tuple[str, str, str]]:
    """Name, default and source of what a constructor takes, its parameter records spelt out."""
    for name, parameter in inspect.signature(found, eval_str=True).parameters.items():
        record = _record_of(parameter.annotation)
        if record is None:
            yield name, "required" if parameter.default is inspect.Parameter.empty else f"`{parameter.default!r}`", ""
            continue
        source = inspect.getsource(record)
        for field in dataclasses.fields(record):
            comment = re.search(rf"^ +{field.name}:[^#\n]*#(.*)$", source, re.MULTILINE)
            default = "required" if field.default is dataclasses.MISSING else f"`{field.default!r}`"
            yield f"{name}.{field.name}", default, _one_line(comment[1]) if comment else ""


def _record_of(annotation: object) -> type | None:
    """The dataclass that an annotation names, alone or beside others; None where it names none."""
    choices = typing.get_args(annotation) or (annotation,)
    return next((one for one in choices if isinstance(one, type) and dataclasses.is_dataclass(one)), None)


def _prose(target: str) -> str:
    """What the function `module:function` says of itself, without sections and examples."""
    module_name, _, function = target.partition(":")
    docstring = inspect.getdoc(getattr(importlib.import_module(module_name), function)) or ""
    paragraphs = docstring_markdown(docstring).split("\n\n")
    return "\n\n".join(itertools.takewhile(lambda text: not text.startswith(("**", "```")), paragraphs)).strip()


def _one_line(text: str) -> str:
    """Text that fits into a table cell."""
    return re.sub(r"\s+", " ", text).strip().replace("|", "\\|")
