"""Learned stride and heading: frames, gaps, units, weights, training, all on tiny budgets."""

from __future__ import annotations

import dataclasses
import math
import sys

import numpy as np
import pytest

from pdrbench.errors import DatasetError, PdrbenchError, RecordingError, UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.inertial.user_heading import multiply
from pdrbench.localizer import Briefing
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Trajectory

torch = pytest.importorskip("torch", reason="needs the extra `learned`")
pytest.importorskip("safetensors", reason="needs the extra `learned`")

from pdrbench_baselines.learned.batches import Augmentation, Feed  # noqa: E402
from pdrbench_baselines.learned.data import Source, _bent, gather, load_or_gather  # noqa: E402
from pdrbench_baselines.learned.localizer import Learned, load_network  # noqa: E402
from pdrbench_baselines.learned.map_filter import MapFilter, MapFilterParams  # noqa: E402
from pdrbench_baselines.learned.model import ARCHITECTURES, Network, Told, surprise  # noqa: E402
from pdrbench_baselines.learned.people import train_people  # noqa: E402
from pdrbench_baselines.learned.reckoning import Reckoner  # noqa: E402
from pdrbench_baselines.learned.signals import grid_signals, turned, window_before  # noqa: E402
from pdrbench_baselines.learned.train import MODEL, TrainParams, train  # noqa: E402
from pdrbench_baselines.learned.weights import restore, store  # noqa: E402
from pdrbench_baselines.li2012_steps import corridor  # noqa: E402

SENSORS = ("accel", "gyro", "rotation")
STILL = Augmentation(*[0.0] * len(dataclasses.fields(Augmentation)))


def network(arch: str = "tcn") -> Network:
    """One that says something, and the same in every run."""
    torch.manual_seed(1)
    return Network(arch, 8).eval()


def phone(rng: np.random.Generator, seconds: float = 9.0, rate_hz: float = 50.0) -> dict[str, FloatArray]:
    """Rows of a phone that is shaken about a tilted attitude."""
    t_s = np.arange(0, seconds, 1 / rate_hz)
    swing = [np.sin(2 * np.pi * f * t_s[:, None] + rng.uniform(0, 6, 3)) for f in (0.9, 1.8, 3.6)]
    accel = np.array([0.0, 4.0, 9.0]) + sum(swing)
    gyro = 0.5 * swing[0]
    half = 0.2 + 0.05 * np.sin(t_s)
    rotation = np.column_stack([np.cos(half), np.sin(half), 0.1 * np.sin(half), 0.3 * np.ones(len(t_s))])
    rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
    return {
        "accel": np.column_stack([t_s, accel]),
        "gyro": np.column_stack([t_s, gyro]),
        "rotation": np.column_stack([t_s, rotation]),
    }


def briefing(rate_hz: float = 50.0, sensors: tuple[str, ...] = SENSORS) -> Briefing:
    return Briefing(None, {name: dataclasses.replace(sensor_spec(name), rate_hz=rate_hz) for name in sensors}, 0.2)


def moves(rows: dict[str, FloatArray], rate_hz: float = 50.0, chunk_s: float = 0.2):
    reckoner, found = Reckoner(network(), briefing(rate_hz)), []
    for until_s in np.arange(chunk_s, max(one[-1, 0] for one in rows.values()) + chunk_s, chunk_s):
        new = {name: one[(one[:, 0] > until_s - chunk_s) & (one[:, 0] <= until_s)] for name, one in rows.items()}
        if until_s == chunk_s:
            new = {name: one[one[:, 0] <= until_s] for name, one in rows.items()}
        found += list(reckoner.update(new))
    return found


def test_rotating_the_walk_rotates_the_estimate(rng: np.random.Generator) -> None:
    rows, angle_rad = phone(rng), 2.1
    by = np.array([math.cos(angle_rad / 2), 0.0, 0.0, math.sin(angle_rad / 2)])
    about = rows | {"rotation": np.column_stack([rows["rotation"][:, 0], multiply(by, rows["rotation"][:, 1:])])}
    one, two = moves(rows), moves(about)
    assert len(one) == len(two) >= 8
    for before, after in zip(one, two, strict=True):
        np.testing.assert_allclose(after.move_m, turned(before.move_m, angle_rad), atol=1e-5)
        turn = np.array([turned(np.array([1.0, 0.0]), angle_rad), turned(np.array([0.0, 1.0]), angle_rad)]).T
        np.testing.assert_allclose(after.covariance_m2, turn @ before.covariance_m2 @ turn.T, atol=1e-5)


def test_chunks_do_not_matter(rng: np.random.Generator) -> None:
    rows = phone(rng)
    one, two = moves(rows, chunk_s=0.2), moves(rows, chunk_s=0.5)
    assert [move.end_s for move in one] == [move.end_s for move in two]
    np.testing.assert_allclose([move.move_m for move in one], [move.move_m for move in two], atol=1e-6)


