"""The foot filter: against its matrix form, against the truth, and with errors of units."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats
from scipy.io import loadmat
from scipy.spatial.transform import Rotation

from pdrbench.errors import RecordingError, RecordingWarning
from pdrbench.inertial import (
    LITERAL,
    FieldParams,
    FootFilter,
    FootParams,
    FootStates,
    Rest,
    concatenate,
    navigate,
    navigate_smoothed,
)
from pdrbench.inertial.foot_filter import LEVEL_SIGMA_RAD, empty_states, level, run
from pdrbench.inertial.foot_kernels import FIFTEEN, NINE, Memory
from pdrbench.inertial.quaternions import to_world
from pdrbench.inertial.zero_velocity import GRAVITY_MPS2
from pdrbench.metrics.odometry import align_se2
from pdrbench_sim.foot.known_walk import FootMotion, walk

FOOT = FootParams()
FREE = FootParams(unit_height_m=0.0, clipped_rate_radps=math.inf)  # what does not depend on body axes or on shoes


def off_m(states: FootStates, motion: FootMotion) -> np.ndarray:
    """(n,) distance from the truth, whose frame is the filter's where the foot starts pointing along x."""
    return np.linalg.norm(states.position_m - motion.position_m, axis=1)


def same_bytes(one: FootStates, other: FootStates) -> bool:
    arrays = [(one.t_s, other.t_s), (one.x, other.x), (one.cov, other.cov), (one.nis, other.nis)]
    return all(a.tobytes() == b.tobytes() for a, b in [*arrays, *zip(one.rest, other.rest, strict=True)])


# Against the truth.


@pytest.mark.parametrize("params", [LITERAL, FREE, FOOT], ids=["9", "15", "15 rolling"])
def test_perfect_signals_give_the_closed_form(params: FootParams, true_rest: Any) -> None:
    motion = walk(10, length_m=1.3, turn_rad=0.3, rise_m=0.17)
    states = navigate(motion.t_s, motion.accel, motion.gyro, params, rest=true_rest(motion))
    heading = 0.3 * np.arange(10)
    end = [1.3 * np.cos(heading).sum(), 1.3 * np.sin(heading).sum(), 1.7]
    np.testing.assert_allclose(states.position_m[-1], end, atol=1e-3)
    assert states.yaw_rad[-1] == pytest.approx(3.0, abs=1e-4)
    assert np.abs(states.velocity_mps[-1]).max() < 1e-4


def test_errors_grow_about_linearly_with_strides(measure: Any) -> None:
    """W2. The exponent is between those of a random walk, 1/2, and of a heading that drifts by a constant bias, 2."""
    motion = walk(80)
    off = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        bias = {"accel_bias": tuple(rng.normal(0, 0.03, 3)), "gyro_bias": tuple(rng.normal(0, 0.0005, 3))}
        off.append(off_m(navigate(*measure(motion, rng, **bias), FOOT), motion))
    after = [np.searchsorted(motion.t_s, 0.9 + 1.15 * strides) for strides in (10, 20, 40, 80)]
    rms_m = np.sqrt(np.square(off).mean(axis=0))[after]
    exponent = np.polyfit(np.log([10, 20, 40, 80]), np.log(rms_m), 1)[0]
    assert 0.5 < exponent < 2.0
    assert rms_m[-1] < 0.02 * 80 * 1.3


# NEES and NIS: the filter is as wrong as it says.

NUM_RUNS = 40


def swung(motion: FootMotion) -> tuple[np.ndarray, np.ndarray]:
    """Attitudes (n, 4) wxyz after each sample, half way to it (n, 3, 3), as the kernel integrates its rate."""
    q, half_way = np.zeros((len(motion), 4)), np.zeros((len(motion), 3, 3))
    q[0] = 1, 0, 0, 0
    half_way[0] = np.eye(3)
    turns = Rotation.from_rotvec(0.5 * np.diff(motion.t_s, prepend=0.0)[:, None] * motion.gyro)
    now = Rotation.identity()
    for k in range(1, len(motion)):
        middle = now * turns[k]
        now = middle * turns[k]
        half_way[k], q[k] = middle.as_matrix(), now.as_quat()[[3, 0, 1, 2]]
    return q, half_way


