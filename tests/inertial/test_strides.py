from __future__ import annotations

import itertools

import numpy as np
import pytest

from pdrbench.geometry import FloatArray
from pdrbench.inertial import FootStates, Rest, StrideParams, StrideSegmenter, find_strides

RATE_HZ = 200.0


def states_of(t_s: FloatArray, xyz_m: FloatArray, yaw_rad: FloatArray, sigma_mps: FloatArray) -> FootStates:
    """The states of a perfect filter."""
    count = len(t_s)
    x = np.zeros((count, 16))
    x[:, :3] = xyz_m
    x[:, 6], x[:, 9] = np.cos(yaw_rad / 2), np.sin(yaw_rad / 2)
    rest = Rest(sigma_mps, np.full(count, np.inf), np.zeros(count))
    return FootStates(t_s, x, np.zeros((count, 4, 4)), rest, np.zeros(count))


def walk(
    places_m: list[tuple[float, float, float]], yaws_rad: list[float], *, rest_s: float = 0.4, swing_s: float = 0.6,
    rest_sigma: float = 0.02,
) -> FootStates:  # fmt: skip
    """A foot that stands at one place after the other; its velocity is surest in the middle of each rest."""
    rest, swing = round(rest_s * RATE_HZ), round(swing_s * RATE_HZ)
    xyz, yaw, sigma = [], [], []
    for index, (place, turn) in enumerate(zip(places_m, yaws_rad, strict=True)):
        if index:
            progress = (1 - np.cos(np.pi * np.arange(swing) / swing))[:, None] / 2
            before = np.array(places_m[index - 1])
            xyz.append(before + progress * (np.array(place) - before))
            yaw.append(yaws_rad[index - 1] + progress[:, 0] * (turn - yaws_rad[index - 1]))
            sigma.append(np.full(swing, np.inf))
        xyz.append(np.tile(place, (rest, 1)))
        yaw.append(np.full(rest, turn))
        sigma.append(rest_sigma * (1 + np.abs(np.linspace(-1, 1, rest))))
    t_s = np.arange(sum(len(part) for part in yaw)) / RATE_HZ
    return states_of(t_s, np.concatenate(xyz), np.concatenate(yaw), np.concatenate(sigma))


SQUARE = [(0.0, 0.0, 0.0), (1.4, 0.0, 0.1), (1.4, 1.4, 0.2), (0.0, 1.4, 0.0), (0.0, 0.0, 0.0)]


def test_strides_lead_from_rest_to_rest() -> None:
    strides = find_strides(walk(SQUARE, [0.0] * 5))
    np.testing.assert_allclose(strides.length_m, 1.4, atol=1e-12)
    np.testing.assert_allclose(strides.rise_m, [0.1, 0.1, -0.2, 0.0], atol=1e-12)
    np.testing.assert_allclose(strides.turn_rad, [0, np.pi / 2, np.pi / 2, np.pi / 2], atol=1e-12)
    np.testing.assert_allclose(strides.end_xyz_m, SQUARE[1:], atol=1e-12)
    np.testing.assert_allclose(strides.start_xyz_m, SQUARE[:-1], atol=1e-12)


def test_adding_strides_gives_the_path_back() -> None:
    """Woodman & Harle, eq. (9)-(11): turn first, then move; the first heading is the frame's own."""
    rng = np.random.default_rng(4)
    places = np.cumsum(np.vstack([np.zeros(3), rng.normal(0.0, 1.0, (20, 3))]), axis=0)
    strides = find_strides(walk([tuple(place) for place in places], list(rng.normal(0, 1, 21))))
    heading_rad = strides.heading_rad[0] + np.cumsum(strides.turn_rad)
    steps = strides.length_m[:, None] * np.column_stack([np.cos(heading_rad), np.sin(heading_rad)])
    np.testing.assert_allclose(np.cumsum(steps, axis=0), places[1:, :2], atol=1e-9)
    np.testing.assert_allclose(np.cumsum(strides.rise_m), places[1:, 2], atol=1e-9)