@pytest.mark.parametrize("rate_hz", [25.0, 100.0, 200.0])
def test_other_rates_tell_nearly_the_same(rate_hz: float) -> None:
    usual, other = (
        grid_signals(*(phone(np.random.default_rng(3), rate_hz=hz)[name] for name in SENSORS), 1.0, 7.0)
        for hz in (50.0, rate_hz)
    )
    np.testing.assert_allclose(other.accel, usual.accel, atol=0.25)
    np.testing.assert_allclose(other.up, usual.up, atol=1e-3)


def test_gap_is_bridged_and_fades(rng: np.random.Generator) -> None:
    rows = phone(rng, 12.0)
    rows["gyro"] = rows["gyro"][(rows["gyro"][:, 0] < 5.5) | (rows["gyro"][:, 0] > 8.2)]
    guessed = {move.end_s: move.is_guess for move in moves(rows)}
    assert [end_s for end_s, is_guess in guessed.items() if is_guess] == [6.0, 7.0, 8.0, 9.0]
    found = {move.end_s: move.move_m for move in moves(rows)}
    np.testing.assert_allclose(found[7.0], 0.25 * found[5.0], atol=1e-9)


def test_other_units_are_refused(rng: np.random.Generator) -> None:
    in_g = phone(rng)
    in_g["accel"][:, 1:] /= 9.81
    with pytest.raises(RecordingError, match=r"multiply by 9\.81"):
        moves(in_g)
    in_degrees = phone(rng)
    in_degrees["gyro"][:, 1:] = 57.3
    with pytest.raises(RecordingError, match="rad/s are expected"):
        moves(in_degrees)


def test_slow_or_missing_sensors_are_unsuitable() -> None:
    with pytest.raises(UnsuitableError, match="20 Hz or more"):
        Reckoner(network(), briefing(10.0))
    with pytest.raises(UnsuitableError, match="'gyro'"):
        Reckoner(network(), briefing(sensors=("accel", "rotation")))


@pytest.mark.parametrize("arch", sorted(ARCHITECTURES))
def test_weights_survive_and_refuse(arch: str, tmp_path) -> None:
    path = tmp_path / "model.safetensors"
    sha256 = store(network(arch), path)
    window, height_m = torch.ones(2, 9, 200), torch.tensor([0.0, 1.8])
    assert torch.equal(restore(path, sha256)(window, height_m).move_m, network(arch)(window, height_m).move_m)
    with pytest.raises(DatasetError, match="expected 0000"):
        restore(path, "0" * 64)
    with pytest.raises(DatasetError, match="learned train"):
        restore(tmp_path / "none.safetensors")
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(DatasetError, match="not the weights"):
        restore(path)


def test_weights_of_another_shape_are_refused(tmp_path) -> None:
    small, path = network(), tmp_path / "model.safetensors"
    small.width = 16
    store(small, path)
    with pytest.raises(DatasetError, match="another network"):
        restore(path)