@pytest.mark.parametrize("size", [NINE, FIFTEEN], ids=["9", "15"])
def test_errors_are_as_large_as_claimed(size: int, rng: Any) -> None:
    """Everything is drawn from the model of the filter: at rest the true velocity is white noise of sigma, noise is
    white, the prior is true. Then the sum of e^T P^-1 e over all runs is chi-square with 40 N degrees of freedom."""
    params = replace(FREE, force_fraction=0.0, slip_mps=math.inf)
    noise, sigma = params.noise(), np.zeros(size)
    sigma[3:6], sigma[6:8] = 0.01, LEVEL_SIGMA_RAD
    if size == FIFTEEN:
        sigma[9:12], sigma[12:15] = 0.05, math.radians(0.05)
    motion, dt = walk(4, turn_rad=0.4, rise_m=0.17), 1 / 200
    count = len(motion)
    q, half_way = swung(motion)
    nees, nis = [], []
    for _ in range(NUM_RUNS):
        velocity = motion.velocity_mps + np.where(motion.is_rest[:, None], rng.normal(0, 0.01, (count, 3)), 0.0)
        motion_mps2 = np.diff(velocity, axis=0, prepend=velocity[:1]) / dt
        moved = dt * np.roll(velocity, 1, axis=0) + 0.5 * dt**2 * motion_mps2
        moved[0] = 0.0
        error = sigma * rng.standard_normal(size)
        bias = error[9:15] if size == FIFTEEN else np.zeros(6)
        force = np.einsum("nji,nj->ni", half_way, motion_mps2 + np.array([0, 0, GRAVITY_MPS2]))
        accel = force + bias[:3] + noise.accel_density / math.sqrt(dt) * rng.standard_normal((count, 3))
        gyro = motion.gyro + bias[3:] + noise.gyro_density / math.sqrt(dt) * rng.standard_normal((count, 3))
        truth = np.concatenate([moved.sum(axis=0), velocity[-1], q[-1], bias])
        first = np.concatenate([np.zeros(3), velocity[0], q[0], bias])
        turned = Rotation.from_rotvec(-error[6:9]) * Rotation.from_quat(first[[7, 8, 9, 6]])
        start = np.concatenate([first[:6] - error[:6], np.roll(turned.as_quat(), 1), first[10:]])
        start[10 : 10 + len(error) - 9] -= error[9:]
        unset = (np.zeros(11), np.zeros(3), np.zeros((6, 4)), np.zeros(5), np.zeros(6), np.full(1, np.nan))
        memory = Memory(start, np.diag(sigma**2), *unset, size)
        rest = np.where(motion.is_rest, 0.01, np.inf)
        states = empty_states(motion.t_s, Rest(rest, np.full(count, np.inf), np.zeros(count)))
        run(memory, states, accel, gyro, np.full((count, 3), np.nan), noise)
        turn = Rotation.from_quat(truth[[7, 8, 9, 6]]) * Rotation.from_quat(memory.x[[7, 8, 9, 6]]).inv()
        off = np.concatenate([(truth - memory.x)[:6], turn.as_rotvec(), (truth - memory.x)[10:]])[:size]
        nees.append(off @ np.linalg.solve(memory.cov, off))
        nis.append(np.nanmean(states.nis))
    low, high = stats.chi2.ppf([0.001, 0.999], NUM_RUNS * size)
    assert low < np.sum(nees) < high
    # Some 600 rests a run, each chi-square with 3 degrees of freedom and independent: sigma of the mean is 0.016.
    assert np.mean(nis) == pytest.approx(3.0, abs=0.06)


# What must not matter.


