"""Positions of an inertial system and their errors, in both readings."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError, RecordingError
from pdrbench.sensors.position import PositionErrors
from pdrbench_lab.papers.koeping2012.positions import measure

T_S = np.arange(0.0, 121.0)
STILL_M = np.zeros((len(T_S), 2))


def errors_m(reading: str, count: int = 4000) -> np.ndarray:
    """(count, T, 2) errors of as many walks."""
    return np.array([measure(T_S, STILL_M, np.random.default_rng([7, k]), reading)[:, 1:] for k in range(count)])


@pytest.mark.parametrize("reading", ["iid", "drift"])
def test_variance_grows_evenly_with_time(reading: str) -> None:
    drawn_m = errors_m(reading)
    for at in (0, 60, 120):
        # 8000 squares of normal numbers: relative standard deviation sqrt(2 / 8000) = 1.6 %
        assert (drawn_m[:, at] ** 2).mean() == pytest.approx(0.3**2 + 0.02 * at, rel=0.08)
    assert np.abs(drawn_m[:, 120].mean(axis=0)).max() < 5 * 1.58 / np.sqrt(4000)


def test_the_two_readings_differ_in_their_correlation_over_time() -> None:
    for reading, least, most in (("iid", -0.05, 0.05), ("drift", 0.95, 1.0)):
        drawn_m = errors_m(reading, 1000)
        assert least < np.corrcoef(drawn_m[:, 120].ravel(), drawn_m[:, 115].ravel())[0, 1] < most
    steps_m = np.diff(errors_m("drift", 200), axis=1)
    assert (steps_m**2).mean() == pytest.approx(0.02, rel=0.05)


def test_a_finer_rhythm_has_the_same_drift() -> None:
    fine_s = np.arange(0.0, 100.1, 0.25)
    ends_m = [
        measure(fine_s, np.zeros((len(fine_s), 2)), np.random.default_rng(k), "drift")[-1, 1:] for k in range(2000)
    ]
    assert np.mean(np.square(ends_m)) == pytest.approx(0.09 + 2.0, rel=0.12)


def test_longer_walks_begin_as_shorter_ones_and_seeds_decide_everything() -> None:
    for reading in ("iid", "drift"):
        whole = measure(T_S, STILL_M, np.random.default_rng(1), reading)
        part = measure(T_S[:50], STILL_M[:50], np.random.default_rng(1), reading)
        assert whole[:50].tobytes() == part.tobytes()


def test_without_errors_it_measures_the_truth() -> None:
    path_m = np.column_stack([T_S, -T_S])
    for reading in ("iid", "drift"):
        rows = measure(T_S, path_m, np.random.default_rng(0), reading, PositionErrors(0.0, 0.0))
        assert np.array_equal(rows, np.column_stack([T_S, path_m]))


def test_bad_input_is_refused() -> None:
    rng = np.random.default_rng(0)
    with pytest.raises(PdrbenchError, match="did you mean 'drift'"):
        measure(T_S, STILL_M, rng, "drif")  # type: ignore[arg-type]
    with pytest.raises(RecordingError, match="increase"):
        measure(np.array([0.0, 1.0, 1.0]), np.zeros((3, 2)), rng, "iid")
    with pytest.raises(RecordingError, match=r"t_s \(T,\)"):
        measure(T_S, np.zeros((3, 2)), rng, "iid")
    with pytest.raises(RecordingError, match="q_m2ps"):
        PositionErrors(q_m2ps=float("nan"))
