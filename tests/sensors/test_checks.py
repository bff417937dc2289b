"""Every function of the toolbox refuses arrays that cannot be meant, and says nothing of those that can."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError, RecordingError, RecordingWarning
from pdrbench.inertial import PhoneAttitude, find_steps, find_strides, navigate, navigate_smoothed
from pdrbench.inertial.checks import PROPER, clean_rows, swings
from pdrbench.inertial.pairing import SamplePairs
from pdrbench.registry import make_task
from pdrbench.sensors.checks import Gate, guard
from pdrbench_sim.foot.known_walk import walk
from pdrbench_sim.readers import foot_stride_gcp, foot_vicon

Arrays = tuple[np.ndarray, np.ndarray, np.ndarray]
Spoil = Callable[[np.ndarray, np.ndarray, np.ndarray], Arrays]
FOOT_SETS = {
    "foot_vicon": (foot_vicon.read, "data/*.mat"),
    "foot_vicon_2": (foot_vicon.read, "data/*.mat"),
    "foot_stride_gcp": (foot_stride_gcp.read, "gcp_labelled/*_LLIO.mat"),
    "foot_stride_gcp_2": (foot_stride_gcp.read, "gcp_labelled/*_LLIO.mat"),
}
FAULTS: dict[str, tuple[Spoil, str]] = {
    "milliseconds": (lambda t, a, w: (1e3 * t, a, w), "looks like milliseconds"),
    "sample numbers": (lambda t, a, w: (np.arange(len(t)) * 1.0, a, w), "look like sample numbers"),
    "goes back": (lambda t, a, w: (np.where(np.arange(len(t)) > 500, t - 1, t), a, w), "goes back at"),
    "a jump of the clock": (lambda t, a, w: (np.where(np.arange(len(t)) > 500, t + 99, t), a, w), "the clock was set"),
    "half the rate": (lambda t, a, w: (2 * t, a, w), r"multiply the times by 0\.5|look like sample|needed"),
    "twice the rate": (lambda t, a, w: (t / 2, a, w), "multiply the times by 2"),
    "too slow": (lambda t, a, w: (t[::16], a[::16], w[::16]), "and 20 are needed"),
    "degrees": (lambda t, a, w: (t, a, np.degrees(w)), "looks like degree/s: .*multiply by pi/180"),
    "radians twice": (lambda t, a, w: (t, a, np.radians(w)), "converted from degree/s twice"),
    "g": (lambda t, a, w: (t, a / 9.80665, w), r"multiply by 9\.80665 \(by -9\.80665 where it comes from CoreMotion"),
    "m/s2 twice": (lambda t, a, w: (t, a * 9.80665, w), "converted twice"),
    "no gravity": (lambda t, a, w: (t, a - 9.8 * a.mean(0) / np.linalg.norm(a.mean(0)), w), "gravity was taken out"),
    "shapes": (lambda t, a, w: (t, a[:, :2], w), r"needs t_s \(n,\), accel \(n, 3\) and gyro \(n, 3\); got"),
    "NaN": (lambda t, a, w: (t, a * np.nan, w), "only 0 usable samples"),
    "nothing": (lambda t, a, w: (t[:0], a[:0], w[:0]), "only 0 usable samples"),
    "mg": (lambda t, a, w: (t, a / 0.00980665, w), r"looks like mg: .*multiply by 0\.00980665"),
    "swapped": (lambda t, a, w: (t, w, a), "accelerometer"),
}

UNITS = ("milliseconds", "sample numbers", "half the rate", "twice the rate", "degrees", "radians twice", "g")
UNITS += ("m/s2 twice", "no gravity")


def rows_of(t_s: np.ndarray, accel: np.ndarray, gyro: np.ndarray) -> dict[str, np.ndarray]:
    return {"accel": np.column_stack([t_s, accel]), "gyro": np.column_stack([t_s, gyro])}


def made(rate_hz: float = 200.0, **shape: float) -> Arrays:
    motion = walk(12, tilt_rad=0.9, turn_rad=0.2, rate_hz=rate_hz, **shape)
    noise = np.random.default_rng(1).normal(0, 1, (2, len(motion), 3))
    return motion.t_s, motion.accel + 0.05 * noise[0], motion.gyro + 0.005 * noise[1]


def recorded(data_root: Path, name: str) -> Iterator[tuple[Path, Arrays]]:
    read, pattern = FOOT_SETS[name]
    for path in sorted((data_root / name).glob(pattern)):
        rows = read(path).rows
        pairs = SamplePairs().update(rows["accel"], rows["gyro"])
        yield path, (pairs[:, 0], pairs[:, 1:4], pairs[:, 4:7])


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_refused_with_its_name_by_navigate(fault: str) -> None:
    spoil, message = FAULTS[fault]
    for function in (navigate, navigate_smoothed):
        with pytest.raises(RecordingError, match=message) as refused:
            function(*spoil(*made()))
        assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", ["foot_stride_gcp_2", "foot_vicon_2"])
def test_faults_of_recorded_feet_are_refused(name: str, data_root: Path) -> None:
    _, arrays = next(recorded(data_root, name))
    for fault in UNITS:
        with pytest.raises(RecordingError):
            clean_rows(*FAULTS[fault][0](*arrays))


@pytest.mark.parametrize("env", ["CampusFoot-v1", "CampusPhone-v1"])
def test_simulated_walks_pass_without_a_word(env: str) -> None:
    warnings.simplefilter("error", RecordingWarning)
    task = make_task(env)
    for walk_id in task.split("train")[:1]:
        streams = task.load(walk_id).streams
        pairs = SamplePairs().update(streams["accel"].rows, streams["gyro"].rows)
        if env == "CampusFoot-v1":
            clean_rows(pairs[:, 0], pairs[:, 1:4], pairs[:, 4:7])
        else:
            guard({name: streams[name].rows for name in ("accel", "gyro", "mag") if name in streams})


@pytest.mark.parametrize("rate_hz", [25.0, 50.0, 100.0, 400.0])
@pytest.mark.parametrize("clips_radps", [np.inf, 5.2])
def test_rates_clipping_and_a_foot_that_begins_in_the_air_pass(rate_hz: float, clips_radps: float) -> None:
    warnings.simplefilter("error", RecordingWarning)
    t_s, accel, gyro = made(rate_hz, swing_s=0.5)
    for begin_s in (0.0, 1.3):  # within a swing
        part = t_s >= begin_s
        clean_rows(t_s[part], accel[part], np.clip(gyro[part], -clips_radps, clips_radps))


def test_rest_and_running_pass(rng: np.random.Generator) -> None:
    warnings.simplefilter("error", RecordingWarning)
    t_s = np.arange(0.0, 40.0, 0.02)
    still = rows_of(t_s, rng.normal([0, 0, 9.81], 0.02, (len(t_s), 3)), rng.normal(0, 0.002, (len(t_s), 3)))
    guard(still)
    PhoneAttitude().update(still["accel"], still["gyro"])
    clean_rows(*made(swing_s=0.36, rest_s=0.05, length_m=2.5))  # the median of the force is above 20 m/s2
    clean_rows(made()[0], 1.07 * made()[1], made()[2])  # a poorly calibrated unit


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: rows * [1e3, 1, 1, 1], "looks like milliseconds"),
        (lambda rows: rows * [50, 1, 1, 1], "look like sample numbers"),
        (lambda rows: rows * [2, 1, 1, 1], "25 rows a second by their times, and 50 are stated"),
        (lambda rows: rows / [1, 9.80665, 9.80665, 9.80665], "looks like g"),
        (lambda rows: rows - [0, 0, 0, 9.81], "gravity was taken out"),
        (lambda rows: rows[::-1], "goes back"),
        (lambda rows: rows[:, :3], r"shape \(1500, 3\), expected \(n, 4\)"),
        (lambda rows: np.where(np.arange(1500)[:, None] == 7, np.nan, rows), "row 8 holds .* 1 of 1500 rows"),
    ],
)
def test_faults_of_a_phone_are_refused(change: Callable[[np.ndarray], np.ndarray], message: str) -> None:
    t_s = np.arange(1500) / 50.0
    bounce = 2.5 * np.sin(2 * np.pi * 1.9 * t_s)
    accel = np.column_stack([t_s, 0.3 * bounce, 0 * t_s, 9.81 + bounce])
    gyro = np.column_stack([t_s, 0.4 * bounce, 0 * t_s, 0.1 * bounce])
    with pytest.raises(PdrbenchError, match=message):
        find_steps(change(accel), 50.0)
    if "stated" not in message:
        with pytest.raises(RecordingError, match=message):
            PhoneAttitude().update(change(accel), change(gyro) if "accel" not in message else gyro)
    find_steps(accel, 50.0)
    PhoneAttitude().update(accel, gyro)


def test_rates_of_a_phone_in_other_units_are_refused() -> None:
    t_s = np.arange(1500) / 50.0
    bounce = 2.5 * np.sin(2 * np.pi * 1.9 * t_s)
    accel = np.column_stack([0 * t_s, 0 * t_s, 9.81 + bounce])
    for factor, message in ((np.degrees(1.0) * 4, "degree/s"), (np.radians(1.0), "twice")):
        rows = rows_of(t_s, accel, factor * np.column_stack([0.4 * bounce, 0 * t_s, 0.1 * bounce]))
        with pytest.raises(RecordingError, match=message):
            PhoneAttitude().update(rows["accel"], rows["gyro"])


def test_pieces_are_judged_once_enough_have_come() -> None:
    t_s = np.arange(1000) / 50.0
    rows = rows_of(t_s, np.tile([0.0, 0.1, 1.0], (1000, 1)), np.zeros((1000, 3)))
    gate = Gate("a stream")
    with pytest.raises(RecordingError, match=r"a stream: accel: .*looks like g"):
        for first in range(0, 1000, 10):
            gate.take({name: table[first : first + 10] for name, table in rows.items()})
    assert 240 <= first <= 260
    gate = Gate("a stream")
    gate.take({name: table[10:20] for name, table in rows.items()})
    with pytest.raises(RecordingError, match="goes back at row 1"):
        gate.take({name: table[:10] for name, table in rows.items()})


@pytest.mark.parametrize(("missing_s", "every_s"), [(0.6, 1.9), (0.3, 0.7), (0.1, 0.4), (2.0, 4.3)])
def test_gaps_in_a_brisk_walk_are_no_other_unit(missing_s: float, every_s: float) -> None:
    """Between two steps a brisk walker is nearly weightless: what is left of a half second may read 4 m/s2."""
    t_s = np.arange(0.0, 30.0, 0.02)
    phase = 2 * np.pi * 1.9 * t_s
    up_mps2 = 9.81 + 7.0 * np.sin(phase) + 2.5 * np.sin(2 * phase)
    accel = np.column_stack([1.5 * np.cos(phase / 2), 0 * t_s, up_mps2])
    for shift_s in np.arange(0.0, every_s, 0.1):
        kept = (t_s + shift_s) % every_s >= missing_s
        rows = rows_of(t_s[kept], accel[kept], np.column_stack([np.sin(phase), 0 * t_s, 0 * t_s])[kept])
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", RecordingWarning)
            for until_s in (5.0, 30.0):
                guard({name: table[table[:, 0] < until_s] for name, table in rows.items()})
            with pytest.raises(RecordingError, match="looks like g"):
                guard(rows | {"accel": rows["accel"] / [1.0, 9.81, 9.81, 9.81]})


def test_exchanged_and_negated_axes_of_a_foot_are_named() -> None:
    t_s, accel, gyro = made()
    askew = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    accel, gyro = accel @ askew, np.linalg.det(askew) * gyro @ askew
    for way in (*PROPER, *-PROPER):
        found = [*swings(t_s, accel, gyro @ way)]
        axes = ", ".join("-" * int(row.sum() < 0) + "xyz"[np.abs(row).argmax()] for row in way)
        assert [one.seen.partition(":")[0].partition(" were ")[2] for one in found] == [axes] * (axes != "x, y, z")
        assert ("multiply gyro by -1" in "".join(map(str, found))) == (axes == "-x, -y, -z")


def test_the_other_sign_mirrors_the_walk_and_shows_against_the_field_only() -> None:
    """Force is a polar vector and rate an axial one: negated force is that of the walk in a mirror, exactly."""
    t_s, accel, gyro = made()
    right, wrong = navigate(t_s, accel, gyro), navigate(t_s, -accel, gyro)
    side = [(xy[:-1, 0] * xy[1:, 1] - xy[:-1, 1] * xy[1:, 0]) for xy in (right.position_m, wrong.position_m)]
    known = np.isfinite(side[0])
    assert np.ptp(side[0][known]) > 0.01
    assert np.abs(side[0][known] + side[1][known]).max() < 1e-6
    rows = rows_of(t_s, accel, gyro)
    mag = np.column_stack([t_s, np.tile([20.0, 0.0, -40.0], (len(t_s), 1))])
    upright = np.column_stack([t_s, np.tile([0.0, 0.0, 9.81], (len(t_s), 1))])
    warnings.simplefilter("error", RecordingWarning)
    guard(rows | {"accel": upright, "mag": mag})
    with pytest.raises(RecordingWarning, match="accel has the other sign, as from CoreMotion: multiply"):
        guard(rows | {"accel": upright * [1, -1, -1, -1], "mag": mag})


def test_gaps_are_warned_of_and_strides_are_found_in_states_only() -> None:
    t_s, accel, gyro = made()
    accel[100:200] = np.nan
    with pytest.warns(RecordingWarning, match="100 of .* samples are not finite"):
        navigate(t_s, accel, gyro)
    kept = (t_s < 5.0) | (t_s > 6.5)
    with pytest.warns(RecordingWarning, match="gaps longer than 1 s"):
        clean_rows(*(values[kept] for values in made()))
    with pytest.raises(RecordingError, match="what navigate returns, FootStates; got tuple"):
        find_strides(made())  # type: ignore[arg-type]