@pytest.mark.parametrize("params", [LITERAL, FREE, replace(FOOT, clipped_rate_radps=math.inf)], ids=["9", "17", "h"])
def test_mounting_does_not_matter(params: FootParams, measure: Any, rng: Any) -> None:
    motion = walk(6, turn_rad=0.4, rise_m=0.17)
    measured = measure(motion, rng)
    plain = navigate(*measured, params)
    upside_down = Rotation.from_rotvec([math.pi, 0.0, 0.0])
    for mounting in (upside_down, Rotation.from_rotvec([0, math.pi / 2, 0]), *Rotation.random(3, rng=rng)):
        turned = navigate(measured.t_s, mounting.apply(measured.accel), mounting.apply(measured.gyro), params)
        known = np.isfinite(plain.x[:, 0])
        onto = plain.position_m[known]
        np.testing.assert_allclose(turned.position_m[known, 2], onto[:, 2], atol=1e-7)
        aligned = align_se2(turned.position_m[known, :2], onto[:, :2]).xy_m
        np.testing.assert_allclose(aligned, onto[:, :2], atol=1e-7)
        np.testing.assert_allclose(turned.sigma_m[known], plain.sigma_m[known], rtol=1e-6)


@pytest.mark.parametrize("params", [LITERAL, FOOT, replace(FOOT, field=FieldParams())], ids=["9", "17", "field"])
def test_how_a_stream_is_cut_does_not_matter(params: FootParams, measure: Any, earth_field: Any, rng: Any) -> None:
    motion = walk(4, turn_rad=0.3)
    cut = 10  # no vertical yet in the first pieces
    kept = np.r_[0:600, 640 : len(motion)]  # a gap that a stride is carried over
    measured, field = [values[kept] for values in measure(motion, rng)], earth_field(motion)[kept]
    whole = FootFilter(200.0, params).update(*measured, field)
    for _ in range(3):
        cuts = [0, *np.sort(rng.integers(0, len(kept), 40)).tolist(), 600, cut, len(kept)]
        footing, parts = FootFilter(200.0, params), []
        for low, high in pairwise(sorted(cuts)):
            parts.append(footing.update(*(v[low:high] for v in measured), field[low:high]))
        assert same_bytes(concatenate(parts), whole)


