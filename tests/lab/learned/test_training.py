"""Learned stride and heading: steady yaw, windows, their changes, training on tiny budgets."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from itertools import islice

import numpy as np
import pytest

from pdrbench.errors import DatasetError, PdrbenchError
from pdrbench.geometry import FloatArray
from pdrbench.inertial.quaternions import multiply
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Trajectory
from pdrbench_formats.recordings import native

torch = pytest.importorskip("torch", reason="needs the extra `learned`")
pytest.importorskip("safetensors", reason="needs the extra `learned`")

from pdrbench_baselines.learned.signals import grid_signals, turned, window_before  # noqa: E402
from pdrbench_baselines.learned.yaw_stabiliser import YawStabiliser  # noqa: E402
from pdrbench_lab.learned.batches import UNCHANGED, Feed  # noqa: E402
from pdrbench_lab.learned.data import Way, bent_way, gather, load_or_gather, windows_of, windows_of_sources  # noqa: E402
from pdrbench_lab.learned.model import NetworkOutput, surprise  # noqa: E402
from pdrbench_lab.learned.people import train_bearer  # noqa: E402
from pdrbench_lab.learned.public_sets import stabilised  # noqa: E402

SENSORS = ("accel", "gyro", "rotation")


def about_z(yaw_rad: FloatArray) -> FloatArray:
    """(n, 4) flat phones."""
    nothing = np.zeros_like(yaw_rad)
    return np.column_stack([np.cos(yaw_rad / 2), nothing, nothing, np.sin(yaw_rad / 2)])


def yaw_of(rotation: FloatArray) -> FloatArray:
    return np.unwrap(2 * np.arctan2(rotation[:, 4], rotation[:, 1]))


def wobbling(seconds: float = 20.0) -> tuple[FloatArray, FloatArray, FloatArray]:
    """True yaw (n,) of a flat phone, rotation vectors whose compass wobbles by 0.2 rad, and rates."""
    t_s = np.arange(0, seconds, 0.02)
    true_rad = 0.8 * np.sin(0.5 * t_s)
    rate = np.zeros((len(t_s), 4))
    rate[:, 0], rate[:, 3] = t_s, 0.4 * np.cos(0.5 * t_s)
    reported_rad = true_rad + 0.2 * np.sin(2 * np.pi * t_s / 4)
    return true_rad, np.column_stack([t_s, about_z(reported_rad)]), rate


def test_the_yaw_stabiliser_keeps_turns_and_smooths_the_compass() -> None:
    true_rad, rotation, gyro = wobbling()
    error_rad = yaw_of(stabilised(rotation, gyro)) - true_rad
    assert np.abs(error_rad[500:]).max() < 0.04  # 0.2 / (2 pi x 2.5 periods) of the mean, and its beginning
    assert np.abs(yaw_of(rotation) - true_rad)[500:].max() > 0.19


def test_steady_yaw_in_parts_and_turned() -> None:
    _, rotation, gyro = wobbling(8.0)
    whole = stabilised(rotation, gyro)
    by_parts, parts = YawStabiliser(), []
    for k in range(0, len(rotation), 7):
        behind = slice(max(k - 3, 0), max(k + 4, 0))  # rates come 60 ms late
        parts.append(by_parts.update(rotation[k : k + 7], gyro[behind]))
    together = np.concatenate(parts)
    np.testing.assert_allclose(together, whole[: len(together)], atol=1e-12)
    assert len(together) > len(whole) - 10
    by = about_z(np.array([2.0]))[0]
    other = stabilised(np.column_stack([rotation[:, 0], multiply(by, rotation[:, 1:])]), gyro)
    np.testing.assert_allclose(other[:, 1:], multiply(by, whole[:, 1:]), atol=1e-12)


def test_steady_yaw_follows_the_report_where_rates_are_missing() -> None:
    _, rotation, gyro = wobbling(8.0)
    reported = stabilised(rotation, gyro[(gyro[:, 0] < 3.0) | (gyro[:, 0] > 5.0)])
    gone = (rotation[:, 0] > 3.1) & (rotation[:, 0] < 4.9)
    own, given = yaw_of(reported)[gone], yaw_of(rotation)[gone]
    np.testing.assert_allclose(np.diff(own), np.diff(given), atol=0.01)
    assert np.isfinite(reported).all()


def test_a_yaw_that_lags_is_followed_until_it_has_settled_after_a_gap() -> None:
    """A turn by 60 degrees within a gap, which the reported yaw makes a second later and the rates never show."""
    t_s = np.arange(0.0, 12.0, 0.02)
    kept = (t_s < 8.0) | (t_s > 8.6)
    rotation = np.column_stack([t_s, about_z(np.radians(60.0) * (t_s > 9.4))])[kept]
    gyro = np.column_stack([t_s, np.zeros((len(t_s), 3))])[kept]
    assert np.degrees(yaw_of(YawStabiliser().update(rotation, gyro))[-1]) == pytest.approx(60.0)


def test_surprise_is_minus_the_log_likelihood() -> None:
    from scipy.stats import multivariate_normal

    factor = np.array([[0.3, 0.0], [-0.1, 0.2]])
    output = NetworkOutput(torch.zeros(1, 2), torch.tensor(factor[None], dtype=torch.float32), torch.zeros(1))
    at = np.array([0.2, 0.4])
    expected = -multivariate_normal([0, 0], factor @ factor.T).logpdf(at) - math.log(2 * math.pi)
    assert float(surprise(output, torch.tensor(at[None], dtype=torch.float32))[0]) == pytest.approx(expected, rel=1e-5)


def test_training_and_inference_have_the_same_windows() -> None:
    windows, _ = gather(_people(1))
    feed, streams = Feed(windows), train_bearer(0).streams
    rows = {name: streams[name].rows for name in SENSORS}
    rows["rotation"] = stabilised(rows["rotation"], rows["gyro"])
    from_s = np.ceil(max(one[0, 0] for one in rows.values()))
    signals = grid_signals(*[rows[name] for name in SENSORS], from_s, from_s + 12.0)
    batch = feed.batch(torch.arange(10))
    for second in (0, 2, 9):  # begun less than 4 s ago, and later
        features, yaw_rad = window_before(signals, int(windows.end[second]))
        np.testing.assert_allclose(batch.window[second].numpy(), features, atol=2e-4)
        np.testing.assert_allclose(turned(batch.move_m[second].numpy(), yaw_rad), windows.move_m[second], atol=1e-5)


def test_every_window_is_in_one_batch() -> None:
    windows, _ = gather(_people(2))
    numbers = torch.cat([batch.number for batch in Feed(windows).in_order(size=100)])
    assert sorted(numbers.tolist()) == list(range(len(windows)))


def test_mirroring_swaps_left_and_right() -> None:
    windows, _ = gather(_people(1))
    feed, which = Feed(windows), torch.arange(20)
    plain = feed.batch(which)
    mirrored = feed.batch(
        which, torch.Generator().manual_seed(0), dataclasses.replace(UNCHANGED, mirrored_fraction=1.0)
    )
    sign = torch.tensor([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0])[:, None]
    np.testing.assert_allclose(mirrored.window, plain.window * sign, atol=1e-6)
    np.testing.assert_allclose(mirrored.move_m, plain.move_m * sign[:2, 0], atol=1e-6)


def test_people_are_disjoint_the_same_again_and_more_begin_like_fewer() -> None:
    one, same = (train_bearer(1, walk_s=3.0) for _ in range(2))
    np.testing.assert_array_equal(one.streams["accel"].rows, same.streams["accel"].rows)
    ours, others = (
        {
            train_bearer(number, group=group, walk_s=3.0).building.polygons[0].outline_xy_m.tobytes()
            for number in range(2)
        }
        for group in ("train", "val")
    )
    assert not ours & others
    first, of_more = (next(islice(windows_of_sources(("bearers",), count), 1)) for count in (1, 2))
    np.testing.assert_array_equal(first.signals.accel, of_more.signals.accel)


def test_way_between_places_meets_them_and_leaves_out_detours() -> None:
    t_s = np.arange(0, 21, 0.02)
    accel = np.zeros((len(t_s), 3))
    accel[:, 2] = 9.81 + 3.0 * np.sin(2 * np.pi * 1.9 * t_s)
    quaternion = np.tile([1.0, 0.0, 0.0, 0.0], (len(t_s), 1))  # points north
    rows = {"accel": accel, "gyro": np.zeros((len(t_s), 3)), "rotation": quaternion}
    streams = {name: SensorStream(sensor_spec(name), np.column_stack([t_s, one])) for name, one in rows.items()}
    places = Trajectory(
        t_s=np.array([2.0, 10.0, 18.0]),
        xy_m=np.array([[0.0, 0.0], [0.5, 9.0], [9.0, 9.0]]),
        level=np.zeros(3, dtype=np.int64),
        surveyed=np.ones(3, dtype=np.bool_),
    )
    recording = Recording("x", None, streams, places)
    way, known_s = bent_way(recording)
    assert known_s.tolist() == [[2.0, 10.0]]  # the second leg leads east, the phone points north
    at = [np.interp(places.t_s[:2], way.t_s, one) for one in way.xy_m.T]
    np.testing.assert_allclose(np.column_stack(at)[1], places.xy_m[1], atol=0.15)
    middle = np.interp(6.0, way.t_s, way.xy_m[:, 1])
    assert middle == pytest.approx(4.5, abs=0.4)
    part = windows_of("x", "mall", recording, Way(way, known_s))
    assert len(part.end) == 13  # of 1 s, every 0.5 s, within 8 s and not at its ends, where the way may leap


def test_windows_are_made_again_to_the_byte_by_any_number_of_processes(tmp_path) -> None:
    for name, jobs in (("one", 1), ("two", 2)):
        load_or_gather(tmp_path / name, ("bearers",), 2, "val", jobs=jobs)
    one, two = (json.loads((tmp_path / name / "manifest-val.json").read_text()) for name in ("one", "two"))
    assert one == two
    assert one["made_with"]["numpy"] == np.__version__
    assert len(one["walks"]) == 2


def test_own_recordings_are_a_source(tmp_path) -> None:
    for number in range(2):
        native.write(train_bearer(number, walk_s=12.0), tmp_path / f"walk{number}")
    windows, rows = gather(windows_of_sources(("own",), 0, recordings=tmp_path))
    assert [row["source"] for row in rows] == ["own", "own"]
    assert len(windows) == 2 * 51  # of 12 s, every 0.2 s from the end of the first second on
    with pytest.raises(DatasetError, match="no recording"):
        gather(windows_of_sources(("own",), 0, recordings=tmp_path / "walk0" / "none"))
    with pytest.raises(PdrbenchError, match="--recordings DIR"):
        gather(windows_of_sources(("own",), 0))


def test_what_a_task_file_names_is_trained_on_in_any_format(tmp_path) -> None:
    """CSV without an attitude, places beside it with decimal commas; walks of other splits are left out."""
    recording = train_bearer(0, walk_s=12.0)
    accel, gyro = (recording.streams[name].rows for name in ("accel", "gyro"))
    rows = np.column_stack([accel, *(np.interp(accel[:, 0], gyro[:, 0], axis) for axis in gyro[:, 1:].T)])
    way = recording.reference
    for name in ("one", "two"):
        np.savetxt(tmp_path / f"{name}.csv", rows, delimiter=",", header="t,ax,ay,az,gx,gy,gz", comments="")
        places = [f"{t:.3f};{x:.4f};{y:.4f}" for t, (x, y) in zip(way.t_s, way.xy_m, strict=True)]
        (tmp_path / f"{name}_truth.csv").write_text("\n".join(["t_s;x_m;y_m", *places, ""]).replace(".", ","))
    walks = '[[walk]]\nfile = "one.csv"\nsplit = "train"\nmounting = "hand"\n[[walk]]\nfile = "two.csv"\n'
    (tmp_path / "task.toml").write_text(walks)
    windows, (row,) = gather(windows_of_sources(("own",), 0, recordings=tmp_path))
    assert row["source"] == "own" and len(windows) > 40
    (tmp_path / "task.toml").write_text(walks.replace("train", "val"))
    with pytest.raises(DatasetError, match="no walk of the split 'train'"):
        gather(windows_of_sources(("own",), 0, recordings=tmp_path))


def test_windows_kept_for_something_else_are_refused(tmp_path) -> None:
    load_or_gather(tmp_path, ("bearers",), 1, "val")
    with pytest.raises(PdrbenchError, match="another folder"):
        load_or_gather(tmp_path, ("bearers",), 2, "val")
    path, manifest_path = tmp_path / "windows-val.npz", tmp_path / "manifest-val.json"
    with np.load(path) as stored:
        np.savez(path, **stored, steps=np.zeros(1))
    manifest = json.loads(manifest_path.read_text())
    manifest_path.write_text(json.dumps(manifest | {"sha256": hashlib.sha256(path.read_bytes()).hexdigest()}))
    with pytest.raises(PdrbenchError, match="another version"):
        load_or_gather(tmp_path, ("bearers",), 1, "val")
    path.write_bytes(b"torn")
    with pytest.raises(PdrbenchError, match="torn"):
        load_or_gather(tmp_path, ("bearers",), 1, "val")


@pytest.mark.parametrize("kind", ["campus", "bearers"])
def test_every_source_gives_windows(kind: str) -> None:
    part = next(islice(windows_of_sources((kind,), 1), 1))
    assert len(part.end) > 60
    assert 0.5 < np.percentile(np.hypot(*part.move_m.T), 90) < 2.0  # people walk


def _people(count: int):
    return windows_of_sources(("bearers",), count)