def test_without_torch_the_remedy_is_told(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in [name for name in sys.modules if name.startswith("pdrbench_baselines.learned.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "torch", None)
    from pdrbench_baselines.learned.localizer import Learned as Anew

    with pytest.raises(PdrbenchError, match=r"pip install 'pdrbench\[learned\]'"):
        Anew()


def test_unknown_parameters_are_refused() -> None:
    with pytest.raises(PdrbenchError, match="carry_s"):
        Learned({"carry": 3.0})


def test_surprise_is_minus_the_log_likelihood() -> None:
    from scipy.stats import multivariate_normal

    factor = np.array([[0.3, 0.0], [-0.1, 0.2]])
    told = Told(
        torch.zeros(1, 2),
        torch.zeros(1),
        torch.zeros(1, 2),
        torch.tensor(factor[None], dtype=torch.float32),
        torch.zeros(1),
    )
    at = np.array([0.2, 0.4])
    expected = -multivariate_normal([0, 0], factor @ factor.T).logpdf(at) - math.log(2 * math.pi)
    assert float(surprise(told, torch.tensor(at[None], dtype=torch.float32))[0]) == pytest.approx(expected, rel=1e-5)


def test_training_sees_what_asking_sees() -> None:
    windows, _ = gather(_people(1))
    feed, streams = Feed(windows, "cpu"), next(_people(1)).recording.streams
    rows = [streams[name].rows for name in SENSORS]
    from_s = np.ceil(max(one[0, 0] for one in rows) * 2) / 2
    signals = grid_signals(*rows, from_s, from_s + 12.0)
    for number in (0, 2, 9):  # begun less than 4 s ago, and later
        batch = feed.batch(torch.tensor([number]))
        features, yaw_rad = window_before(signals, int(windows.end[number]))
        np.testing.assert_allclose(batch.window[0].numpy(), features, atol=2e-4)
        np.testing.assert_allclose(turned(batch.move_m[0].numpy(), yaw_rad), windows.move_m[number], atol=1e-5)


def test_mirroring_swaps_left_and_right() -> None:
    windows, _ = gather(_people(1))
    feed, which = Feed(windows, "cpu"), torch.arange(4)
    plain = feed.batch(which)
    mirrored = feed.batch(which, torch.Generator().manual_seed(0), dataclasses.replace(STILL, mirror_share=1.0))
    sign = torch.tensor([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0, -1.0, 1.0, 1.0])[:, None]
    np.testing.assert_allclose(mirrored.window, plain.window * sign, atol=1e-6)
    np.testing.assert_allclose(mirrored.move_m, plain.move_m * sign[:2, 0], atol=1e-6)


def test_people_are_disjoint_and_more_begin_like_fewer() -> None:
    two, three = ([walk.recording for walk in train_people(count, walk_s=3.0)] for count in (2, 3))
    others = [walk.recording for walk in train_people(3, group="val", walk_s=3.0)]
    for one, same in zip(two, three, strict=False):
        np.testing.assert_array_equal(one.streams["accel"].rows, same.streams["accel"].rows)
    assert not {r.building.polygons[0].outline_xy_m.tobytes() for r in three} & {
        r.building.polygons[0].outline_xy_m.tobytes() for r in others
    }


def test_way_between_places_meets_them_and_leaves_out_detours(rng: np.random.Generator) -> None:
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
    walk: Source = _bent("x", "mall", Recording("x", None, streams, places))
    assert walk.known_s.tolist() == [[2.0, 10.0]]  # the second leg leads east, the phone points north
    at = [np.interp(places.t_s[:2], walk.way.t_s, one) for one in walk.way.xy_m.T]
    np.testing.assert_allclose(np.column_stack(at)[1], places.xy_m[1], atol=0.15)
    middle = np.interp(6.0, walk.way.t_s, walk.way.xy_m[:, 1])
    assert middle == pytest.approx(4.5, abs=0.4)


@pytest.mark.slow
def test_same_seed_same_network_also_when_resumed(tmp_path) -> None:
    tiny = TrainParams(arch="tcn", width=8, sources=("people",), people=3, val_people=2, epochs=2, seed=5)
    whole = train(tmp_path / "whole", tiny)
    train(tmp_path / "parts", tiny, budget_min=0.0)
    parts = train(tmp_path / "parts", tiny)
    assert (tmp_path / "whole" / MODEL).read_bytes() == (tmp_path / "parts" / MODEL).read_bytes()
    assert parts == whole
    with pytest.raises(PdrbenchError, match="other settings"):
        train(tmp_path / "parts", dataclasses.replace(tiny, rate=1.0))


def test_windows_kept_for_something_else_are_refused(tmp_path) -> None:
    load_or_gather(tmp_path, ("people",), 1, "val")
    with pytest.raises(PdrbenchError, match="another folder"):
        load_or_gather(tmp_path, ("people",), 2, "val")
    (tmp_path / "windows-val.npz").write_bytes(b"torn")
    with pytest.raises(PdrbenchError, match="torn"):
        load_or_gather(tmp_path, ("people",), 1, "val")


def test_walls_tell_heading_and_length(rng: np.random.Generator) -> None:
    true_m = np.concatenate([np.tile([1.0, 0.0], (29, 1)), np.tile([0.0, 1.0], (15, 1)), np.tile([-1.0, 0.0], (20, 1))])
    told_m = 1.05 * turned(true_m, math.radians(7.0))
    end_m = np.array([2.0, 0.0]) + true_m.sum(axis=0)
    cloud = MapFilter(corridor(), rng, MapFilterParams(), 0)
    cloud.begin_near(np.array([2.0, 0.0]))
    for move_m in told_m:
        cloud.move(move_m, 0.05**2 * np.eye(2))
    assert np.hypot(*(np.array([2.0, 0.0]) + told_m.sum(axis=0) - end_m)) > 1.5
    assert np.hypot(*(cloud.xy_m - end_m)) < 1.0
    assert math.degrees(cloud.bias_rad.mean()) == pytest.approx(-7.0, abs=3.0)
    assert cloud.resets == 0


def test_network_of_pdrbench_loads() -> None:
    assert sum(values.numel() for values in load_network().parameters()) <= 5_000_000


def _people(count: int):
    from pdrbench_baselines.learned.data import sources

    return sources(("people",), count)


def test_every_source_gives_windows() -> None:
    from itertools import islice

    from pdrbench_baselines.learned.data import sources, windows_of

    for kind in ("people", "office"):
        _, end, move_m = windows_of(next(islice(sources((kind,), 1), 1)))
        assert len(end) > 30
        assert 0.5 < np.percentile(np.hypot(*move_m.T), 90) < 2.0  # somebody walks
