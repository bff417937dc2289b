from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench_baselines.li2012.turns import Turn, TurnDetector, TurnParams


def turns_of(headings_rad: np.ndarray) -> list[tuple[int, Turn]]:
    """Turns, each with the step at which it became known."""
    detector = TurnDetector()
    found = [(k, detector.update(float(heading_rad))) for k, heading_rad in enumerate(headings_rad)]
    return [(k, turn) for k, turn in found if turn is not None]


@pytest.mark.parametrize("angle_deg", [90.0, -90.0, 60.0, 180.0])
@pytest.mark.parametrize("begin_rad", [0.0, 3.0, -3.0])
def test_a_turn_is_found_where_it_is(angle_deg: float, begin_rad: float, rng: np.random.Generator) -> None:
    """Two steps of corner after step 19; 5 degrees of noise, wrapped at half a turn."""
    heading_rad = begin_rad + math.radians(angle_deg) * np.interp(np.arange(45), [19, 22], [0, 1])
    noisy = np.angle(np.exp(1j * (heading_rad + np.radians(5) * rng.standard_normal(45))))
    found = turns_of(noisy)
    assert len(found) == 1
    known_at, turn = found[0]
    assert turn.begin == pytest.approx(20, abs=3)
    assert turn.salient == pytest.approx(21, abs=2)
    assert turn.begin <= turn.salient <= turn.end
    assert turn.end == pytest.approx(22, abs=3)
    assert turn.angle_rad == pytest.approx(math.radians(angle_deg), abs=math.radians(8))
    assert turn.end + TurnParams().lag_steps <= known_at <= turn.end + TurnParams().lag_steps + 6


def test_a_straight_walk_and_single_jumps_are_no_turns(rng: np.random.Generator) -> None:
    """A 9-point median passes over four wrong headings in a row (a magnet by the way)."""
    headings = np.radians(10) * rng.standard_normal(200)
    headings[50:54] += 2.0
    headings[100] += math.pi
    assert turns_of(headings) == []


def test_the_mean_begins_anew_after_a_turn_and_less_than_the_threshold_is_none() -> None:
    """A loop of four corners is four turns, though the last leads back to the first heading."""
    heading_rad = np.repeat(np.arange(5) * math.pi / 2, 20)
    found = [turn.angle_rad for _, turn in turns_of(np.angle(np.exp(1j * heading_rad)))]
    assert found == pytest.approx([math.pi / 2] * 4, abs=0.05)
    heading_rad = math.radians(1) * np.repeat([0.0, 40.0], 30)
    assert turns_of(heading_rad) == []
    assert len(turns_of(heading_rad * 1.25)) == 1


@pytest.mark.parametrize(
    "wrong", [{"median_steps": 8}, {"mean_steps": 0}, {"threshold_rad": 0.0}, {"steady_rad": -1.0}]
)
def test_bad_settings_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(PdrbenchError, match="turns:"):
        TurnParams(**wrong)  # type: ignore[arg-type]
