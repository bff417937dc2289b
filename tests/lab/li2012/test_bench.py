"""`pdrbench bench phone`: both sides of a ratio do the same work; the other library may be absent."""

from __future__ import annotations

import numpy as np

from pdrbench.inertial.step_detection import find_steps
from pdrbench_lab.papers.li2012 import bench as phone


def test_both_detectors_find_the_same_steps() -> None:
    rows = phone.walk(30.0)
    found = find_steps(rows, 50.0)
    np.testing.assert_allclose(found.peak_s, phone.plain_steps(rows)[:, 1], atol=1e-9)
    assert 40 < len(found) < 60


def test_rows_of_step_detection() -> None:
    rows = {row.name: row for row in phone._detection(20.0, 5)}
    assert rows["steps"].value > 0 and rows["steps"].ratio is not None
    assert rows["steps_real_time"].value > 10


def test_rows_of_warping_without_the_other_library(monkeypatch) -> None:
    monkeypatch.setattr(phone, "_other", lambda: None)
    rows = {row.name: row for row in phone._warping(20, 1)}
    assert set(rows) == {"warping_all", "warping_one", "warping_twin"}
    assert rows["warping_all"].against == phone.WITHOUT_OTHER and rows["warping_all"].ratio is None


def test_the_other_library_is_given_the_same_work(monkeypatch) -> None:
    class Other:
        """Replaces dtaidistance."""

        calls: list[tuple[str, int | None]] = []

        def distance_matrix_fast(self, waves, *, window, parallel, compact):
            assert not parallel and not compact
            self.calls.append(("all", window))

        def distance_fast(self, one, other, *, window):
            self.calls.append(("one", window))

    monkeypatch.setattr(phone, "_other", Other)
    rows = {row.name: row for row in phone._warping(20, 1)}
    assert rows["warping_all"].ratio is not None and phone.OTHER in rows["warping_all"].against
    assert set(Other.calls) == {("all", 11), ("one", 11)}  # it counts the diagonal: a band of 10 on either side
