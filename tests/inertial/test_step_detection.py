"""The step detector of Li et al. 2012: closed forms, its stages, any pieces, any rate, bad input."""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np
import pytest
from scipy.signal import firwin

from pdrbench.errors import RecordingError, UnknownNameError, UnsuitableError
from pdrbench.inertial.step_detection import STAGES, StepDetector, StepParams, Steps, find_steps, lowpass_taps

G = 9.80665
RATE_HZ = 50.0
STEP_S = 0.5


def rows_of(length: np.ndarray, rate_hz: float = RATE_HZ, begin_s: float = 0.0) -> np.ndarray:
    """Accelerometer rows with a vector of that length, in a direction that turns."""
    t_s = begin_s + np.arange(len(length)) / rate_hz
    turn = 0.3 * t_s
    ways = np.column_stack([np.cos(turn), np.sin(turn) * 0.6, np.sin(turn) * 0.8])
    return np.column_stack([t_s, ways * length[:, None]])


def waves(seconds: float, rate_hz: float = RATE_HZ, half_g: float = 0.3, step_s: float = STEP_S) -> np.ndarray:
    """|a| of steady steps: a sine around gravity."""
    t_s = np.arange(round(seconds * rate_hz)) / rate_hz
    return G * (1 + half_g * np.sin(2 * np.pi * t_s / step_s))


def together(parts: list[Steps]) -> np.ndarray:
    return np.column_stack([np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Steps)])


def noisy_walk(rng: np.random.Generator, seconds: float = 60.0) -> np.ndarray:
    """Two shapes in turn, a pause in the middle, noise."""
    t_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    phase = 2 * np.pi * 1.8 * t_s
    walks = (t_s < 0.4 * seconds) | (t_s > 0.6 * seconds)
    length = G + walks * (3.0 * np.sin(phase) + np.sin(phase / 2) + 0.6 * np.sin(2 * phase + 1))
    return rows_of(length + rng.normal(0, 0.2, len(t_s)))


@pytest.mark.parametrize("rate_hz", [20.0, 100.0])
def test_times_of_a_sine_are_its_own_at_any_rate(rate_hz):
    """Peaks a quarter of a period after the sine rises, gravity crossed after a half, valleys after three quarters."""
    steps = find_steps(rows_of(waves(20.0, rate_hz), rate_hz), rate_hz)
    assert len(steps) == pytest.approx(20 / STEP_S, abs=3)
    within_s = 0.5 / RATE_HZ + 1e-6 + (0.01 if rate_hz < RATE_HZ else 0.0)  # a sample; a coarse sine has its own peaks
    for times_s, phase in ((steps.peak_s, 0.25), (steps.end_s, 0.75), (steps.begin_s, 0.75)):
        off_s = (times_s / STEP_S - phase + 0.5) % 1.0 - 0.5
        assert np.abs(off_s * STEP_S).max() < within_s
    off_s = (steps.inference_s / STEP_S - 0.5 + 0.5) % 1.0 - 0.5
    assert np.abs(off_s * STEP_S).max() < 0.003 + (0.005 if rate_hz < RATE_HZ else 0.0)
    np.testing.assert_array_equal(steps.t_s, steps.end_s)
    np.testing.assert_allclose(steps.frequency_hz, 1 / STEP_S, rtol=0.05)


@pytest.mark.parametrize(("num_taps", "cutoff_hz"), [(31, 3.0), (3, 0.1)])
def test_taps_are_those_of_firwin(num_taps: int, cutoff_hz: float) -> None:
    expected = firwin(num_taps, cutoff_hz, fs=50.0)
    np.testing.assert_allclose(lowpass_taps(num_taps, cutoff_hz, 50.0), expected, rtol=1e-14, atol=1e-16)


@pytest.mark.parametrize("stage", STAGES)
def test_pieces_of_any_size_give_the_same_steps(rng, stage):
    rows = noisy_walk(rng)
    rows = rows[(rows[:, 0] < 42) | (rows[:, 0] > 43.3)]  # a gap
    whole = together([StepDetector(RATE_HZ, stage=stage).update(rows)])
    for cuts in ([], np.arange(len(rows)), np.sort(rng.integers(0, len(rows), 200))):
        detector = StepDetector(RATE_HZ, stage=stage)
        np.testing.assert_array_equal(together([detector.update(part) for part in np.split(rows, cuts)]), whole)


def test_steps_come_in_order_and_not_before_they_are_known(rng):
    rows = noisy_walk(rng)
    detector, ends_s = StepDetector(RATE_HZ), []
    for row in rows:
        steps = detector.update(row[None])
        assert (steps.found_s <= row[0] + 1e-9).all() and (steps.end_s < steps.found_s).all()
        ends_s += steps.end_s.tolist()
    assert (np.diff(ends_s) > 0).all() and len(ends_s) > 70


