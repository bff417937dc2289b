from __future__ import annotations

import numpy as np
import pytest

from pdrbench.inertial import DETECTORS, LITERAL, FieldParams, FootFilter, FootParams, navigate_smoothed
from pdrbench.inertial.foot_filter import run
from pdrbench.inertial.foot_kernels import advance
from pdrbench.inertial.foot_smoother import smooth
from pdrbench.inertial.warm import warm_up
from pdrbench.inertial.zero_velocity import _shoe, held_s, statistic
from pdrbench_lab.foot_ins import bench as inertial


@pytest.mark.long(seconds=10)
@pytest.mark.parametrize("params", [LITERAL, FootParams()], ids=["9", "17"])
def test_both_sides_do_the_same(params: FootParams) -> None:
    """A ratio is of the same work: the filter and the plain one end at the same place."""
    case = inertial._Case.of(inertial._measured(1, 1), params)
    memory = case.start.copy()
    run(memory, case.states, case.accel, case.gyro, case.field, case.noise)
    np.testing.assert_allclose(case.plain().x, case.states.x, atol=1e-9)
    assert case.start.x[0] == 0.0 != memory.x[0]  # what is timed again starts where it did


@pytest.mark.parametrize("kind", ["shoe", "are", "mv", "mag", "soft"])
def test_both_detectors_do_the_same(kind: str) -> None:
    measured = inertial._measured(1, 1)
    compiled, plain = (inertial._detected(kind, of, *measured) for of in (statistic, inertial.plain_statistic))
    np.testing.assert_allclose(compiled, plain, rtol=1e-9)
    assert kind in DETECTORS


@pytest.mark.long(seconds=12)
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


@pytest.mark.long(seconds=35)
def test_the_inertial_bench_has_its_rows() -> None:
    lines: list[str] = []
    rows = {row.name: row for row in inertial.run(True, lines.append)}
    filters = {"filter_9", "filter_17", "smoother_9", "smoother_17"}
    assert {*filters, "shoe", "are", "mv", "mag", "soft", "walks_16", "real_time"} <= set(rows)
    assert lines
    for row in rows.values():
        assert row.value > 0
        assert row.ratio is None or (row.ratio > 0 and row.against)
    for name in filters:
        assert rows[name].ratio > 10  # type: ignore[operator]  # a goal of 200 is for a machine with nothing else to do
