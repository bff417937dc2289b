"""Figures of a scorecard, from values in closed form."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdrbench_lab.realism import load_block
from pdrbench_lab.realism.measure import RealSource, measure
from pdrbench_lab.realism.pictures import block_figure, draw_blocks
from pdrbench_lab.realism.scorecard import make_scorecard
from pdrbench_lab.realism.targets import EMPTY

WALK = "toy_blocks:WALK"

pytestmark = pytest.mark.usefixtures("toys")


def test_a_panel_for_each_statistic_says_whether_it_passes() -> None:
    measured = measure(WALK, RealSource(), 0, None)
    found = make_scorecard([measured], part="judge", seed=0, stored=EMPTY)
    rows = {row.statistic: row for row in found.rows}
    figure = block_figure(load_block(WALK), measured, rows)
    assert figure is not None
    titles = [ax.get_title() for ax in figure.axes]
    assert titles == [
        "time of a step: passes",
        "spread of errors: passes",
        "walks of a set: passes",
        "scaling exponent: passes",
    ]
    curves = [line.get_xdata() for line in figure.axes[0].lines]
    assert len(curves) == 3  # synthetic, real, the real median
    assert np.unique(np.asarray(curves[2])) == pytest.approx(0.55)
    low, high = figure.axes[0].get_xlim()
    assert low < 0.49 + 0.001 and high > 0.61 - 0.001
    assert figure.axes[3].get_xlim()[0] < 0.73  # the published range is in view


def test_one_far_value_does_not_squeeze_the_rest() -> None:
    measured = measure(WALK, RealSource(), 0, 1000)
    assert measured.synthetic is not None
    far = np.append(measured.synthetic["step_s"], 1e6)
    changed = type(measured)(WALK, measured.origin, measured.real, {**measured.synthetic, "step_s": far})
    found = make_scorecard([changed], part="judge", seed=0, stored=EMPTY)
    figure = block_figure(load_block(WALK), changed, {row.statistic: row for row in found.rows})
    assert figure is not None and figure.axes[0].get_xlim()[1] < 1.0


def test_the_same_values_give_the_same_files_and_a_broken_block_none(tmp_path: Path) -> None:
    measured = [measure(name, RealSource(), 0, None) for name in (WALK, "toy_blocks:BROKEN", "toy_blocks:PUBLISHED")]
    found = make_scorecard(measured, part="judge", seed=0, stored=EMPTY)
    names = ["toy_blocks.WALK.png", "toy_blocks.PUBLISHED.png"]
    (tmp_path / "two").mkdir()
    assert [path.name for path in draw_blocks(found, tmp_path)] == names
    assert [path.name for path in draw_blocks(found, tmp_path / "two")] == names
    assert all((tmp_path / name).read_bytes() == (tmp_path / "two" / name).read_bytes() for name in names)
