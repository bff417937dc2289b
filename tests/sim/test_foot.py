"""The foot between its rests: where it is at rests, how it moves between them, and that it is the same each time."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import welch

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.inertial import find_strides, navigate
from pdrbench_sim.foot.foot import UNIT_HEIGHT_M, foot_motion
from pdrbench_sim.foot.shape import GaitShape, gait_shape
from pdrbench_sim.foot.site import INSTEP, SOLE, FootSite, FootSiteError
from pdrbench_sim.foot.style import SwingParams
from pdrbench_sim.people.strides import Stances
from pdrbench_sim.units.motion import MotionError

STILL = SwingParams(
    roll_sigma_rad=(0.0, 0.0, 0.0),
    creep_m=(0.0, 0.0),
    give_sigma_m=(0.0, 0.0, 0.0),
    knocks=(),
    sway_rad=0.0,
    tremor_radps=0.0,
    lift_sigma=0.0,
)


@pytest.fixture(scope="module")
def hall() -> Building:
    """A floor of 400 m by 400 m, and a tread 0.34 m above it in the far corner."""

    def square(name: str, x: float, size: float, height_m: float) -> FloorPolygon:
        outline = np.array([[x, x], [x + size, x], [x + size, x + size], [x, x + size]])
        return FloorPolygon(name, outline, np.full(4, WALL), height_m, 0)

    return Building("hall", (square("floor", -200.0, 400.0, 0.0), square("tread", 300.0, 5.0, 0.34)))


def rests_at(mid_s, xy_m, *, polygon=None, yaw_rad=None) -> Stances:
    """Rests with a third of each stride on the floor."""
    mid_s, xy_m = np.array(mid_s, dtype=float), np.array(xy_m, dtype=float)
    margin = 0.175 * np.diff(mid_s)
    return Stances(
        mid_s=mid_s,
        begin_s=np.append(mid_s[0], mid_s[1:] - margin),
        end_s=np.append(mid_s[:-1] + margin, np.inf),
        xy_m=xy_m,
        polygon=np.zeros(len(mid_s), dtype=int) if polygon is None else np.array(polygon),
        yaw_rad=np.zeros(len(mid_s)) if yaw_rad is None else np.array(yaw_rad, dtype=float),
    )


def straight(count: int, *, length_m: float = 1.3, stride_s: float = 1.1, first_s: float = 2.0) -> Stances:
    """Strides along x."""
    mid_s = np.append(0.0, first_s + stride_s * np.arange(count))
    return rests_at(mid_s, np.column_stack([length_m * np.arange(count + 1), np.zeros(count + 1)]))


def test_rests_where_the_schedule_says(hall: Building, rng: np.random.Generator) -> None:
    rests = straight(12)
    motion = foot_motion(hall, rests, rng, end_s=16.0, params=STILL)
    at = np.searchsorted(motion.t_s, rests.mid_s)
    np.testing.assert_allclose(motion.xyz_m[at, :2], rests.xy_m, atol=0.003)
    np.testing.assert_allclose(motion.xyz_m[at, 2], UNIT_HEIGHT_M, atol=0.003)


def test_force_and_rate_are_smooth_where_strides_meet(hall: Building, rng: np.random.Generator) -> None:
    rests = straight(20)
    accel, gyro = foot_motion(hall, rests, rng, end_s=24.0).ideal_signals()
    jumps = np.abs(np.diff(accel, axis=0)).max(axis=1)
    near = np.min(np.abs(np.arange(len(jumps))[:, None] / 500.0 - rests.mid_s[3:-1]), axis=1) < 0.02
    assert jumps[near].max() < 1.0  # mid-stance, m/s2 in 2 ms
    assert np.isfinite(accel).all() and np.abs(np.degrees(gyro)).max() < 900


def test_stands_still_in_a_pause(hall: Building, rng: np.random.Generator) -> None:
    mid_s = [0.0, 2.0, 3.1, 4.2, 14.2, 15.3, 16.4]
    motion = foot_motion(hall, rests_at(mid_s, [(1.2 * i, 0) for i in range(7)]), rng, end_s=20.0)
    pause = (motion.t_s > 5.0) & (motion.t_s < 12.0)
    speed = np.linalg.norm(np.gradient(motion.xyz_m[pause], 0.002, axis=0), axis=1)
    assert speed.max() < 3e-3  # sway and tremor
    accel, gyro = motion.ideal_signals()
    assert np.abs(np.linalg.norm(accel[pause], axis=1) - 9.81).max() < 0.05
    assert np.degrees(np.abs(gyro[pause]).max()) < 2.0


def test_turns_on_the_spot(hall: Building, rng: np.random.Generator) -> None:
    rests = rests_at([0.0, 3.0, 4.2, 5.3], [(0, 0)] * 4, yaw_rad=[0, 0, np.pi / 2, np.pi])
    motion = foot_motion(hall, rests, rng, end_s=8.0, params=STILL)
    assert np.abs(motion.xyz_m[:, :2]).max() < 0.1
    w, x, y, z = motion.quaternion[-1]
    assert abs(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))) == pytest.approx(np.pi, abs=0.02)


def test_rises_before_it_moves_ahead_on_stairs(hall: Building, rng: np.random.Generator) -> None:
    up = rests_at([0.0, 3.0, 4.3], [(0, 0), (0.6, 0), (1.2, 0)], polygon=[0, 0, 1])
    motion = foot_motion(hall, up, rng, end_s=6.0, params=STILL)
    assert motion.xyz_m[-1, 2] == pytest.approx(UNIT_HEIGHT_M + 0.34, abs=0.003)
    half_way = np.searchsorted(motion.xyz_m[:, 0], 0.9)
    assert motion.xyz_m[half_way, 2] > UNIT_HEIGHT_M + 0.34 / 2


def test_feet_walk_backwards_and_a_unit_in_the_sole_stands_lower(hall: Building) -> None:
    rests = straight(8)
    ahead, back = (
        foot_motion(hall, rests_at(rests.mid_s, sign * rests.xy_m), np.random.default_rng(1), end_s=12.0, params=STILL)
        for sign in (1, -1)
    )
    np.testing.assert_allclose(ahead.xyz_m[:, 0], -back.xyz_m[:, 0], atol=1e-9)
    np.testing.assert_allclose(ahead.quaternion[:, 2], -back.quaternion[:, 2], atol=0.2)
    motion = foot_motion(hall, straight(3), np.random.default_rng(1), end_s=60.0, params=STILL, site=SOLE)
    assert motion.xyz_m[-1, 2] == pytest.approx(UNIT_HEIGHT_M - 0.06, abs=0.003)


def test_same_seed_same_bytes_and_processes_are_apart(hall: Building) -> None:
    def make(**changes) -> np.ndarray:
        return foot_motion(hall, straight(6), np.random.default_rng(5), end_s=9.0, params=SwingParams(**changes)).xyz_m

    assert np.array_equal(make(), make())
    quiet = make(knocks=())
    at_rest = np.searchsorted(np.arange(len(quiet)) / 500.0, 2.0 + 1.1 * np.arange(1, 4))
    # Without oscillations the strides are the same ones: at mid-stance nothing differs.
    np.testing.assert_allclose(make()[at_rest], quiet[at_rest], atol=1e-5)
    assert not np.array_equal(make(), quiet)


def test_turns_with_the_building(hall: Building) -> None:
    rests = straight(8)
    turned = rests_at(rests.mid_s, rests.xy_m[:, ::-1], yaw_rad=np.full(9, np.pi / 2))
    one, two = (foot_motion(hall, r, np.random.default_rng(2), end_s=12.0).ideal_signals() for r in (rests, turned))
    np.testing.assert_allclose(one[0], two[0], atol=1e-6)
    np.testing.assert_allclose(one[1], two[1], atol=1e-6)


def test_the_filter_finds_the_strides(hall: Building, rng: np.random.Generator) -> None:
    rests = straight(21, first_s=1.2)
    motion = foot_motion(hall, rests, rng, end_s=27.0)
    accel, gyro = motion.ideal_signals()
    found = find_strides(navigate(motion.t_s[::2], accel[::2], gyro[::2]))
    assert len(found.length_m) == 21
    assert np.median(found.length_m) == pytest.approx(1.3, abs=0.03)


def test_on_the_floor_the_foot_turns_about_its_sole(hall: Building) -> None:
    # Without the give of shoe and strap the speed ahead is the height of the unit times the rate of pitch.
    rests = straight(20)
    rolling = replace(STILL, roll_sigma_rad=(0.3, 0.0, 0.0))
    motion = foot_motion(hall, rests, np.random.default_rng(1), end_s=24.0, params=rolling)
    _, gyro = motion.ideal_signals()
    at = np.searchsorted(motion.t_s, rests.mid_s[2:-1])
    ahead_mps = np.gradient(motion.xyz_m[:, 0], 0.002)[at]
    assert np.ptp(gyro[at, 1]) > 0.3
    np.testing.assert_allclose(ahead_mps, UNIT_HEIGHT_M * gyro[at, 1], atol=0.01)


def test_a_unit_in_the_sole_is_still_while_that_lies_flat(hall: Building) -> None:
    rests = straight(12)
    speed_mps, peak = {}, {}
    for site in (INSTEP, SOLE, replace(SOLE, planted=1.0)):
        motion = foot_motion(hall, rests, np.random.default_rng(1), end_s=16.0, site=site)
        _, gyro = motion.ideal_signals()
        phase = np.array([(motion.t_s - mid_s) / 1.1 for mid_s in rests.mid_s[3:-1]])
        flat = (np.abs(phase) < 0.08).any(axis=0)
        speed_mps[site] = np.median(np.linalg.norm(np.gradient(motion.xyz_m, 0.002, axis=0), axis=1)[flat])
        peak[site] = np.abs(gyro).max()
    whole = replace(SOLE, planted=1.0)
    assert speed_mps[SOLE] < 0.35 * speed_mps[INSTEP]
    assert speed_mps[whole] < 0.002  # what is left are sway and tremor
    assert peak[SOLE] == pytest.approx(peak[INSTEP], rel=0.1)  # in the air the shoe is one body


def test_bad_site_and_time_are_refused(hall: Building, rng: np.random.Generator) -> None:
    with pytest.raises(FootSiteError, match="planted"):
        FootSite(planted=1.5)
    with pytest.raises(MotionError, match="end_s"):
        foot_motion(hall, straight(3), rng, end_s=0.0)


def test_a_standing_foot_trembles(hall: Building) -> None:
    trembling = replace(STILL, tremor_radps=0.003, tremor_sigma=0.0)
    motion = foot_motion(hall, straight(3), np.random.default_rng(0), end_s=60.0, params=trembling)
    accel, gyro = (values[motion.t_s > 10.0] for values in motion.ideal_signals())
    np.testing.assert_allclose(gyro[:, :2].std(axis=0), 0.003, rtol=0.15)
    assert 0.005 < accel[:, 0].std() < 0.06
    frequency, power = welch(gyro[:, 1], 500.0, nperseg=1000)
    assert power[(frequency < 3) | (frequency > 27)].sum() < 0.02 * power.sum()


@pytest.mark.parametrize("name", ["walk", "run"])
def test_learned_strides_close(name: str) -> None:
    shape: GaitShape = gait_shape(name)
    np.testing.assert_allclose(shape.mean[-1] - shape.mean[0], [1, 0, 0, 0, 0, 0], atol=1e-6)
    np.testing.assert_allclose(shape.modes[:, [0, -1]], 0.0, atol=1e-6)
    assert (np.diff(shape.mean[:, 0]) > -2e-3).all()
