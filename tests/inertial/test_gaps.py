"""Rows that are left out are counted; over gaps strides of a steady walk come back, however the stream is cut."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.inertial import FootParams, navigate
from pdrbench.inertial.checks import clean_rows
from pdrbench.inertial.gaps import GapFiller
from pdrbench_sim.foot.known_walk import walk

RATE_HZ = 200.0


def steady(lasts_s: float, rate_hz: float = RATE_HZ) -> FloatArray:
    """(n, 7) samples of a foot that repeats itself every 1.1 s."""
    t_s = np.arange(0.0, lasts_s, 1 / rate_hz)
    phase = 2 * np.pi * t_s / 1.1
    waves = [
        a * np.sin(k * phase + k) + b
        for k, a, b in ((1, 5, 0), (2, 3, 1), (3, 4, 9.8), (1, 2, 0), (2, 4, 0), (3, 1, 0))
    ]
    return np.column_stack([t_s, *waves])


def without(rows: FloatArray, *gaps: tuple[float, float]) -> FloatArray:
    kept = np.ones(len(rows), dtype=bool)
    for low, high in gaps:
        kept &= (rows[:, 0] < low) | (rows[:, 0] > high)
    return rows[kept]


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 400.0])
@pytest.mark.parametrize("lasts_s", [0.1, 0.6, 0.95])
def test_a_foot_that_repeats_itself_is_carried_on_as_it_went(rate_hz: float, lasts_s: float) -> None:
    whole = steady(12.0, rate_hz)
    filled, is_made = GapFiller(rate_hz, 1.0).fill(without(whole, (9.0, 9.0 + lasts_s)))
    assert len(filled) == len(whole)
    assert np.count_nonzero(is_made) == pytest.approx(lasts_s * rate_hz, abs=1)
    assert (np.diff(filled[:, 0]) > 0).all()
    np.testing.assert_array_equal(filled[~is_made], without(whole, (9.0, 9.0 + lasts_s)))
    swing = np.abs(np.diff(whole[:, 1:], axis=0)).max()  # the period is no whole number of samples
    assert np.abs(filled - whole).max() < swing


@pytest.mark.parametrize(
    ("gap", "why"),
    [
        ((0.2, 0.7), "nothing was seen before"),
        ((9.0, 9.005), "it is short"),
        ((9.0, 10.5), "it is longer than a second"),
    ],
)
def test_a_gap_is_left_as_it_is(gap: tuple[float, float], why: str) -> None:
    rows = without(steady(12.0), gap)
    filled, is_made = GapFiller(RATE_HZ, 1.0).fill(rows)
    assert not is_made.any(), why
    np.testing.assert_array_equal(filled, rows)


def test_pieces_give_what_the_whole_gives(rng: np.random.Generator) -> None:
    rows = without(steady(80.0), (9.0, 9.6), (9.7, 10.1), (31.0, 31.9), (70.0, 70.4))
    rows[:, 1:] += rng.normal(0, 0.1, (len(rows), 6))
    whole, is_made = GapFiller(RATE_HZ, 1.0).fill(rows)
    after_a_gap = np.flatnonzero(np.diff(rows[:, 0]) > 0.1) + 1
    cuts = sorted({0, len(rows), *after_a_gap.tolist(), *rng.integers(1, len(rows), 50).tolist()})
    filler = GapFiller(RATE_HZ, 1.0)
    parts = [filler.fill(rows[low:high]) for low, high in pairwise(cuts)]
    np.testing.assert_array_equal(np.concatenate([part[0] for part in parts]), whole)
    np.testing.assert_array_equal(np.concatenate([part[1] for part in parts]), is_made)


def test_steady_strides_lose_little_by_gaps(measure: Any, rng: np.random.Generator) -> None:
    """Half a second in eight is missing: a foot that walks on ends where it did, and sigma knows how sure it is."""
    motion = walk(40)
    measured = measure(motion, rng)
    kept = (motion.t_s < 9.0) | (motion.t_s % 8.0 > 0.5)
    with pytest.warns(match="gaps of 0.5"):
        states = navigate(*(values[kept] for values in measured))
        left = navigate(*(values[kept] for values in measured), replace(FootParams(), carried_s=0.0))
    assert len(states) == np.count_nonzero(kept)
    off_m, off_left_m = (np.linalg.norm(s.position_m[-1] - motion.position_m[-1]) for s in (states, left))
    assert off_m < min(off_left_m / 3, 3 * states.sigma_m[-1])
    whole = navigate(*measured)
    assert states.sigma_m[-1] > 3 * whole.sigma_m[-1]


@pytest.fixture
def measured(measure: Any, rng: Any) -> Any:
    return measure(walk(6, tilt_rad=0.8), rng)


def test_omitted_rows_are_counted(measured: Any) -> None:
    t_s, accel, gyro = (v.copy() for v in measured)
    accel[10, 1], gyro[20, 2], t_s[30] = np.nan, np.inf, np.nan
    t_s[41] = t_s[40]
    rows = clean_rows(t_s, accel, gyro)
    assert rows.dropped == {"not finite": 3, "repeats the time before": 1, "repeats the sample before": 0}
    assert sorted(set(range(len(t_s))) - set(rows.kept.tolist())) == [10, 20, 30, 41]
    assert (np.diff(rows.t_s) > 0).all()
    np.testing.assert_array_equal(rows.accel, accel[rows.kept])
    np.testing.assert_array_equal(rows.gyro, gyro[rows.kept])


def test_a_field_of_another_length_is_refused(measured: Any) -> None:
    with pytest.raises(RecordingError, match="field: expected one row per sample"):
        navigate(*measured, field=np.zeros((3, 3)))
