from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from pdrbench_lab.realism import walkthrough

NOTHING = SimpleNamespace(measured={})
FLOORS = {f"wifi_variogram_{distance}m": np.array([4.0, 5.0]) for distance in walkthrough.VARIOGRAM_M}


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
