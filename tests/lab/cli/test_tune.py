from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

FILE = """
from dataclasses import dataclass
import numpy as np
from pdrbench.localizer import Estimate

@dataclass(frozen=True)
class Params:
    x_m: float = 0.0

class Ahead:
    def __init__(self, params=Params()):
        self.x_m = params.x_m
    def reset(self, briefing, rng):
        pass
    def step(self, observation):
        return Estimate(np.array([self.x_m, 0.0]), 0)
"""
ENV = ("--env", "BuildingSite-v1")


@pytest.fixture
def spec(tmp_path: Path) -> str:
    (tmp_path / "ahead.py").write_text(FILE)
    return f"{tmp_path / 'ahead.py'}:Ahead"


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
    assert f"to use: {spec}?x_m=0" in shown.out and "left out: mean_m" in shown.out
    options = ("--settings", tmp_path / "tuned" / "tuned.toml", "--split", "train", "--walks", 1, "--json")
    (row,) = command("run", spec, *ENV[1:], *options).json["rows"]
    assert row["localizer"] == f"{spec}?x_m=0"
    assert "its settings are of" in command("run", "stay", *ENV[1:], *options).err


def test_what_is_no_setting_is_one_line(command: Any) -> None:
    outcome = command("tune", "stay", *ENV, "--param", "x_m")
    assert outcome.code == 1 and "--param is NAME=VALUE" in outcome.err
    assert len(outcome.err.strip().splitlines()) == 1
    outcome = command("tune", "learned", *ENV, "--param", "parms=1")
    assert outcome.code == 1 and "learned has no setting 'parms'" in outcome.err
    outcome = command("tune", "woodman2008", *ENV, "--param", "most_sigma=1")
    assert outcome.code == 1 and "did you mean 'most_sigma_m'?" in outcome.err
