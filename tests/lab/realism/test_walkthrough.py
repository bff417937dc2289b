from __future__ import annotations

from types import SimpleNamespace

import matplotlib.image
import numpy as np
import pytest

from pdrbench_lab.realism import walkthrough

NOTHING = SimpleNamespace(measured={})
FLOORS = {f"wifi_variogram_{distance}m": np.array([4.0, 5.0]) for distance in walkthrough.VARIOGRAM_M}


@pytest.mark.long(seconds=10)
def test_pictures_are_drawn_without_recordings(tmp_path, monkeypatch):
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path / "nowhere"))
    monkeypatch.setattr(walkthrough, "NUM_WALKS", 1)
    monkeypatch.setattr(walkthrough, "CELL_M", 12.0)
    files = walkthrough.draw_walkthrough(NOTHING, tmp_path)
    assert [file.name for file in files] == ["signals.png", "spectra.png", "fields.png"]
    for file in files:
        assert matplotlib.image.imread(file).std() > 0.05  # not an empty sheet


@pytest.mark.parametrize("num_real", [0, 1])
def test_every_floor_is_a_line_of_the_variogram(num_real):
    real = SimpleNamespace(statistics={name: SimpleNamespace(values=[6.0] * num_real) for name in FLOORS})
    measured = SimpleNamespace(synthetic=FLOORS, real=real if num_real else None)
    figure = walkthrough._variogram(SimpleNamespace(measured={"radio": measured}))
    assert figure is not None
    (ax,) = figure.axes
    assert len(ax.lines) == 2 + num_real
    np.testing.assert_array_equal(ax.lines[0].get_ydata(), [4.0] * 4)
    np.testing.assert_array_equal(ax.lines[0].get_xdata(), walkthrough.VARIOGRAM_M)
