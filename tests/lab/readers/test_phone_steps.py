"""Walks with a phone and foot switches: the clock, contacts and flicker, bad files."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import RecordingError
from pdrbench.sensors import sensor_spec
from pdrbench_lab.readers import phone_steps

BEGIN_NS = 590_421_164_192_468
SECONDS = 12.0


def accel_lines(rate_hz: int = 100) -> list[str]:
    t_ns = BEGIN_NS + (np.arange(round(SECONDS * rate_hz)) * 1e9 / rate_hz).astype(int)
    return [f"{t},3,0.5,-1.25,9.75" for t in t_ns]


def switch_lines(left_s: list[float], right_s: list[float], stand_s: float = 0.3) -> list[str]:
    """Feet that come down at those times, read every 0.1 s from 0.05 s on."""
    lines = []
    for k in range(round(SECONDS * 10)):
        at_s = 0.05 + 0.1 * k
        left, right = (any(0 <= at_s - down_s < stand_s for down_s in foot) for foot in (left_s, right_s))
        lines.append(f"{BEGIN_NS + round(at_s * 1e9)},{int(left)},{int(right)}")
    return lines


def put(folder: Path, accel: list[str], switches: list[str], *, packed: bool = False) -> Path:
    for name, lines in (("accelerometer.csv", accel), ("stepcounter.csv", switches)):
        content = ("\n".join(lines) + "\n").encode()
        path = folder / (f"{name}.gz" if packed else name)
        path.write_bytes(gzip.compress(content) if packed else content)
    return folder


@pytest.mark.parametrize("packed", [False, True])
def test_clock_units_and_steps(tmp_path, packed):
    left_s, right_s = [1.0, 2.0, 3.0], [1.5, 2.5]
    log = phone_steps.read(put(tmp_path, accel_lines(), switch_lines(left_s, right_s), packed=packed))
    np.testing.assert_allclose(log.rows["accel"][3], [0.03, 0.5, -1.25, 9.75], atol=1e-6)
    np.testing.assert_allclose(phone_steps.step_times_s(log.reference), [1.05, 1.55, 2.05, 2.55, 3.05], atol=1e-6)
    np.testing.assert_array_equal(log.reference.xy_m[:, 0], np.arange(6))
    assert not log.reference.surveyed[0] and log.reference.surveyed[1:].all()
    assert log.report.kept == {"accel": 1200, "reference": 5} and not log.report.dropped
    assert set(log.recording("walk", None, sensor_spec).streams) == {"accel"}
    name = "accelerometer.csv.gz" if packed else "accelerometer.csv"
    np.testing.assert_array_equal(phone_steps.read(tmp_path / name).rows["accel"], log.rows["accel"])


def test_flicker_is_no_step_and_is_counted(tmp_path):
    flicker = switch_lines([1.0, 1.4, 2.0, 3.0, 3.4], [1.5], stand_s=0.2)
    log = phone_steps.read(put(tmp_path, accel_lines(), flicker))
    np.testing.assert_allclose(phone_steps.step_times_s(log.reference), [1.05, 1.55, 2.05, 3.05], atol=1e-6)
    assert log.report.dropped == {"contact without a swing": 2}


def test_both_feet_at_once_are_two_steps(tmp_path):
    log = phone_steps.read(put(tmp_path, accel_lines(), switch_lines([1.0, 3.0], [1.0])))
    np.testing.assert_allclose(phone_steps.step_times_s(log.reference), [1.05, 1.05, 3.05], atol=1e-6)
    np.testing.assert_array_equal(log.reference.xy_m[:, 0], [0, 2, 3])


def test_a_foot_that_stands_from_the_start_makes_no_step(tmp_path):
    log = phone_steps.read(put(tmp_path, accel_lines(), switch_lines([0.0, 2.0], [])))
    np.testing.assert_allclose(phone_steps.step_times_s(log.reference), [2.05], atol=1e-6)


def test_rows_out_of_order_are_sorted_and_counted(tmp_path):
    accel = accel_lines()
    accel[5], accel[6] = accel[6], accel[5]
    log = phone_steps.read(put(tmp_path, accel, switch_lines([1.0], [])))
    assert (np.diff(log.rows["accel"][:, 0]) > 0).all() and log.report.mended == {"row out of order": 1}


@pytest.mark.parametrize(
    ("accel", "switches", "message"),
    [
        (["1,3,0,0,9.8"], None, "1 rows, expected 10 or more"),
        ([f"{k},3,0,0,1.0" for k in range(20)], None, "convert the columns to m/s"),
        ([f"{k},3,0,9.8" for k in range(20)], None, "line 1: 4 fields, expected 5"),
        ([f"{k},3,0,0,fast" for k in range(20)], None, "line 1: z is 'fast'"),
        (None, [f"{k},0,2" for k in range(20)], "a switch is 0 or 1"),
    ],
)
def test_bad_files_are_named(tmp_path, accel, switches, message):
    put(tmp_path, accel or accel_lines(), switches or switch_lines([1.0], []))
    with pytest.raises(RecordingError, match=message):
        phone_steps.read(tmp_path)


def test_a_folder_without_them_is_refused(tmp_path):
    with pytest.raises(RecordingError, match=r"neither accelerometer.csv nor accelerometer.csv.gz"):
        phone_steps.read(tmp_path)
