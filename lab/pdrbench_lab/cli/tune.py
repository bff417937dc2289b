"""`pdrbench tune`."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from pdrbench.cli.options import (
    LOCALIZER_HELP,
    Isolation,
    Jobs,
    Seeds,
    complete_env,
    complete_localizer,
    make_folder,
    write_text,
)
from pdrbench.cli.output import AsJson, answer_only, note, print_json, print_table, say
from pdrbench.cli.ready import check_localizer_exists, ready_environment
from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray
from pdrbench.settings import with_settings

SETTINGS = "tuned.toml"


def tune(
    localizer: Annotated[
        str, typer.Argument(metavar="LOCALIZER", autocompletion=complete_localizer, help=LOCALIZER_HELP)
    ],
    env: Annotated[
        str, typer.Option(metavar="ENV", autocompletion=complete_env, help="Environment, whose train split is played.")
    ],
    param: Annotated[
        list[str], typer.Option(metavar="NAME=A,B,C", help="Values of a setting to try; repeat for several.")
    ],
    folds: Annotated[
        int, typer.Option(min=2, metavar="N", help="Parts of the train split, each of whole sessions or buildings.")
    ] = 5,
    metric: Annotated[str, typer.Option(metavar="METRIC", help="What is made best.")] = "mean_m",
    most: Annotated[
        int | None, typer.Option(min=1, metavar="N", help="Random combinations instead of all.", show_default="all")
    ] = None,
    seeds: Seeds = 1,
    jobs: Jobs = 1,
    out: Annotated[
        Path,
        typer.Option(
            metavar="FOLDER", file_okay=False, help="Settings that were chosen, and walks that a later run reuses."
        ),
    ] = Path("pdrbench-tuned"),
    isolation: Isolation = "process",
    as_json: AsJson = False,
) -> None:
    """Choose parameters of a localizer on folds of the train split; the left-out figure is what to report."""
    from pdrbench.evaluation.number_text import decimals

    with answer_only(as_json):
        from pdrbench_lab.reproduce.tune import grid
        from pdrbench_lab.reproduce.tune import tune as choose

        candidates = grid(dict(map(_values, param)), most)
        for candidate in candidates:
            check_localizer_exists(with_settings(localizer, candidate), isolation)
        found = choose(
            localizer,
            ready_environment(env, "train"),
            candidates,
            folds=folds,
            metric=metric,
            seeds=seeds,
            jobs=jobs,
            out=make_folder(out),
            isolation=isolation,
            progress=True,
            advance=lambda candidate: note(_text(candidate)),
        )
    by_fold: list[dict[str, Any]] = [
        {
            "fold": k,
            "walks": int((found.fold == k).sum()),
            "parameters": None if found.chosen[k] < 0 else candidates[found.chosen[k]],
            found.metric: _mean(found.left_out[found.fold == k]),
        }
        for k in range(folds)
    ]
    num_scored = int((~np.isnan(found.left_out)).sum())
    interval_text = "" if math.isnan(found.low) else f", 95 % interval {decimals(found.low)}–{decimals(found.high)}"
    left_out_text = f"left out: {metric} {decimals(found.value)}{interval_text}, {num_scored} walks of {env}"
    file = write_text(out / SETTINGS, _toml(localizer, candidates[found.final], left_out_text))
    note(f"wrote {file}; play it with: pdrbench compare --env {env} --settings {file}")
    if as_json:
        interval = [None if math.isnan(end) else end for end in (found.low, found.high)]
        left_out = {"value": found.value, "low": interval[0], "high": interval[1], "walks": num_scored}
        print_json({"left_out": left_out, "folds": by_fold, "final": candidates[found.final]})
        return
    cells = [[str(of["fold"]), str(of["walks"]), decimals(of[metric]), _text(of["parameters"])] for of in by_fold]
    print_table({"left-out fold": {}, "walks": {}, metric: {"justify": "right"}, "chosen without it": {}}, cells)
    say(left_out_text)
    say(f"to use: {with_settings(localizer, candidates[found.final])}")


def _toml(localizer: str, settings: Any, comment: str) -> str:
    """What `run` and `compare` take as `--settings`.

    >>> print(_toml("li2012", {"map": False, "filter.max_particles": 500}, "left out: 2 m"), end="")
    # left out: 2 m
    localizer = "li2012"
    <BLANKLINE>
    [settings]
    "map" = false
    "filter.max_particles" = 500
    """
    lines = [f"# {comment}", f"localizer = {json.dumps(localizer)}", "", "[settings]"]
    return "\n".join([*lines, *(f"{json.dumps(name)} = {json.dumps(value)}" for name, value in settings.items()), ""])


def _values(text: str) -> tuple[str, list[Any]]:
    """Name and values of a parameter; what is not JSON is text.

    >>> _values("sigma_m=0.5,1"), _values("map=none,true")
    (('sigma_m', [0.5, 1]), ('map', ['none', True]))
    """
    name, equals, values = text.partition("=")
    if not equals or not all(part.isidentifier() for part in name.split(".")) or not values:
        raise PdrbenchError(f"--param is NAME=VALUE,VALUE,...; got {text!r}")
    return name, [_value(value) for value in values.split(",")]


def _value(text: str) -> Any:
    try:
        return json.loads(text)
    except ValueError:
        return text


def _mean(values: FloatArray) -> float | None:
    """Over the walks that have a value; None where none has one."""
    present = values[~np.isnan(values)]
    return float(present.mean()) if len(present) else None


def _text(parameters: Any) -> str:
    return "–" if parameters is None else ", ".join(f"{name}={value}" for name, value in parameters.items())
