"""The filter: what the map adds, what it leaves alone, and the same bytes for the same generator."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray
from pdrbench_lab.footslam.cloud import OdometryNoise, SlamCloud, SlamParams
from pdrbench_lab.footslam.hexagons import centre_m

SIDE_STRIDES, STRIDE_M, ROUNDS = 14, 1.4, 4
ROUND = 4 * SIDE_STRIDES
NOISE = OdometryNoise(length_scale=1.0)
FEW = SlamParams(num_particles=1000)


def block(rounds: int = ROUNDS) -> FloatArray:
    """(S, 2) lengths and turns of a walk around a square block of 20 m."""
    turn_rad = np.where(np.arange(rounds * ROUND) % SIDE_STRIDES == 0, math.pi / 2, 0.0)
    turn_rad[0] = 0.0
    return np.column_stack([np.full(rounds * ROUND, STRIDE_M), turn_rad])


def places_m(rows: FloatArray, heading_rad: float = 0.0) -> FloatArray:
    """(S, 2) after each stride."""
    heading = heading_rad + np.cumsum(rows[:, 1])
    return np.cumsum(rows[:, :1] * np.column_stack([np.cos(heading), np.sin(heading)]), axis=0)


def measured(rows: FloatArray, drift_rad: float, rng: np.random.Generator) -> FloatArray:
    """The same with a constant drift, and white errors as the filter assumes them."""
    count = len(rows)
    heading = NOISE.heading_sigma_rad * rng.standard_normal(count)
    turn = drift_rad + NOISE.turn_sigma_rad * rng.standard_normal(count) + np.diff(heading, prepend=0.0)
    return np.column_stack([rows[:, 0] + NOISE.length_sigma_m * rng.standard_normal(count), rows[:, 1] + turn])


def errors_m(cloud: SlamCloud, rows: FloatArray, true_m: FloatArray) -> FloatArray:
    found = []
    for length_m, turn_rad in rows.tolist():
        cloud.stride(length_m, turn_rad, 0)
        found.append(cloud.mean()[0])
    return np.hypot(*(np.array(found) - true_m).T)


@pytest.mark.parametrize("seed", range(4))
def test_the_error_stops_growing_with_a_map_and_grows_without(seed: int) -> None:
    """Around a block with a drift of 1.5 standard deviations, 0.25 degrees a stride, to the left or to the right.

    A drift turns the block about its middle, from which its places are 11.2 m away in the mean. In the middle of round
    n the heading is off by (n - 1/2) 56 times 0.25 degrees: 0.12 rad in round 1, which is 1.4 m, and 0.86 rad in round
    4, a chord of 9.3 m. The mean of particles that are spread by 196 times 0.168 degrees shortens that to 7.9 m; white
    turns, 0.34 degrees times the root of 196, add 0.9 m per sigma, of which two are allowed. With a map a place is
    known to half the width of a hexagon, 1.2 m.
    """
    rng = np.random.default_rng(seed)
    true_m = places_m(block())
    rows = measured(block(), math.radians(0.25) * (-1) ** seed, rng)
    by_round = {}
    for uses_map in (True, False):
        cloud = SlamCloud(np.zeros(2), 0.0, NOISE, replace(FEW, uses_map=uses_map), np.random.default_rng(seed))
        by_round[uses_map] = errors_m(cloud, rows, true_m).reshape(ROUNDS, ROUND).mean(axis=1)
    assert by_round[True][0] == pytest.approx(by_round[False][0], abs=0.5)  # nothing is walked twice before its end
    assert by_round[False][3] > 7.9 - 2 * 0.9
    assert max(by_round[True][2:]) < 1.2


def test_new_places_weigh_nothing(rng: np.random.Generator) -> None:
    """Particles that cross more hexagons than others are not worth less while all of them are new."""
    cloud = SlamCloud(np.zeros(2), 0.0, NOISE, FEW, rng)
    for _ in range(30):
        cloud.stride(STRIDE_M, 0.0, 0)
    assert cloud.weight == pytest.approx(np.full(1000, 1 / 1000))


@pytest.mark.parametrize("level_back", [0, 1])
def test_levels_have_maps_of_their_own(level_back: int, rng: np.random.Generator) -> None:
    cloud = SlamCloud(np.zeros(2), 0.0, NOISE, FEW, rng)
    for _ in range(30):
        cloud.stride(STRIDE_M, 0.0, 0)
    for turn_rad in (math.pi, *[0.0] * 29):
        cloud.stride(STRIDE_M, turn_rad, level_back)
    assert (np.ptp(cloud.weight) < 1e-12) == (level_back == 1)


def test_the_same_generator_gives_the_same_bytes_and_the_global_one_is_left_alone() -> None:
    before = np.random.get_state()[1].tobytes()  # noqa: NPY002
    rows, states = measured(block(2), 0.004, np.random.default_rng(5)), []
    for _ in range(2):
        cloud = SlamCloud(np.zeros(2), 0.0, NOISE, FEW, np.random.default_rng(3))
        for length_m, turn_rad in rows.tolist():
            cloud.stride(length_m, turn_rad, 0)
        states.append(cloud.state.tobytes() + cloud.weight.tobytes())
    assert states[0] == states[1]
    assert before == np.random.get_state()[1].tobytes()  # noqa: NPY002


@pytest.mark.parametrize(("turned", "moved"), [(0, [3, -2]), (1, [0, 0]), (4, [-1, 5])])
def test_turning_by_sixty_degrees_and_moving_by_hexagons_changes_nothing_else(turned: int, moved: list[int]) -> None:
    rows, angle_rad = measured(block(2), 0.004, np.random.default_rng(5)), turned * math.pi / 3
    shift_m, c, s = centre_m(moved, FEW.radius_m), math.cos(angle_rad), math.sin(angle_rad)
    means = []
    for start_m, heading_rad in ((np.zeros(2), 0.0), (shift_m, angle_rad)):
        cloud = SlamCloud(start_m, heading_rad, NOISE, FEW, np.random.default_rng(3))
        for length_m, turn_rad in rows.tolist():
            cloud.stride(length_m, turn_rad, 0)
        means.append(cloud.mean())
    assert means[1][0] == pytest.approx(shift_m + means[0][0] @ np.array([[c, s], [-s, c]]), abs=1e-6)
    assert means[1][2] == pytest.approx(means[0][2], abs=1e-6)


def test_a_path_ends_where_the_particles_are_and_begins_at_the_start(rng: np.random.Generator) -> None:
    rows, true_m = measured(block(), math.radians(0.25), rng), places_m(block())
    cloud = SlamCloud(np.zeros(2), 0.0, NOISE, FEW, np.random.default_rng(0), remembers=True)
    online_m = errors_m(cloud, rows, true_m)
    path_m = np.array([xy_m for xy_m, _, _ in cloud.path()])
    assert len(path_m) == len(rows) + 1
    assert path_m[0] == pytest.approx(np.zeros(2), abs=1e-6)
    assert path_m[-1] == pytest.approx(cloud.mean()[0], abs=1e-4)  # float32
    revised_m = np.hypot(*(path_m[1:] - true_m).T)
    # the first round, drawn anew with what its closing revealed of the drift, loses most of its error
    assert revised_m[:ROUND].mean() < 0.7 * online_m[:ROUND].mean()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"num_particles": 0}, "num_particles >= 1"),
        ({"delay": -1}, "delay >= 0"),
        ({"alpha": 0.0}, "alpha must be positive; got 0.0"),
        ({"radius_m": math.inf}, "radius_m must be positive; got inf"),
    ],
)
def test_impossible_settings_are_refused(changes: dict[str, float], message: str) -> None:
    with pytest.raises(PdrbenchError, match=message):
        SlamParams(**changes)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("name", "value"), [("length_scale", 0.0), ("drift_sigma_rad", -0.1), ("turn_sigma_rad", math.nan)]
)
def test_impossible_noise_is_refused(name: str, value: float) -> None:
    with pytest.raises(PdrbenchError, match=name):
        OdometryNoise(**{name: value})