def test_validation_reports_the_first_steps_two_late_and_the_others_at_once():
    late_s = {}
    for stage in STAGES:
        steps = find_steps(rows_of(waves(20.0)), RATE_HZ, stage=stage)
        late_s[stage] = steps.found_s - steps.end_s
    assert late_s["PD"].max() < 0.31 + 0.02 + 0.12  # the filter, and until the curve has risen by Delta_a
    np.testing.assert_allclose(late_s["PD+H+DTW"][0] - late_s["PD+H"][0], 2 * STEP_S, atol=0.03)
    np.testing.assert_allclose(late_s["PD+H+DTW"][5:].max(), late_s["PD+H"][5:].max(), atol=1e-9)


def test_heuristics_remove_small_large_and_long_swings():
    gain = 0.79
    for half_g, is_step in ((0.05 / gain, False), (0.09 / gain, False), (0.12 / gain, True), (1.1 / gain, False)):
        rows = rows_of(waves(20.0, half_g=half_g) + max(half_g - 1, 0) * G)  # a length is never negative
        assert len(find_steps(rows, RATE_HZ, stage="PD")) > 35
        assert (len(find_steps(rows, RATE_HZ, stage="PD+H")) > 35) == is_step
    slow = rows_of(waves(40.0, step_s=1.2))
    assert len(find_steps(slow, RATE_HZ, stage="PD")) > 30
    assert len(find_steps(slow, RATE_HZ, stage="PD+H")) <= 1  # the first one began where the recording does


def test_waves_that_never_repeat_are_no_steps_and_every_second_one_has_to():
    """Left and right may differ as they like: each wave is compared with the one two before."""
    t_s = np.arange(0, 0.6, 1 / RATE_HZ)
    rise, fall = np.minimum(t_s / 0.15, (0.6 - t_s) / 0.45), np.minimum(t_s / 0.45, (0.6 - t_s) / 0.15)
    rows = rows_of(G + 8 * np.tile(np.concatenate([rise, fall]), 20) - 4)
    strict = replace(StepParams(), warp_limit=0.5, band=1)
    assert len(find_steps(rows, RATE_HZ, strict)) > 35
    in_pairs = rows_of(G + 8 * np.tile(np.concatenate([rise, rise, fall, fall]), 10) - 4)
    assert len(find_steps(in_pairs, RATE_HZ, strict, "PD+H")) > 35
    assert len(find_steps(in_pairs, RATE_HZ, strict)) < 5


def test_a_lone_bounce_passes_the_heuristics_and_not_the_validation():
    length = np.concatenate([np.full(500, G), waves(1.0), np.full(500, G)])
    counts = [len(find_steps(rows_of(length), RATE_HZ, stage=stage)) for stage in STAGES]
    assert counts[1] >= 1 and counts[2] == 0


def test_jitter_below_delta_a_and_shorter_than_delta_t_makes_no_peaks(rng):
    flat = rows_of(G * (1 + 0.03 * rng.standard_normal(3000)))
    assert len(find_steps(flat, RATE_HZ, stage="PD")) == 0
    fast = replace(StepParams(), cutoff_hz=20.0)
    rows = rows_of(waves(20.0) + 0.15 * G * np.sin(2 * np.pi * 8.0 * np.arange(1000) / RATE_HZ))
    assert len(find_steps(rows, RATE_HZ, replace(fast, gap_s=0.01), "PD")) > 60
    assert len(find_steps(rows, RATE_HZ, replace(fast, gap_s=0.3), "PD")) == pytest.approx(40, abs=3)


def test_a_gap_begins_anew_and_joins_nothing():
    rows = rows_of(waves(20.0))
    later = rows_of(waves(20.0), begin_s=70.0)
    steps = find_steps(np.concatenate([rows, later]), RATE_HZ)
    both = [find_steps(part, RATE_HZ) for part in (rows, later)]
    np.testing.assert_allclose(steps.peak_s, np.concatenate([part.peak_s for part in both]))


@pytest.mark.parametrize("rate_hz", [5.0, 0.0, float("nan")])
def test_too_few_samples_a_second_are_unsuitable(rate_hz):
    with pytest.raises(UnsuitableError, match="15 Hz or more"):
        StepDetector(rate_hz)


def test_stages_and_parameters_are_checked():
    with pytest.raises(UnknownNameError, match=r"did you mean 'PD\+H'"):
        StepDetector(RATE_HZ, stage="PD-H")  # type: ignore[arg-type]
    for wrong in ({"num_taps": 30}, {"cutoff_hz": 30.0}, {"swing_g": (2.0, 0.2)}):
        with pytest.raises(RecordingError, match="odd number of taps"):
            StepParams(**wrong)
