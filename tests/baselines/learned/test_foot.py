"""Learned stride and heading of a unit on a foot: its attitude, its frame, its network."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench.inertial import to_world
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_baselines.learned.attitude_sources import FOOT, FootSource
from pdrbench_baselines.learned.compiled import compiled_network
from pdrbench_baselines.learned.localizer import Learned
from pdrbench_baselines.learned.reckoning import Move, Reckoner
from pdrbench_sim.foot.known_walk import FootMotion, walk

PERIOD_S = 0.1
Rows = dict[str, FloatArray]


def rows_of(motion: FootMotion) -> Rows:
    """Rows of a perfect unit."""
    return {name: np.column_stack([motion.t_s, getattr(motion, name)]) for name in ("accel", "gyro")}


def strides(count: int = 8, **changes: float) -> Rows:
    return rows_of(walk(count, turn_rad=0.1, **changes))


def briefing(heading_rad: float | None = 0.0, rate_hz: float = 200.0, **changes: Any) -> Briefing:
    """A unit on a foot that begins at (5, 2)."""
    specs = {name: dataclasses.replace(sensor_spec(name), rate_hz=rate_hz) for name in ("accel", "gyro")}
    start = Start(np.array([5.0, 2.0]), 0, heading_rad=heading_rad)
    return Briefing(None, **({"sensors": specs, "period_s": PERIOD_S, "start": start, "mounting": FOOT} | changes))


def pieces(rows: Rows, chunk_s: float = PERIOD_S) -> list[tuple[float, Rows]]:
    """Times of observations and the rows since the one before."""
    count = math.ceil(max(one[-1, 0] for one in rows.values()) / chunk_s - 1e-9)
    ends_s = chunk_s * np.arange(count + 1)
    return [
        (
            now_s,
            {
                name: one[(one[:, 0] > now_s - chunk_s + 1e-9) & (one[:, 0] <= now_s + 1e-9)]
                for name, one in rows.items()
            },
        )
        for now_s in ends_s.tolist()
    ]


def moves(rows: Rows, given: Briefing | None = None, chunk_s: float = PERIOD_S) -> list[Move]:
    reckoner = Reckoner(compiled_network("foot"), given or briefing())
    return [move for _, part in pieces(rows, chunk_s) for move in reckoner.update(part)]


def answers(rows: Rows, given: Briefing | None = None) -> list[Estimate]:
    localizer = Learned()
    localizer.reset(given or briefing(), np.random.default_rng(0))
    return [localizer.step(Observation(now_s, part)) for now_s, part in pieces(rows)]


def test_rows_are_level_however_the_unit_is_mounted() -> None:
    motion = walk(4)
    upside_down = np.array([1.0, -1.0, -1.0])
    rows = {name: one * [1.0, *upside_down] for name, one in rows_of(motion).items()}
    out = FootSource(200.0).update(rows)
    np.testing.assert_allclose(out["rotation"][0, 1:], [1.0, 0.0, 0.0, 0.0], atol=1e-6)
    turned = to_world(out["rotation"][:, 1:], out["accel"][-len(out["rotation"]) :, 1:])
    resting = motion.is_rest[-len(turned) :]
    np.testing.assert_allclose(turned[resting].mean(axis=0), [0.0, 0.0, 9.81], atol=0.1)


def test_the_frame_is_aligned_with_the_given_heading() -> None:
    rows = FootSource(200.0, heading_rad=1.0)
    for _, part in pieces(strides(1)):
        rows.update(part)
        if part["accel"][-1, 0] < 1.5:
            assert rows.turn_rad is None  # on the way
    for _, part in pieces(rows_of(walk(3))):
        later = {name: one + np.array([10.0, 0.0, 0.0, 0.0]) for name, one in part.items()}
        rows.update(later)
    assert rows.turn_rad == pytest.approx(1.0, abs=0.15)  # of a first stride that turns by 0.1


def test_rotating_the_walk_rotates_the_estimate() -> None:
    angle_rad = 2.1
    one, two = (np.array([estimate.xy_m for estimate in answers(strides(), briefing(rad))]) for rad in (0.0, angle_rad))
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    about = (one - [5.0, 2.0]) @ np.array([[c, s], [-s, c]]) + [5.0, 2.0]
    assert np.hypot(*(one[-1] - one[0])) > 3.0
    np.testing.assert_allclose(two, about, atol=1e-4)


def test_without_a_heading_the_frame_is_that_of_the_unit() -> None:
    first = [move.move_m for move in moves(strides(), briefing(None))]
    turned = [move.move_m for move in moves(strides(), briefing(0.1))]
    angles = [
        math.atan2(*(b @ [[0, 1], [1, 0]])) - math.atan2(*(a @ [[0, 1], [1, 0]]))
        for a, b in zip(first, turned, strict=True)
    ]
    wrapped = (np.array(angles) + math.pi) % (2 * math.pi) - math.pi
    assert np.ptp(wrapped) < 1e-5


def test_a_walk_with_a_gap_stays_finite() -> None:
    rows = strides(10)
    for names in (("accel", "gyro"), ("gyro",)):
        torn = {
            name: one[(one[:, 0] < 4.2) | (one[:, 0] > 7.3)] if name in names else one for name, one in rows.items()
        }
        found = moves(torn)
        assert all(np.isfinite(move.move_m).all() and np.isfinite(move.covariance_m2).all() for move in found)
        assert any(move.is_guess for move in found) and not found[-1].is_guess
        assert found[-1].end_s == moves(rows)[-1].end_s


def test_other_units_and_times_that_go_back_are_refused() -> None:
    in_g = strides()
    in_g["accel"][:, 1:] /= 9.80665
    with pytest.raises(RecordingError, match=r"multiply by 9\.80665"):
        moves(in_g)
    in_degrees = strides()
    in_degrees["gyro"][:, 1:] *= 57.3
    with pytest.raises(RecordingError, match="multiply by pi/180"):
        moves(in_degrees)
    back = strides()
    back["gyro"][900:, 0] -= 1.0
    with pytest.raises(RecordingError, match="order of time"):
        Reckoner(compiled_network("foot"), briefing()).update(back).__next__()
    with pytest.raises(RecordingError, match="comes at 50 Hz"):
        moves({name: one[::4] for name, one in strides().items()})  # briefed as 200 Hz
