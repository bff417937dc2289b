"""Recordings of the foot in MATLAB files: `matfile`, `foot_vicon` and `foot_stride_gcp`."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from pdrbench.errors import RecordingError
from pdrbench.sensors import sensor_spec
from pdrbench_formats.recordings.matfile import load
from pdrbench_sim.readers import foot_stride_gcp, foot_vicon

RATE_HZ = 200.0
NUM_SAMPLES = 400
GRAVITY_MPS2 = 9.81
DETECTORS = ("shoe", "ared", "amvd", "mbgtd", "vicon")  # of the labels that are published with a trial
Variables = dict[str, Any]
Change = Callable[[Variables], None]


@pytest.fixture
def imu(rng: np.random.Generator) -> Any:
    """(N, 6) of a foot that swings: z down, so that gravity reads negative on z."""
    t_s = np.arange(NUM_SAMPLES) / RATE_HZ
    swing = np.maximum(np.sin(2 * np.pi * t_s), 0.0)
    noise = rng.normal(0.0, 0.01, (NUM_SAMPLES, 6))
    noise[:, 2] += -GRAVITY_MPS2 - 15 * swing
    noise[:, 4] += 6 * swing
    return noise


@pytest.fixture
def trial(imu: Any) -> Variables:
    """A trial as in `foot_vicon`: the foot moves along x and, in the left-handed frame, along +y."""
    way_m = np.arange(NUM_SAMPLES) / NUM_SAMPLES
    everywhere = np.ones((1, NUM_SAMPLES), dtype=np.int64)
    return {
        "imu": imu,
        "ts": 5.0 + np.arange(NUM_SAMPLES)[None] / RATE_HZ,
        "gt": np.column_stack([way_m, 2 * way_m, 0.1 * way_m]),
        **{f"zv_{name}_opt": everywhere * (number % 2) for number, name in enumerate(DETECTORS)},
        **{f"G_{name}_opt": np.array([[number + 0.5]]) for number, name in enumerate(DETECTORS)},
        "trial_error": np.array([[0.1, 0.2, 0.2, 0.3, 0.4]]),
        "best_detector": "shoe",
        "best_error": np.array([[0.1]]),
        "notes": np.array([[1, "this is not read"]], dtype=object),
    }


@pytest.fixture
def walk(imu: Any) -> Variables:
    """A walk as in `foot_stride_gcp`."""
    return {
        "imu_data": imu,
        "timestamps": np.arange(NUM_SAMPLES)[None] / RATE_HZ,
        "strideIndex": np.array([[0, 100, 250, NUM_SAMPLES - 1]]),
        "GCP": np.array([[0.0, 0.0], [1.0, 0.5], [2.0, 1.5], [3.0, 2.5]]),
    }


def put(folder: Path, variables: Variables, *, compress: bool = False) -> Path:
    path = folder / "walk.mat"
    savemat(path, variables, do_compression=compress)
    return path


@pytest.mark.parametrize("compress", [False, True])
def test_a_file_reads_as_scipy_reads_it(tmp_path: Path, rng: np.random.Generator, compress: bool) -> None:
    """Every type of number, scalars, rows, three axes, nothing; savemat stores them as MATLAB does."""
    types = ("i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", "f4", "f8")
    variables: Variables = {f"of_{name}": (50 * rng.random((7, 3))).astype(name) for name in types}
    variables |= {
        "cube": rng.random((2, 3, 4)),
        "one": 3.5,
        "none": np.zeros((0, 3)),
        "true": np.array([[True, False]]),
    }
    path = put(tmp_path, variables | {"line": "shoe, größer"}, compress=compress)
    expected, found = loadmat(path), load(path, tuple(variables))
    for name in variables:
        np.testing.assert_array_equal(found.variables[name], expected[name].astype(np.float64))


@pytest.mark.parametrize("compress", [False, True])
def test_damage_is_refused_wherever_it_is(
    tmp_path: Path, trial: Variables, rng: np.random.Generator, compress: bool
) -> None:
    """Cut anywhere, and with bytes of lengths and types overwritten: a log or a `RecordingError`, nothing else."""
    content = put(tmp_path, trial, compress=compress).read_bytes()
    path = tmp_path / "damaged.mat"
    refused = 0
    for number in range(100):
        damaged = bytearray(content)
        if number % 2:
            del damaged[int(rng.integers(1, len(content))) :]
        else:
            damaged[int(rng.integers(128, 400))] = int(rng.integers(256))
        path.write_bytes(damaged)
        try:
            foot_vicon.read(path)
        except RecordingError as error:
            assert "damaged.mat" in str(error)
            refused += 1
    assert refused > 50


def test_a_variable_that_inflates_without_end_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pdrbench_formats.recordings.matfile.MAX_BYTES", 1 << 20)
    path = put(tmp_path, {"imu": np.zeros((1 << 20, 6)), "ts": 0.0, "gt": 0.0}, compress=True)
    assert path.stat().st_size < 1 << 20
    with pytest.raises(RecordingError, match="larger than 1 MiB"):
        foot_vicon.read(path)


def test_units_axes_clock_and_handedness_of_a_trial(tmp_path: Path, trial: Variables) -> None:
    log = foot_vicon.read(put(tmp_path, trial))
    assert set(log.rows) == {"accel", "gyro"}
    np.testing.assert_allclose(log.rows["accel"][:, 0], np.arange(NUM_SAMPLES) / RATE_HZ, atol=1e-12)
    np.testing.assert_array_equal(log.rows["accel"][:, 1:], trial["imu"][:, :3])
    np.testing.assert_array_equal(log.rows["gyro"][:, 1:], trial["imu"][:, 3:])
    np.testing.assert_array_equal(log.reference.xy_m, trial["gt"][:, :2] * (1, -1))
    assert log.reference.z_m is not None
    np.testing.assert_array_equal(log.reference.z_m, trial["gt"][:, 2])
    assert log.reference.surveyed.all()
    assert dict(log.report.kept) == {"accel": NUM_SAMPLES, "gyro": NUM_SAMPLES, "reference": NUM_SAMPLES}
    recording = log.recording("walk", None, sensor_spec, mounting="foot")
    assert recording.building is None


def test_repeated_motion_capture_samples_mark_a_lost_foot(tmp_path: Path, trial: Variables) -> None:
    """Ten repeats of row 100 are lost, two of row 300 are not: a camera at half the rate repeats, too."""
    trial["gt"][101:111] = trial["gt"][100]
    trial["gt"][301:303] = trial["gt"][300]
    reference = foot_vicon.read(put(tmp_path, trial)).reference
    np.testing.assert_array_equal(np.flatnonzero(~reference.surveyed), np.arange(101, 111))


def test_samples_that_are_no_samples_are_dropped_and_counted(tmp_path: Path, trial: Variables) -> None:
    """Ten lost samples, one repeated with its time, and one position that is missing."""
    trial["imu"][50:60, 4] = np.nan
    trial["gt"][200, 2] = np.nan
    for name in ("imu", "gt"):
        trial[name][301] = trial[name][300]
    trial["ts"][0, 301] = trial["ts"][0, 300]
    log = foot_vicon.read(put(tmp_path, trial))
    assert dict(log.report.dropped) == {
        "the same row twice": 1, "gyro is not a number": 10, "reference is not a number": 1,
    }  # fmt: skip
    assert len(log.rows["accel"]) == NUM_SAMPLES - 1
    assert log.report.longest_gap_s["gyro"] == pytest.approx(11 / RATE_HZ)
    assert len(log.reference) == NUM_SAMPLES - 2


def test_a_clock_that_jitters_back_is_mended_and_counted(tmp_path: Path, trial: Variables) -> None:
    trial["ts"][0, 50] -= 0.007
    log = foot_vicon.read(put(tmp_path, trial))
    assert dict(log.report.mended) == {"the clock jittered back": 1}
    np.testing.assert_allclose(log.rows["accel"][48:52, 0], np.array([48, 49, 49, 51]) / RATE_HZ, atol=1e-12)
    assert len(log.reference) == NUM_SAMPLES - 1


def _scale(columns: slice, factor: float) -> Change:
    def change(trial: Variables) -> None:
        trial["imu"][:, columns] *= factor

    return change


def _set(name: str, value: Any) -> Change:
    return lambda trial: trial.update({name: value})


def _back(trial: Variables) -> None:
    trial["ts"][0, 100:] -= 0.2


def _pause(trial: Variables) -> None:
    trial["ts"][0, 100:] += 61.0


def _milliseconds(trial: Variables) -> None:
    trial["ts"] *= 1000


def _spike(trial: Variables) -> None:
    trial["imu"][7, 0] = 1e9


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (_scale(slice(0, 3), 1 / 9.80665), r"accel: .*looks like g: state the unit, or multiply"),
        (_scale(slice(3, 6), 57.3), r"gyro: .*looks like degree/s: state the unit, or multiply"),
        (_spike, r"accel, row 8: x_mps2 is 1e\+09, outside \[-490\.332, 490\.332\]"),
        (_back, r"sample 101: the time goes from 5\.495000 to 5\.300000 s; put the samples in order"),
        (_pause, r"every sensor, after 0\.495 s: nothing for 61 s; .*split the file"),
        (_milliseconds, r"median step of time is 5 s; it looks like milliseconds"),
        (_set("imu", np.zeros((6, 400))), r"'imu' has shape \(6, 400\), expected \(N, 6\); transpose it"),
        (_set("imu", np.zeros((400, 5))), r"'imu' has shape \(400, 5\), expected \(N, 6\); export it anew"),
        (_set("imu", "text"), r"'imu' is no array of real numbers"),
        (_set("imu", np.full((400, 6), 1j)), r"'imu' is no array of real numbers"),
        (_set("imu", np.array([[1, "a"]], dtype=object)), r"'imu' is no array of real numbers"),
        (_set("ts", np.zeros((1, 399))), r"'ts' has shape \(1, 399\), expected one row or column of 400"),
        (_set("ts", np.zeros((1, 400))), r"all 400 samples have one time, 0;"),
        (_set("ts", np.full((1, 400), np.nan)), r"sample 2: the time goes from nan"),
        (_set("gt", np.zeros((399, 3))), r"'gt' has 399 rows and imu has 400"),
        (lambda trial: trial.pop("gt"), r"no variable 'gt' among imu, ts"),
    ],
)
def test_a_trial_that_cannot_be_right_is_refused(tmp_path: Path, trial: Variables, change: Change, says: str) -> None:
    change(trial)
    with pytest.raises(RecordingError, match=says) as caught:
        foot_vicon.read(put(tmp_path, trial))
    assert "walk.mat" in str(caught.value) and "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("content", "says"),
    [
        (b"", "the file is empty"),
        (b"Time (s),Gyroscope X (deg/s)\n", "not a MATLAB file of version 5"),
        (b"MATLAB 7.3 MAT-file" + b" " * 600, "version 7.3"),
        (b"\x89HDF\r\n\x1a\n" + b"\0" * 600, "version 7.3"),
        (b" " * 512 + b"\x89HDF\r\n\x1a\n", "version 7.3"),
        (b"MATLAB 5.0 MAT-file".ljust(128), "byte order"),
        (b"MATLAB 5.0 MAT-file".ljust(126) + b"IM", "no variable 'imu' among none"),
        (b"MATLAB 5.0 MAT-file".ljust(126) + b"IM" + b"\x0f\0\0\0\x05\0\0\0ABCDE", "damaged"),
    ],
)
def test_other_files_are_refused(tmp_path: Path, content: bytes, says: str) -> None:
    path = tmp_path / "walk.mat"
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=says):
        foot_vicon.read(path)
    with pytest.raises(RecordingError, match="cannot be read"):
        foot_vicon.read(tmp_path / "nowhere.mat")


def test_every_byte_of_compressed_data_counts(tmp_path: Path, trial: Variables) -> None:
    """A stream that ends too early is damage, not a shorter walk."""
    inner = put(tmp_path, {"imu": trial["imu"]}).read_bytes()[128:]
    packed = zlib.compress(inner)[:-20]
    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    path = tmp_path / "cut.mat"
    path.write_bytes(head + b"\x0f\0\0\0" + len(packed).to_bytes(4, "little") + packed)
    with pytest.raises(RecordingError, match="cut off"):
        load(path, ("imu",))


def test_strides_of_a_walk_count_samples_from_zero_and_are_mirrored(tmp_path: Path, walk: Variables) -> None:
    reference = foot_stride_gcp.read(put(tmp_path, walk)).reference
    np.testing.assert_allclose(reference.t_s, np.array([0, 100, 250, 399]) / RATE_HZ, atol=1e-12)
    np.testing.assert_array_equal(reference.xy_m, [[0, 0], [1, -0.5], [2, -1.5], [3, -2.5]])
    assert reference.surveyed.all()


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (_set("strideIndex", [[0, 100, 250, 400]]), "'strideIndex' ends with 400 and there are 400 samples"),
        (_set("strideIndex", [[0, 250, 100, 399]]), "'strideIndex' is 100 at stride 3; expected whole numbers"),
        (_set("strideIndex", [[-1, 100, 250, 399]]), "'strideIndex' is -1 at stride 1"),
        (_set("strideIndex", [[0.5, 100, 250, 399]]), "'strideIndex' is 0.5 at stride 1"),
        (_set("strideIndex", [[0, np.nan, 250, 399]]), "'strideIndex' is nan at stride 2"),
        (_set("GCP", np.zeros((3, 2))), "'GCP' has 3 rows and strideIndex 4"),
        (lambda walk: walk.pop("GCP"), "no variable 'GCP'"),
    ],
)
def test_labels_that_cannot_be_right_are_refused(tmp_path: Path, walk: Variables, change: Change, says: str) -> None:
    change(walk)
    with pytest.raises(RecordingError, match=says):
        foot_stride_gcp.read(put(tmp_path, walk))


@pytest.mark.data
def test_the_recorded_trials_have_their_known_facts(data_root: Path) -> None:
    """Gravity 9.8 m/s^2 along -z at rest, 200 Hz, and rests as they are labelled."""
    paths = sorted((data_root / "foot_vicon" / "data").glob("*.mat"))
    if not paths:
        pytest.skip("foot_vicon is not under PDRBENCH_DATA")
    for path in paths[:6]:
        log = foot_vicon.read(path)
        t_s = log.rows["accel"][:, 0]
        assert (len(t_s) - 1) / t_s[-1] == pytest.approx(200.0, rel=1e-3)
        still = loadmat(path)["zv_shoe_opt"].ravel() != 0
        assert log.rows["accel"][still, 3].mean() == pytest.approx(-9.5, abs=0.4)


def table_of_strides(path: Path) -> tuple[Any, Any, Any]:
    """Sample, time and place of each stride, y mirrored as the reader mirrors it."""
    sample, clock_s, x_m, y_m = np.genfromtxt(path, delimiter=",", skip_header=1).T
    return sample.astype(int), clock_s, np.column_stack([x_m, -y_m])


@pytest.mark.data
def test_stride_indices_count_from_zero_in_the_recorded_data(data_root: Path) -> None:
    """The tables of `foot_vicon` hold its motion capture at the samples of that index, turned, to the last bit.

    The sample before is millimetres away; a rigid turn found by least squares leaves 1e-12 m with the right one.
    """
    tables = sorted((data_root / "foot_stride_gcp" / "vicon_stride_labels").glob("*.csv"))
    trials = data_root / "foot_vicon" / "data"
    pairs = [(table, trials / f"{table.name.partition('_')[0]}.mat") for table in tables]
    pairs = [(table, trial) for table, trial in pairs if trial.is_file()]
    if not pairs:
        pytest.skip("foot_stride_gcp and foot_vicon are not both under PDRBENCH_DATA")
    for table, trial in pairs[:8]:
        sample, _, strides_m = table_of_strides(table)
        here, there = (xy_m @ [1, 1j] for xy_m in (strides_m, foot_vicon.read(trial).reference.xy_m[sample]))
        here, there = here - here.mean(), there - there.mean()
        turn = np.vdot(there, here)
        assert np.abs(here - there * turn / abs(turn)).max() < 1e-9
