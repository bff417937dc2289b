from __future__ import annotations

import numpy as np
import pytest

from pdrbench.inertial import DETECTORS, LITERAL, FieldParams, FootFilter, FootParams, navigate_smoothed
from pdrbench.inertial.foot_kernels import advance
from pdrbench.inertial.foot_smoother import smooth
from pdrbench.inertial.warm import warm_up
from pdrbench.inertial.zero_velocity import _shoe, held_s, statistic
from pdrbench_lab.foot_ins import bench as inertial


@pytest.mark.parametrize("kind", ["shoe", "are", "mv", "mag", "soft"])
def test_both_detectors_do_the_same(kind: str) -> None:
    measured = inertial._measured(1, 1)
    compiled, plain = (inertial._detected(kind, of, *measured) for of in (statistic, inertial.plain_statistic))
    np.testing.assert_allclose(compiled, plain, rtol=1e-9)
    assert kind in DETECTORS


def test_nothing_is_left_to_compile_after_warming_up() -> None:
    """Whatever way samples come: columns of one table, read-only, in pieces."""
    warm_up()
    kernels = (advance, smooth, held_s, _shoe)
    known = [len(kernel.signatures) for kernel in kernels]
    table = np.column_stack(inertial._measured(1, 1))
    table.flags.writeable = False
    columns = (table[:, 0], table[:, 1:4], table[:, 4:7])
    for params in (LITERAL, FootParams(), FootParams(field=FieldParams())):
        navigate_smoothed(*columns, params)
        footing = FootFilter(200.0, params)
        for low in range(0, len(table), 50):
            pieces = [np.ascontiguousarray(column[low : low + 50]) for column in columns]
            for piece in pieces:
                piece.flags.writeable = False
            footing.update(*(pieces if low else [column[:50] for column in columns]), columns[1][low : low + 50])
    assert [len(kernel.signatures) for kernel in kernels] == known