def test_heading_and_yaw_are_kept_apart_and_a_stride_in_place_carries_the_yaw() -> None:
    """W3: a foot moved by less than 0.1 m has no heading; turning on the spot still counts."""
    places = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (1.0, 0.05, 0.0), (1.0, 1.05, 0.0)]
    strides = find_strides(walk(places, [0.0, 0.0, np.pi / 2, np.pi / 2]))
    np.testing.assert_allclose(strides.turn_rad, [0.0, np.pi / 2, 0.0], atol=1e-9)
    np.testing.assert_allclose(strides.heading_rad, [0.0, np.pi / 2, np.pi / 2], atol=1e-9)
    # A foot that points outwards by 0.2 rad does not turn the walk; the step sensor takes it back (F8).
    places = [(0.0, 0.0, 0.0), (1.0, 0.0, 0.0), (2.0, 0.0, 0.0)]
    strides = find_strides(walk(places, [0.2, 0.2, 0.5]))
    np.testing.assert_allclose(strides.heading_rad, 0.0, atol=1e-12)
    np.testing.assert_allclose(strides.yaw_turn_rad, [0.0, 0.3], atol=1e-9)
    np.testing.assert_allclose(strides.steps(misalignment_rad=-0.2), [[1.0, 0.0, 0.0], [1.0, 0.0, 0.3]], atol=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_the_cut_of_the_stream_does_not_matter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    states = walk(SQUARE * 3, list(rng.normal(0, 1, 15)))
    whole = find_strides(states)
    cuts = np.sort(rng.integers(0, len(states), 40))
    segmenter = StrideSegmenter()
    bounds = [0, *cuts.tolist(), len(states)]
    parts = [segmenter.update(states.part(slice(a, b))) for a, b in itertools.pairwise(bounds)]
    for name in whole._fields:
        np.testing.assert_array_equal(np.concatenate([getattr(part, name) for part in parts]), getattr(whole, name))


def test_a_stride_is_reported_once_the_foot_has_rested_a_little_and_not_before() -> None:
    params = StrideParams(hold_s=0.05)
    states = walk(SQUARE[:2], [0.0, 0.0])
    (known_s,) = find_strides(states, params).known_s.tolist()
    began = states.t_s[np.flatnonzero(np.isinf(states.rest.sigma_mps))[-1] + 1]
    assert known_s == pytest.approx(began + 0.05, abs=1.5 / RATE_HZ)
    assert not len(find_strides(states.part(slice(0, round((known_s - 0.01) * RATE_HZ))), params).known_s)


def test_creep_during_a_rest_is_not_lost_and_a_foot_that_stands_makes_no_strides() -> None:
    states = walk(SQUARE, [0.0] * 5)
    states.x[:, 0] += 0.05 * states.t_s
    strides = find_strides(states)
    np.testing.assert_array_equal(strides.start_xyz_m[1:], strides.end_xyz_m[:-1])
    states = walk([(0.0, 0.0, 0.0)], [0.0], rest_s=30.0)
    states.x[:, 0] += 0.01 * np.sin(states.t_s)
    assert not len(find_strides(states).length_m)


def test_strides_of_a_running_foot_end_at_its_slowest_moments_and_a_walking_swing_is_none() -> None:
    places = [(2.0 * k, 0.0, 0.0) for k in range(8)]
    states = walk(places, [0.0] * 8, rest_s=0.1, swing_s=0.65, rest_sigma=0.2)
    strides = find_strides(states)
    assert len(strides.length_m) == 6  # the last stance is not over yet
    np.testing.assert_allclose(strides.length_m, 2.0, atol=1e-9)
    # In mid-swing sigma dips to 0.5 m/s: no rest for a foot that rested 0.3 s ago, nor one where it is set down.
    states = walk(SQUARE, [0.0] * 5, swing_s=0.7)
    swing = np.isinf(states.rest.sigma_mps)
    states.rest.sigma_mps[swing] = 0.5
    np.testing.assert_allclose(find_strides(states).length_m, 1.4, atol=1e-12)


def test_a_foot_that_slows_down_before_it_rests_makes_one_stride() -> None:
    """A slow swing comes down at 0.5 m/s, jolts, and rests 0.2 s later: nothing is cut there."""
    states = walk(SQUARE, [0.0] * 5, swing_s=1.1)
    swing = np.flatnonzero(np.isinf(states.rest.sigma_mps))
    for stretch in np.split(swing, np.flatnonzero(np.diff(swing) > 1) + 1):
        states.rest.sigma_mps[stretch[-round(0.4 * RATE_HZ) : -round(0.2 * RATE_HZ)]] = 0.5
    assert len(find_strides(states, StrideParams(settle_s=0.0)).length_m) > 4
    np.testing.assert_allclose(find_strides(states).length_m, 1.4, atol=1e-12)


def test_a_foot_that_rolls_on_while_it_stands_makes_no_stride() -> None:
    """A stance in which sigma is lost for 0.1 s while the foot moves by 5 cm is one stance; 40 cm are a stride."""
    for moved_m, number in ((0.05, 1), (0.4, 2)):
        places = [(0.0, 0.0, 0.0), (1.4, 0.0, 0.0), (1.4 + moved_m, 0.0, 0.0)]
        states = walk(places, [0.0] * 3, swing_s=0.1, rest_s=0.15)
        states.t_s[: round(0.2 * RATE_HZ)] -= 0.5  # the first swing takes longer
        assert len(find_strides(states).length_m) == number
    strides = find_strides(walk(places[:2], [0.0] * 2, swing_s=0.1, rest_s=0.15))
    assert strides.length_m.tolist() == pytest.approx([1.4])


def test_no_stride_is_reported_before_the_filter_starts() -> None:
    states = walk(SQUARE, [0.0] * 5)
    states.x[:250] = np.nan
    strides = find_strides(states)
    assert len(strides.length_m) == 3
    assert strides.start_xyz_m[0].tolist() == list(SQUARE[1])
