"""Markdown pages generated from what is registered, so that they cannot go stale."""

from __future__ import annotations

import dataclasses
import importlib
import inspect
import itertools
import re
import typing
from collections.abc import Iterator, Sequence
from typing import Final

from pdrbench.metrics.table import METRICS, POOLED, Metric
from pdrbench.recording import SensorSpec
from pdrbench.registry import PluginEntry, load_localizer, localizers
from pdrbench.report.docstrings import docstring_markdown
from pdrbench.task import Task, no_radio_map

UNITS: Final = {  # by the suffix of a column or metric name
    "s": "s",
    "m": "m",
    "mps": "m/s",
    "mps2": "m/s²",
    "rad": "rad",
    "radps": "rad/s",
    "deg": "°",
    "ut": "µT",
    "hpa": "hPa",
    "dbm": "dBm",
    "mhz": "MHz",
    "hz": "Hz",
    "ms": "ms",
    "mb": "MB",
    "pct": "%",
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
    """Everything that a participant must know about an environment, without loading a recording.

    Args:
        task: From `make_task`.

    Returns:
        Markdown with a first-level heading.
    """
    parts = [f"# {task.id}", task.summary, *_warnings(task), task.description]
    parts += ["## Observation", _observation(task)]
    parts += ["## Action", ACTION]
    parts += ["## Reward and end", _reward(task)]
    parts += ["## Splits", _splits(task)]
    parts += ["## What is given before a walk", _briefing(task)]
    parts += ["## Data", _data(task)]
    parts += ["## Example", _example(task)]
    return "\n\n".join(part.strip() for part in parts if part.strip()) + "\n"


def localizer_page(name: str) -> str:
    """What a registered localizer does, from its docstring, and how to run it.

    Args:
        name: Localizer id.

    Returns:
        Markdown with a first-level heading.
    """
    found = load_localizer(name)
    entry = localizers()[name]
    parts = [f"# {name}", docstring_markdown(inspect.getdoc(found) or "")]
    parts += [_parameters(found), "## Run it", _run_it(entry, hasattr(found, "tell"))]
    return "\n\n".join(part.strip() for part in parts if part.strip()) + "\n"


def metrics_page() -> str:
    """Every registered metric: a table for each family, then the formulas.

    Returns:
        Markdown with a first-level heading.
    """
    families: dict[str, list[Metric]] = {}
    for metric in (*METRICS.values(), *POOLED.values()):
        families.setdefault(metric.family, []).append(metric)
    parts = ["# Metrics", METRICS_INTRODUCTION]
    for family, metrics in families.items():
        parts += [f"## {family.capitalize()}", _metric_table(metrics), *_formulas(metrics)]
    return "\n\n".join(part.strip() for part in parts) + "\n"


ACTION: Final = """
A `Box` of three float64: `x_m`, `y_m` in the building frame and `level` (rounded to a whole number; 0 is the ground
level). It answers the observation handed out before it.
`gymnasium.make(id, claims=("heading", "sigma", "converged"))` appends `heading_rad`, `sigma_m` and `converged` (one
place from 0.5 on, several below) in the order of the claims; they are scored only where they are claimed. NaN in one
of the first three is no answer: it is counted, and the answer before it is held.
"""

METRICS_INTRODUCTION: Final = """
An estimate is compared with a surveyed position at the time of that position: the last estimate not later than it
counts (zero-order hold). A wrong level is penalised, never dropped. Nothing is aligned unless the name says so. A
metric that does not apply to a walk, such as one of heading where the heading was not measured, is NaN there and
counts in no mean. The time of what never happens is infinite and does count: an infinite median is printed as `never`
and is null in JSON, where `n` is still the number of walks. Names that begin with `pooled_` are of all positions of all
walks together; every other value of a table is over walks, as its line says.
"""


def _warnings(task: Task) -> list[str]:
    notes = []
    if task.superseded_by is not None:
        notes.append(f"**Superseded by `{task.superseded_by}`.** It stays runnable so that old scores can be repeated.")
    if task.note:
        notes.append(f"**Note:** {task.note}")
    return notes


def _observation(task: Task) -> str:
    lines = [
        f"A `Dict` every {task.period_s:g} s. All boxes are float64; rows that were not delivered are zero.",
        "",
        "| key | shape | what |",
        "|---|---|---|",
        "| `now_s` | `(1,)` | seconds from the start of the walk |",
    ]
    for spec in task.sensors:
        rows = task.capacity[spec.name]
        lines.append(f"| `{spec.name}` | `({rows}, {len(spec.columns)})` | {_one_line(spec.what)} {_rate(spec)} |")
        lines.append(f"| `{spec.name}_count` | `(1,)` | rows of `{spec.name}` that are filled, 0 to {rows} |")
    lines.append("")
    lines.append("Rows that exceed the capacity come with the next observation: late, but complete.")
    for spec in task.sensors:
        lines += ["", f"Columns of `{spec.name}`:", "", *_columns(spec)]
    return "\n".join(lines)


def _rate(spec: SensorSpec) -> str:
    return "(events)" if spec.rate_hz is None else f"(about {spec.rate_hz:g} Hz)"


def _columns(spec: SensorSpec) -> list[str]:
    lines = ["| column | unit | smallest | largest |", "|---|---|---|---|"]
    for name, low, high in zip(spec.columns, spec.low, spec.high, strict=True):
        lines.append(f"| `{name}` | {unit_of(name)} | {low:g} | {high:g} |")
    return lines


def _reward(task: Task) -> str:
    return f"""
The reward of a step is minus the level-penalised error in metres: the distance to the reference plus 15 m for every
level between them. On a test split it is 0, since three errors would give the place away. There is one step for every
{task.period_s:g} s. An episode ends (`terminated`) when everything that was recorded has been delivered and answered;
the observation that comes with the end has no rows, its `info` carries `info["result"]`, and
`pdrbench.score(info["result"])` scores it.
"""


def _splits(task: Task) -> str:
    lines = ["| split | walks |", "|---|---|"]
    lines += [f"| {split} | {len(walks)} |" for split, walks in task.walks.items() if walks]
    lines += ["", "Ids of test walks are opaque, and their order is shuffled."]
    return "\n".join(lines)


def _briefing(task: Task) -> str:
    survey = "none" if task.radio_map is no_radio_map else "`briefing.radio_map`, without the scans of the walk itself"
    return "\n".join(
        [
            '`info["briefing"]` of `reset` holds:',
            "",
            f"* **Start** (`{task.start}`): {START[task.start]}",
            f"* **Radio survey**: {survey}.",
            "* **Building**: `briefing.building`, the floor plan, or `None` where there is none.",
            "* **Sensors**: `briefing.sensors`, the spec of every stream.",
            "* **Person and device**: `briefing.subject`, what a user would have entered, such as the body height,",
            "  and `briefing.mounting`, where the device is carried; empty where it was not recorded.",
        ]
    )


def _data(task: Task) -> str:
    dataset = f"registered as `{task.dataset}`: `pdrbench data fetch {task.dataset}`" if task.dataset else "embedded"
    return "\n".join(
        [
            "| | |",
            "|---|---|",
            f"| version | `{task.id}` |",
            f"| data | {dataset} |",
            f"| source | {task.source} |",
            f"| licence | {task.licence} |",
            f"| sha256 | `{task.sha256}` |",
            "",
            "Scores can be compared where version and sha256 agree.",
        ]
    )


def _example(task: Task) -> str:
    return f"""
```python
import gymnasium
import numpy as np
import pdrbench

env = gymnasium.make("pdrbench/{task.id}", split="{next(name for name, walks in task.walks.items() if walks)}")
observation, info = env.reset(seed=0)
here = info["briefing"].building.centre() if info["briefing"].start is None else info["briefing"].start
action = np.array([*here.xy_m, here.level])
over = False
while not over:
    observation, reward, terminated, truncated, info = env.step(action)
    over = terminated or truncated
print(pdrbench.score(info["result"])["mean_m"])
```

```
pdrbench compare --env {task.id}
```
"""


def _parameters(found: type) -> str:
    """A table of what the constructor takes, its parameter records spelt out; empty where it takes nothing."""
    lines = []
    for name, parameter in inspect.signature(found, eval_str=True).parameters.items():
        record = _record_of(parameter.annotation)
        if record is None:
            default = "required" if parameter.default is inspect.Parameter.empty else f"`{parameter.default!r}`"
            lines.append(f"| `{name}` | {default} | |")
        else:
            lines += _fields(name, record)
    return "\n".join(["## Parameters", "", "| name | default | source |", "|---|---|---|", *lines]) if lines else ""


def _record_of(annotation: object) -> type | None:
    """The dataclass that an annotation names, alone or beside others; None where it names none."""
    choices = typing.get_args(annotation) or (annotation,)
    return next((one for one in choices if isinstance(one, type) and dataclasses.is_dataclass(one)), None)


def _fields(owner: str, record: type) -> Iterator[str]:
    """One line for each field of a record of parameters, with the comment that stands behind it."""
    source = inspect.getsource(record)
    for field in dataclasses.fields(record):
        comment = re.search(rf"^ +{field.name}:[^#\n]*#(.*)$", source, re.MULTILINE)
        default = "required" if field.default is dataclasses.MISSING else f"`{field.default!r}`"
        yield f"| `{owner}.{field.name}` | {default} | {_one_line(comment[1]) if comment else ''} |"


def _run_it(entry: PluginEntry, needs_reference: bool) -> str:
    return f"""
```
pdrbench compare --localizer {entry.id}{" --split val" if needs_reference else ""}
pdrbench check localizer {entry.id}
```

It is `{entry.target}`, registered by `{entry.package}`.
"""


def _metric_table(metrics: Sequence[Metric]) -> str:
    lines = ["| name | unit | better | what | constants |", "|---|---|---|---|---|"]
    for metric in metrics:
        constants = ", ".join(f"{name} {value}" for name, value in metric.constants.items())
        lines.append(
            f"| `{metric.name}` | {metric.unit or '–'} | {'–' if metric.better == 'none' else metric.better} "
            f"| {_one_line(metric.what)} | {constants or '–'} |"
        )
    return "\n".join(lines)


def _formulas(metrics: Sequence[Metric]) -> Iterator[str]:
    """What the functions behind a table say of themselves, each once."""
    for target in dict.fromkeys(metric.target for metric in metrics):
        module_name, _, function = target.partition(":")
        docstring = inspect.getdoc(getattr(importlib.import_module(module_name), function)) or ""
        paragraphs = docstring_markdown(docstring).split("\n\n")
        prose = itertools.takewhile(lambda paragraph: not paragraph.startswith(("**", "```")), paragraphs)
        yield f"`{function}`: " + "\n\n".join(prose)


def _one_line(text: str) -> str:
    """Text that fits into a table cell."""
    return re.sub(r"\s+", " ", text).strip().replace("|", "\\|")
