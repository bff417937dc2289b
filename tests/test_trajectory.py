from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import EstimateError, RecordingError
from pdrbench.trajectory import Estimates, Start, Trajectory


def make(**changes: object) -> Trajectory:
    fields = {"t_s": [0.0, 1.0, 2.0], "xy_m": np.eye(3, 2), "level": [0, 0, 1], "surveyed": [False, True, True]}
    return Trajectory(**(fields | changes))  # type: ignore[arg-type]


def test_arrays_cannot_be_changed_through_the_record_or_the_source() -> None:
    source = np.array([0.0, 1.0, 2.0])
    trajectory = make(t_s=source)
    source[0] = 99.0
    assert trajectory.t_s[0] == 0.0
    with pytest.raises(ValueError, match="read-only"):
        trajectory.xy_m[0, 0] = 1.0


def test_scored_keeps_the_surveyed_rows_and_a_start_needs_two_coordinates() -> None:
    scored = make(z_m=[0.0, 1.0, 2.0]).scored()
    assert scored.t_s.tolist() == [1.0, 2.0]
    assert scored.z_m is not None and scored.z_m.tolist() == [1.0, 2.0]
    assert scored.heading_rad is None
    with pytest.raises(RecordingError, match="two finite"):
        Start(xy_m=np.array([0.0, np.nan]), level=0)
    with pytest.raises(RecordingError, match="radius"):
        Start(xy_m=np.zeros(2), level=0, radius_m=-1.0)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"t_s": [0.0, 2.0, 1.0]}, "row 2"),
        ({"t_s": [0.0, 1.0, 1.0]}, "row 2"),
        ({"xy_m": np.full((3, 2), np.nan)}, "row 0"),
        ({"xy_m": np.zeros((2, 2))}, r"\(2, 2\), expected \(3, 2\)"),
        ({"heading_rad": [0.0]}, "heading_rad"),
        ({"z_m": [0.0, np.inf, 0.0]}, "row 1"),
    ],
)
def test_a_bad_reference_is_refused_by_row(changes: dict[str, object], message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        make(**changes)


def test_estimates_say_which_rows_were_given() -> None:
    nan = np.nan
    estimates = Estimates([0, 1, 2], [[0, 0], [nan, nan], [1, 1]], [0, nan, 0], [nan] * 3, [nan] * 3, [nan] * 3)
    assert estimates.given.tolist() == [True, False, True]
    with pytest.raises(EstimateError, match="non-decreasing"):
        Estimates([1, 0], np.zeros((2, 2)), [0, 0], [0, 0], [0, 0], [0, 0])
