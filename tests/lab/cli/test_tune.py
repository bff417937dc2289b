from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

FILE = """
import numpy as np
from pdrbench.localizer import Estimate

class Ahead:
    def __init__(self, x_m=0.0):
        self.x_m = x_m
    def reset(self, briefing, rng):
        self.start = briefing.start
    def step(self, observation):
        return Estimate(self.start.xy_m + np.array([self.x_m, 0.0]), self.start.level)
"""
ENV = ("--env", "OfficeStride-v2", "--isolation", "none")


@pytest.fixture
def spec(tmp_path: Path) -> str:
    (tmp_path / "ahead.py").write_text(FILE)
    return f"{tmp_path / 'ahead.py'}:Ahead"


@pytest.mark.long(seconds=15)
def test_the_left_out_figure_and_the_parameters_to_use(command: Any, spec: str, tmp_path: Path) -> None:
    options = ("--param", "x_m=0,500", "--folds", "2", "--out", tmp_path / "tuned")
    outcome = command("tune", spec, *ENV, *options, "--json")
    assert outcome.code == 0, outcome.err
    assert outcome.json["final"] == {"x_m": 0}
    assert [fold["parameters"] for fold in outcome.json["folds"]] == [{"x_m": 0}, {"x_m": 0}]
    walks = [fold["walks"] for fold in outcome.json["folds"]]
    mean_m = sum(n * fold["mean_m"] for n, fold in zip(walks, outcome.json["folds"], strict=True)) / sum(walks)
    assert outcome.json["left_out"]["value"] == pytest.approx(mean_m) and outcome.json["left_out"]["walks"] == sum(
        walks
    )
    shown = command("tune", spec, *ENV, *options)
    assert "to use: x_m=0" in shown.out and "left out: mean_m" in shown.out
    folds = command("run", spec, ENV[1], *ENV[2:], "--folds", "2", "--json").json["folds"]
    assert [fold["mean_m"] for fold in folds] == [fold["mean_m"] for fold in outcome.json["folds"]]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("tune", "stay-v0", *ENV, "--param", "x_m"), "--param is NAME=VALUE"),
        (("run", "stay-v0", "OfficeStride-v2", "--folds", "3", "--split", "val"), "folds are parts of the train split"),
    ],
)
def test_what_cannot_be_done_is_one_line(command: Any, arguments: tuple[object, ...], said: str) -> None:
    outcome = command(*arguments)
    assert outcome.code == 1 and said in outcome.err and len(outcome.err.strip().splitlines()) == 1
