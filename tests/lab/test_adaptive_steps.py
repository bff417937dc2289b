"""The adaptive detector counts steps of any size against what surrounds them, to the first and the last."""

from __future__ import annotations

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench.inertial import GENTLE, find_steps
from pdrbench_lab.adaptive_steps import AdaptiveStepParams, find_adaptive_steps

RATE_HZ = 50.0
G = 9.80665
WAVES = AdaptiveStepParams(closing=False)  # no step that shows no wave


def bout(
    num_steps: int, swing_g: float | np.ndarray, step_s: float | np.ndarray = 0.55, still_s: float = 1.0
) -> np.ndarray:
    """(n, 4) a phone that lies still, goes along for some steps, each a wave of so many g, and lies still."""
    swing, last = np.broadcast_to(swing_g, num_steps), np.cumsum(np.broadcast_to(step_s, num_steps))
    first = last - np.broadcast_to(step_s, num_steps)
    t_s = np.arange(0.0, 2 * still_s + last[-1], 1 / RATE_HZ)
    at = np.searchsorted(last, t_s - still_s, side="right").clip(max=num_steps - 1)
    phase = ((t_s - still_s - first[at]) / (last[at] - first[at])).clip(0.0, 1.0)
    length = G * (
        1.0 + 0.5 * swing[at] * -np.cos(2 * np.pi * phase) + 0.5 * np.where((phase > 0) & (phase < 1), 0, swing[at])
    )
    return np.column_stack([t_s, 0 * t_s, 0 * t_s, length])


@pytest.mark.parametrize("swing_g", [0.15, 0.3, 1.0])
@pytest.mark.parametrize("num_steps", [6, 40])
def test_every_step_is_counted_whatever_its_size(swing_g: float, num_steps: int) -> None:
    steps = find_adaptive_steps(bout(num_steps, swing_g), RATE_HZ, WAVES)
    assert len(steps) == num_steps
    np.testing.assert_allclose(steps.peak_s, 1.0 + 0.55 * (np.arange(num_steps) + 0.5), atol=0.06)
    assert (np.diff(steps.peak_s) > 0).all() and (steps.begin_s < steps.peak_s).all()


def test_a_recording_that_is_cut_at_both_ends_keeps_its_first_and_last_steps() -> None:
    rows = bout(10, 0.4, still_s=0.1)
    assert len(find_adaptive_steps(rows, RATE_HZ)) == 10
    assert len(find_steps(rows, RATE_HZ, GENTLE)) < 10  # what has no valley after it is not known to the stream


def test_a_smaller_first_and_last_step_belong_to_the_bout() -> None:
    swing_g = np.array([0.15, *[0.6] * 8, 0.15])
    assert len(find_adaptive_steps(bout(10, swing_g), RATE_HZ, WAVES)) == 10


def test_what_is_too_small_beside_the_steps_after_it_is_no_first_step() -> None:
    """0.15 g beside 0.6 g, of which the filter makes 0.46 of a step: who sets off leans forward before."""
    rows = bout(9, np.array([0.15, *[0.6] * 8]))
    assert len(find_adaptive_steps(rows, RATE_HZ, WAVES)) == 9
    assert len(find_adaptive_steps(rows, RATE_HZ, AdaptiveStepParams(first_fraction=0.5, closing=False))) == 8


@pytest.mark.parametrize(("still_s", "closed"), [(0.05, 0), (1.0, 1), (3.0, 1)])
def test_who_stops_after_a_whole_step_closes_the_feet(still_s: float, closed: int) -> None:
    """Where the recording goes on after it: cut at once, it may have been cut in mid-walk."""
    steps = find_adaptive_steps(bout(8, 0.4, still_s=still_s), RATE_HZ)
    assert len(steps) == 8 + closed
    assert (steps.swing_g == 0.0).sum() == closed and (np.diff(steps.peak_s) > 0.4).all()
    assert (steps.begin_s < steps.peak_s).all() and (steps.peak_s < steps.end_s).all()


def test_parts_of_a_walk_have_as_many_steps_as_peaks_whatever_the_phase_of_the_cuts() -> None:
    rows = bout(40, 0.4)
    found = []
    for phase_s in np.arange(0.0, 0.55, 0.05):
        part = rows[(rows[:, 0] >= 6.0 + phase_s) & (rows[:, 0] < 6.0 + phase_s + 20 * 0.55)]
        found.append(len(find_adaptive_steps(part, RATE_HZ)))
    assert abs(np.mean(found) - 20.0) < 0.3 and np.ptp(found) <= 2


def test_three_steps_are_a_walk_and_two_are_none() -> None:
    assert len(find_adaptive_steps(bout(3, 0.4), RATE_HZ, WAVES)) == 3
    assert len(find_adaptive_steps(bout(2, 0.4), RATE_HZ)) == 0


def test_shaking_that_lifts_the_phone_by_millimetres_is_no_walk() -> None:
    """0.15 g at 2.9 Hz are 4 mm, at 1.8 Hz 11 mm."""
    assert len(find_adaptive_steps(bout(20, 0.3, step_s=0.34), RATE_HZ)) == 0
    assert len(find_adaptive_steps(bout(20, 0.15), RATE_HZ, WAVES)) == 20


def test_what_is_small_beside_the_walk_is_no_step() -> None:
    """A phone that is put into a bag swings by 0.2 g, in a bag by 0.8 g; alone, 0.2 g are a walk."""
    handled, walked = bout(4, 0.2, step_s=0.8), bout(30, 0.8)
    walked[:, 0] += handled[-1, 0] + 1 / RATE_HZ
    assert len(find_adaptive_steps(np.concatenate([handled, walked]), RATE_HZ, WAVES)) == 30
    assert len(find_adaptive_steps(handled, RATE_HZ, WAVES)) == 4


def test_a_pocket_with_long_and_short_steps_in_turn_keeps_both() -> None:
    assert len(find_adaptive_steps(bout(30, 0.5, step_s=np.tile([0.4, 0.75], 15)), RATE_HZ, WAVES)) == 30


def test_a_bounce_within_a_step_is_none() -> None:
    """Every fifth step of a slow walk is two waves, of which the second is smaller."""
    steps = [(0.4, 0.4, 0.25, 0.2) if n % 5 == 2 else (0.4, 0.65) for n in range(20)]
    swing = [s for one in steps for s in ((one[0], one[3]) if len(one) == 4 else (one[0],))]
    lasts = [s for one in steps for s in ((one[1], one[2]) if len(one) == 4 else (one[1],))]
    assert len(find_adaptive_steps(bout(len(swing), np.array(swing), np.array(lasts)), RATE_HZ, WAVES)) == 20


def test_rest_has_no_steps_and_arrays_that_cannot_be_meant_are_refused(rng: np.random.Generator) -> None:
    t_s = np.arange(0.0, 30.0, 1 / RATE_HZ)
    still = np.column_stack([t_s, rng.normal([0, 0, G], 0.05, (len(t_s), 3))])
    assert len(find_adaptive_steps(still, RATE_HZ)) == 0
    with pytest.raises(RecordingError, match="looks like g"):
        find_adaptive_steps(still / [1, G, G, G], RATE_HZ)
    with pytest.raises(RecordingError, match="two steps or more"):
        AdaptiveStepParams(run=1)