def test_samples_that_repeat_a_time_change_nothing(measure: Any, rng: Any) -> None:
    measured = measure(walk(3), rng)
    twice = np.sort(np.r_[0 : len(measured.t_s), rng.integers(0, len(measured.t_s), len(measured.t_s) // 20)])
    repeated = [v[twice] for v in measured]
    assert same_bytes(navigate(*measured, FOOT), navigate(*repeated, FOOT))


# What units do wrong.


def without(measured: Any, from_s: float, to_s: float) -> list[np.ndarray]:
    kept = (measured.t_s < from_s) | (measured.t_s >= to_s)
    return [v[kept] for v in measured]


def test_after_half_a_second_without_samples(measure: Any, rng: Any) -> None:
    """A gap in the middle of a stride: its end is guessed, and the filter says how well."""
    motion = walk(8)
    states = navigate(*without(measure(motion, rng), 5.7, 6.2), replace(FOOT, carried_s=0.0))
    at = np.searchsorted(states.t_s, [5.69, 6.2, 9.0])
    before, after, later = states.sigma_m[at]
    assert before < 0.1
    assert after > 0.5  # half an acceleration of 5 m/s2 for half a second, squared
    assert later == pytest.approx(after, rel=0.1)  # a rest observes the velocity, not the position
    truth_m = np.column_stack([np.interp(states.t_s, motion.t_s, motion.position_m[:, i]) for i in range(3)])
    off = states.position_m - truth_m
    assert np.linalg.norm(off[-1, :2]) < 4 * states.sigma_m[-1]
    strides = (off[-1] - off[np.searchsorted(states.t_s, 7.5)])[:2]  # those after the next rest are as good as any
    assert np.linalg.norm(strides) < 0.1
    assert np.abs(states.velocity_mps[-1]).max() < 0.02


def test_ten_seconds_of_nan(measure: Any, rng: Any) -> None:
    motion = walk(16)
    measured = measure(motion, rng)
    is_lost = (motion.t_s >= 5.7) & (motion.t_s < 15.7)
    measured.accel[is_lost] = np.nan
    for smoothed in (navigate, navigate_smoothed):
        states = smoothed(*measured, FOOT)
        assert len(states) == (~is_lost).sum()
        started = int(np.flatnonzero(np.isfinite(states.x[:, 0]))[0])
        assert states.t_s[started] < 0.2
        assert np.isfinite(states.x[started:]).all()
        assert np.isfinite(states.cov[started:]).all()
        assert states.sigma_m[-1] > 10
        assert np.abs(states.velocity_mps[-1]).max() < 0.05


def test_start_in_motion(measure: Any, rng: Any) -> None:
    """The recording begins in the middle of a swing: the filter starts when the foot rests."""
    motion = walk(6)
    cut = int(np.searchsorted(motion.t_s, 1.3))
    measured = [v[cut:] for v in measure(motion, rng)]
    states = navigate(*measured, FOOT)
    first = int(np.flatnonzero(np.isfinite(states.x[:, 0]))[0])
    assert 1.55 < states.t_s[first] < 1.9  # it is put down at 1.65 s
    walked_m = motion.position_m[-1] - motion.position_m[cut + first]
    assert np.linalg.norm(states.position_m[-1, :2]) == pytest.approx(np.linalg.norm(walked_m[:2]), rel=0.01)


def test_a_unit_that_never_rests_is_refused(rng: Any) -> None:
    t_s = np.arange(0, 10, 1 / 200)
    accel = np.column_stack([np.zeros_like(t_s), 8 * np.sin(9 * t_s), 9.8 + 8 * np.cos(7 * t_s)])
    gyro = np.column_stack([5 * np.cos(3 * t_s), 5 * np.sin(3 * t_s), np.full_like(t_s, 3.0)])
    for refuses in (navigate, navigate_smoothed):
        with pytest.raises(RecordingError, match=r"never rests.*is the unit on a foot"):
            refuses(t_s, accel, gyro)


def test_a_gyroscope_that_saturates(measure: Any, rng: Any) -> None:
    """Rates up to 10 rad/s, a sensor that ends at 8.5."""
    motion = walk(20, tilt_rad=1.6)
    measured = measure(motion, rng)
    clipped = np.clip(measured.gyro, -8.5, 8.5)
    assert (clipped != measured.gyro).any(axis=1).mean() > 0.03
    off = off_m(navigate(measured.t_s, measured.accel, clipped, FOOT), motion)[-1]
    unaware = replace(FOOT, clipped_rate_radps=math.inf)
    assert off < 0.01 * 26
    assert off < 0.7 * off_m(navigate(measured.t_s, measured.accel, clipped, unaware), motion)[-1]


@pytest.mark.parametrize("axis", [0, 2])
def test_switched_on_with_a_bias_of_two_degrees_per_second(axis: int, measure: Any, rng: Any) -> None:
    motion, bias = walk(20, still_s=2.0), np.zeros(3)
    bias[axis] = math.radians(2.0)
    measured = measure(motion, rng, gyro_bias=tuple(bias))
    states = navigate(*measured, FOOT)
    np.testing.assert_allclose(states.x[-1, 13:], bias, atol=math.radians(0.15))
    assert off_m(states, motion)[-1] < 0.04 * 26
    if axis == 2:  # a drift of 46 degrees, observable from the start only
        assert off_m(navigate(*measured, LITERAL), motion)[-1] > 5


# Real feet.


def trials(data_root: Path) -> list[dict[str, Any]]:
    files = sorted((data_root / "foot_vicon" / "data").glob("*.mat"))
    if not files:
        pytest.skip("foot_vicon not found under PDRBENCH_DATA: put its folder `data` there")
    return [loadmat(file) for file in files]


def se2_rmse_m(states: FootStates, reference_m: np.ndarray) -> float:
    """Motion capture is left-handed there: y is mirrored."""
    known = np.isfinite(states.x[:, 0]) & np.isfinite(reference_m[:, 0])
    onto = (reference_m * [1, -1, 1])[known, :2]
    off = align_se2(states.position_m[known, :2], onto).xy_m - onto
    return float(np.sqrt(np.square(off).sum(axis=1).mean()))


@pytest.mark.data
def test_motion_capture_with_rests_supplied(data_root: Path) -> None:
    """An independent nine-state filter with these labels has a mean of 0.078 m over 56 trials."""
    off = []
    for trial in trials(data_root):
        t_s, imu = trial["ts"].ravel(), trial["imu"]
        moving = np.full(len(t_s), np.inf)
        rest = Rest(np.where(trial["zv_shoe_opt"].ravel() > 0, 0.01, np.inf), moving, np.zeros(len(t_s)))
        states = navigate(t_s, imu[:, :3], imu[:, 3:], LITERAL, rest=rest)
        off.append(se2_rmse_m(states, trial["gt"]))
    assert np.mean(off) < 0.09


def test_stamps_that_come_in_bursts_are_put_on_an_even_clock(measure: Any, rng: Any) -> None:
    """A logger that stamps what arrives writes four samples at one time; a filter that drops three of them is lost."""
    motion = walk(10, turn_rad=0.2, still_s=2.0)
    measured = measure(motion, rng)
    bursts_s = np.ceil(measured.t_s * 50.0) / 50.0
    end_m = navigate(bursts_s, measured.accel, measured.gyro, FOOT).position_m[-1]
    assert np.linalg.norm(end_m - motion.position_m[-1]) < 0.02 * 13
    even = navigate(*measured, FOOT)
    assert np.array_equal(even.t_s, measured.t_s)  # a clock that is even stays to the last bit


# What a unit does not say about itself.


def filtered(measured: Any, params: FootParams, rate_hz: float = 200.0) -> FootFilter:
    done = FootFilter(rate_hz, params)
    done.update(*measured)
    assert done.memory is not None
    return done


@pytest.mark.parametrize(("gap", "most_m"), [(slice(40, 60), 0.002), (slice(260, 280), 0.5)], ids=["stands", "swings"])
def test_a_gap_costs_as_much_as_the_foot_moves(gap: slice, most_m: float, measure: Any, rng: Any) -> None:
    motion = walk(3)
    whole = measure(motion, rng)
    kept = np.delete(np.arange(len(motion)), np.arange(gap.start, gap.stop))
    states = navigate(*(v[kept] for v in whole), FOOT)
    grown = states.sigma_m[gap.start] - states.sigma_m[gap.start - 1]  # the first row after the gap
    assert 0 <= grown < most_m
    assert grown > 0.01 or most_m < 0.01
    off = np.linalg.norm(states.position_m[gap.start, :2] - motion.position_m[gap.stop, :2])
    assert off < 3 * states.sigma_m[gap.start] + 0.02


def test_a_sample_that_is_sent_twice_is_not_clipped(measure: Any, rng: Any) -> None:
    """A rate that repeats alone is at the end of the range, and the tilt gets uncertain; with all others, it is not."""
    motion = walk(3)
    measured = measure(motion, rng)
    again, held = measured.gyro.copy(), measured.accel.copy()
    fast = np.flatnonzero(np.abs(again[:, 1]) > 3.0)
    again[fast[1::4]] = again[fast[1::4] - 1]
    clipped = filtered((motion.t_s, held, again), FOOT)
    held[fast[1::4]] = held[fast[1::4] - 1]
    twice = filtered((motion.t_s, held, again), FOOT)
    assert twice.memory.cov[7, 7] < clipped.memory.cov[7, 7]


def test_samples_that_were_lost_and_repeated_are_left_out(measure: Any, rng: Any) -> None:
    """A unit that sends the last sample again for each it lost, twelve at a time."""
    motion = walk(20, turn_rad=0.2)
    measured, source = measure(motion, rng), np.arange(len(motion))
    for lost in rng.integers(100, len(motion) - 100, 20):
        source[lost : lost + 12] = source[lost - 1]
    again = navigate(measured.t_s, measured.accel[source], measured.gyro[source], FOOT)
    moves = np.linalg.norm(measured.gyro[source], axis=1) > 0.5
    assert len(again) == len(motion) - np.sum((np.diff(source, prepend=-1) == 0) & moves)
    assert np.linalg.norm(again.position_m[-1] - motion.position_m[-1]) < 0.03 * 26


def test_gaps_are_named(measure: Any, rng: Any) -> None:
    motion = walk(6)
    kept = np.delete(np.arange(len(motion)), np.r_[300:340, 600:640])
    with pytest.warns(RecordingWarning, match="2 gaps of 0.2"):
        navigate(*(values[kept] for values in measure(motion, rng)), FOOT)


RANGE_RADPS = 4.0


def ends_at(gyro: Any, spikes: Any, rng: Any) -> Any:
    """Rates of a sensor that ends at 4 rad/s, with a calibration that moves its ends by a little and makes spikes."""
    shown = np.clip(gyro, -RANGE_RADPS, RANGE_RADPS) * (1 + rng.normal(0, 0.001, gyro.shape))
    shown[spikes, 1] *= 1.15
    return shown


def test_the_end_of_the_range_is_found_under_spikes(measure: Any, rng: Any) -> None:
    """Many swings stop at one rate: that is the range, though single samples are larger; the mean excess is added."""
    motion = walk(12, tilt_rad=1.2)
    measured = measure(motion, rng)
    assert np.abs(measured.gyro[:, 1]).max() > 1.3 * RANGE_RADPS
    spikes = np.flatnonzero(np.abs(measured.gyro[:, 1]) > RANGE_RADPS)[::97]
    shown = ends_at(measured.gyro, spikes, rng)
    known = filtered((motion.t_s, measured.accel, shown), FOOT).memory.limits
    assert known[2:4, 1] == pytest.approx(RANGE_RADPS, rel=0.015)
    assert (known[2:4, 2] >= 8).all() and (known[2:4, 3] > 0).all()


@pytest.mark.parametrize("change", [0.0, 0.05])
def test_peaks_show_no_end_of_the_range(change: float, rng: Any) -> None:
    """Swings alike to the last digit have rounded peaks, and swings that differ have no common one."""
    parts = [walk(1, tilt_rad=1.2 + 2 * change * (i * 7 % 12), still_s=0.3) for i in range(12)]
    gyro = np.concatenate([part.gyro for part in parts]) + rng.normal(0, 0.001, (sum(map(len, parts)), 3))
    accel = np.concatenate([part.accel for part in parts])
    limits = filtered((np.arange(len(gyro)) / 200.0, accel, gyro), FOOT).memory.limits
    assert limits[2:4, 1].min() > 3.0
    assert not ((limits[:, 2] >= 8) & (limits[:, 3] > 0)).any()


def test_a_quiet_moment_of_a_swing_is_not_taken_for_a_stance(true_rest: Any) -> None:
    """A detector that has the foot rest for a moment of each swing, too: the filter knows that it moves."""
    motion = walk(10, length_m=1.3)
    speed_mps = np.linalg.norm(motion.velocity_mps, axis=1)
    rest = true_rest(motion)
    claimed = rest._replace(sigma_mps=np.where(speed_mps > 0.9 * speed_mps.max(), 0.5, rest.sigma_mps))
    off = {
        slip: off_m(
            navigate(motion.t_s, motion.accel, motion.gyro, replace(FREE, slip_mps=slip), rest=claimed), motion
        )[-1]
        for slip in (math.inf, 0.3)
    }
    assert off[math.inf] > 0.05
    assert off[0.3] < 0.1 * off[math.inf]


def test_the_tilt_at_the_start_is_that_of_the_accelerometers_bias(rng: Any) -> None:
    """Taking the bias off, with the rotation that goes with it, leaves the specific force pointing up."""
    for up in rng.normal(size=(5, 3)):
        force, bias = GRAVITY_MPS2 * up / np.linalg.norm(up), rng.normal(0, 0.02, 3)
        memory = level(0.0, np.tile(force + bias, (20, 1)), FOOT)
        tilt = memory.cov[6:9, 9:12] @ bias / FOOT.accel_bias_mps2**2
        world = to_world(memory.x[6:10], force)
        np.testing.assert_allclose((world + np.cross(tilt, world))[:2], 0.0, atol=1e-3)
        assert np.abs(world[:2]).max() > 5e-3
