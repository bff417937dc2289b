"""RoNIN and TLIO: sizes, the cloning filter, streams, weights, resumed training."""

from __future__ import annotations

import dataclasses
import json
import math
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import DatasetError, PdrbenchError, UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Observation
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start, Trajectory

torch = pytest.importorskip("torch", reason="needs the extra `learned`")
pytest.importorskip("safetensors", reason="needs the extra `learned`")

from safetensors.torch import save_file  # noqa: E402

from pdrbench_lab.learned.data import Way  # noqa: E402
from pdrbench_lab.learned.odometry import localizer as odometry  # noqa: E402
from pdrbench_lab.learned.odometry.aligned import LENGTH, RATE_HZ  # noqa: E402
from pdrbench_lab.learned.odometry.cloning_filter import CURRENT, CloningFilter, CloningParams, rotation_matrix  # noqa: E402
from pdrbench_lab.learned.odometry.inference import for_inference  # noqa: E402
from pdrbench_lab.learned.odometry.localizer import Odometry, RoninParams, TlioParams  # noqa: E402
from pdrbench_lab.learned.odometry.resnet import PARAMETERS, RONIN, TLIO, Ronin, Tlio, num_parameters  # noqa: E402
from pdrbench_lab.learned.odometry.stream import PhoneStream  # noqa: E402
from pdrbench_lab.learned.odometry.train import Feed, OdometryTrainParams, _Run, left_out, loss_of  # noqa: E402
from pdrbench_lab.learned.odometry.weights import restore, store  # noqa: E402
from pdrbench_lab.learned.odometry.windows import OdometryWindows, windows_of  # noqa: E402

SENSORS = ("accel", "gyro", "rotation")
UP = np.array([0.0, 0.0, 9.81])


def windows(rng: np.random.Generator, count: int = 3) -> torch.Tensor:
    rows = rng.normal(0.0, 1.0, (count, 6, LENGTH))
    rows[:, 5] += 9.81
    return torch.from_numpy(rows.astype(np.float32))


def still(seconds: float = 6.0, rate_hz: float = 50.0, yaw_rad: float = 0.0) -> dict[str, FloatArray]:
    """Rows of a phone that moves at one speed: nothing but gravity."""
    t_s = np.arange(0, seconds, 1 / rate_hz)
    attitude = [math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)]
    return {
        "accel": np.column_stack([t_s, np.tile(UP, (len(t_s), 1))]),
        "gyro": np.column_stack([t_s, np.zeros((len(t_s), 3))]),
        "rotation": np.column_stack([t_s, np.tile(attitude, (len(t_s), 1))]),
    }


def briefing(rate_hz: float = 50.0, sensors: tuple[str, ...] = SENSORS, mounting: str = "hand") -> Briefing:
    specs = {name: dataclasses.replace(sensor_spec(name), rate_hz=rate_hz) for name in sensors}
    return Briefing(None, specs, 0.2, start=Start(xy_m=np.array([3.0, 4.0]), level=0), mounting=mounting)


def pieces(rows: dict[str, FloatArray], chunk_s: float) -> list[tuple[float, dict[str, FloatArray]]]:
    last_s = max(float(one[-1, 0]) for one in rows.values())
    ends_s = np.arange(chunk_s, last_s + chunk_s, chunk_s).tolist()
    return [
        (end, {n: r[(r[:, 0] > end - chunk_s - 1e-9) & (r[:, 0] <= end - 1e-9)] for n, r in rows.items()})
        for end in ends_s
    ]


def test_networks_have_the_published_number_of_parameters() -> None:
    assert num_parameters(Ronin()) == PARAMETERS[RONIN] == 4_634_882
    assert num_parameters(Tlio()) == PARAMETERS[TLIO] == 5_424_646


def test_likelihood_is_least_at_the_true_displacement(rng: np.random.Generator) -> None:
    torch.manual_seed(3)
    network, window = Tlio().eval(), windows(rng, 1)
    with torch.no_grad():
        move_m, _ = network(window)
        least = loss_of(network, window, move_m[:, :2], is_warm_up=False)
        assert least < loss_of(network, window, move_m[:, :2] + 0.1, is_warm_up=False)
        error_m2 = loss_of(network, window, move_m[:, :2], is_warm_up=True)
        assert error_m2 == pytest.approx(float(move_m[0, 2] ** 2), abs=1e-6)


def test_packed_weights_give_nearly_the_same_and_are_known_by_their_hash(
    tmp_path: Path, rng: np.random.Generator
) -> None:
    torch.manual_seed(3)
    network, window = Ronin().eval(), windows(rng)
    path = tmp_path / "ronin.safetensors"
    sha256 = store(network, path, packed=True)
    assert path.stat().st_size < 1.05 * PARAMETERS[RONIN] + 100_000
    with torch.inference_mode():
        before, after = network(window), restore(path, sha256)(window)
    assert torch.allclose(before, after, atol=0.02 * float(before.abs().max()))
    with pytest.raises(DatasetError, match="sha256"):
        restore(path, "0" * 64)


def test_a_converted_checkpoint_loads_by_its_names_and_another_network_does_not(tmp_path: Path) -> None:
    path = tmp_path / "published.safetensors"
    save_file(Tlio().state_dict(), path)  # as a converter leaves it: counts of batches and all, no form
    assert isinstance(restore(path, arch=TLIO), Tlio)
    with pytest.raises(DatasetError, match="another network"):
        restore(path, arch=RONIN)
    with pytest.raises(DatasetError, match="expected one of"):
        restore(path)
    path.write_bytes(b"nothing")
    with pytest.raises(DatasetError, match="not the weights"):
        restore(path)


def synthetic_windows(rng: np.random.Generator) -> OdometryWindows:
    rows = rng.normal(0.0, 1.0, (600, 6)).astype(np.float32)
    begin = np.arange(0, 400, 10)
    move_m = rng.normal(0.0, 1.0, (len(begin), 2)).astype(np.float32)
    return OdometryWindows(rows, begin, move_m, begin % 20 // 10, begin * 0, begin // 10 % 4)


def test_a_resumed_run_gives_the_same_bytes(tmp_path: Path, rng: np.random.Generator) -> None:
    params = OdometryTrainParams("ronin", steps=2, batch=4)
    feed = Feed(synthetic_windows(rng), params)
    digests = []
    for name, stops in (("once", (2,)), ("resumed", (1, 2))):
        (tmp_path / name).mkdir()
        done = 0
        for stop in stops:
            run = _Run(tmp_path / name, params)
            assert run.done == done
            losses = [float(run.learn(feed)) for _ in range(done, stop)]
            run.keep(float(np.mean(losses)))
            done = stop
        digests.append((tmp_path / name / "model.safetensors").read_bytes())
    assert digests[0] == digests[1]
    with pytest.raises(PdrbenchError, match="other settings"):
        _Run(tmp_path / "once", dataclasses.replace(params, rate=1.0))
    assert json.loads((tmp_path / "once" / "progress.json").read_text())["done"] == 2


def test_outings_that_are_left_out_are_not_learned_from(rng: np.random.Generator) -> None:
    windows, params = synthetic_windows(rng), OdometryTrainParams("ronin", batch=64, leave_out=2)
    out = left_out(windows, params)
    assert np.array_equal(out, (windows.source == 1) & (windows.outing % 2 == 1))
    moves_m = np.hypot(*windows.move_m.T)
    _, drawn_m = Feed(windows, params).batch(0)  # turned, as long as they were
    found = {int(np.abs(moves_m - one).argmin()) for one in drawn_m.norm(dim=1).tolist()}
    assert found <= set(np.flatnonzero(~out).tolist())
    assert not left_out(windows, dataclasses.replace(params, leave_out=0)).any()


def test_a_batch_is_turned_with_its_displacements(rng: np.random.Generator) -> None:
    rows = np.tile([0.0, 0.0, 0.0, 1.0, 2.0, 9.81], (400, 1)).astype(np.float32)
    move_m = np.array([[1.0, 2.0]], dtype=np.float32)
    windows = OdometryWindows(rows, np.array([0]), move_m, *np.zeros((3, 1), dtype=np.int64))
    params = OdometryTrainParams("ronin", batch=8, accel_bias_mps2=0.0, gyro_bias_radps=0.0, tilt_rad=0.0)
    window, moved_m = Feed(windows, params).batch(3)
    assert torch.allclose(window[:, 3:5, 7], moved_m, atol=1e-5)  # force along the way stays along the way
    assert torch.allclose(moved_m.norm(dim=1), torch.full((8,), math.sqrt(5.0)), atol=1e-5)
    assert float(moved_m[:, 0].std()) > 0.5


@pytest.mark.parametrize("kind", [Ronin, Tlio])
def test_convolutions_as_products_give_the_same(kind: type[torch.nn.Module], rng: np.random.Generator) -> None:
    torch.manual_seed(3)
    network, window = kind(), windows(rng)
    network(window)  # gives the normalisations something to fold
    network.eval()
    with torch.inference_mode():
        before = network(window)
        after = for_inference(network)(window)
    for one, other in zip(before, after, strict=True):
        assert torch.allclose(one, other, atol=1e-5)


def test_windows_next_to_a_leg_that_is_left_out_are_left_out() -> None:
    rows = still(10.0)
    streams = {name: SensorStream(sensor_spec(name), one) for name, one in rows.items()}
    t_s = np.arange(0, 10, 0.1)
    way = Trajectory(
        t_s=t_s,
        xy_m=np.column_stack([t_s + 100.0 * (t_s > 5.0), 0 * t_s]),
        level=np.zeros(len(t_s), int),
        surveyed=np.ones(len(t_s), bool),
    )
    recording = Recording(id="walk", building=None, streams=streams, reference=way)
    _, begin, move_m = windows_of(recording, Way(way, known_s=np.array([[2.0, 5.0]])))
    assert begin.min() / RATE_HZ >= 2.1 - 1e-9
    assert (begin.max() + LENGTH) / RATE_HZ <= 4.9 + 1e-9
    assert np.allclose(move_m, [1.0, 0.0], atol=1e-9)


def test_samples_are_the_same_however_rows_are_cut(rng: np.random.Generator) -> None:
    rows = still(4.0)
    rows["accel"][:, 1:] += rng.normal(0.0, 1.0, (200, 3))
    found = []
    for chunk_s in (0.2, 1.0):
        stream, parts_of = PhoneStream(briefing()), []
        for _, new in pieces(rows, chunk_s):
            stream.update(new)
            if count := stream.ready(40):
                parts_of.append(stream.take(count, in_body=True).rows)
        found.append(np.concatenate(parts_of))
    length = min(map(len, found))
    assert length >= 700
    assert np.allclose(found[0][:length], found[1][:length], atol=1e-9)  # times are rounded otherwise


def test_what_cannot_be_used_is_declined() -> None:
    for wrong, what in (
        (briefing(mounting="foot"), "needs a phone"),
        (briefing(10.0), "20 Hz or more"),
        (briefing(sensors=("accel", "rotation")), "gyro"),
        (briefing(sensors=("accel", "gyro")), "heading of the start"),
    ):
        with pytest.raises(UnsuitableError, match=what):
            odometry.Ronin().reset(wrong, np.random.default_rng(0))
    with pytest.raises(PdrbenchError, match="divisor"):
        odometry.Ronin(RoninParams(every=30))


class Walking(torch.nn.Module):
    """Says that every window is of a walk along +x of its frame."""

    def __init__(self, arch: str) -> None:
        super().__init__()
        self.arch = arch

    def forward(self, window: torch.Tensor) -> torch.Tensor | tuple[torch.Tensor, torch.Tensor]:
        if self.arch == RONIN:
            return torch.tensor([[1.25, 0.0]]).repeat(len(window), 1)
        return torch.tensor([[1.25, 0.0, 0.0]]), torch.full((1, 3), math.log(0.02))


def walked(localizer: Odometry, rows: dict[str, FloatArray], arch: str) -> FloatArray:
    localizer._network = Walking(arch)
    localizer.reset(briefing(), np.random.default_rng(0))
    answers = [localizer.step(Observation(now_s, new)) for now_s, new in pieces(rows, 0.2)]
    assert answers[-1].sigma_m is not None
    assert answers[-1].sigma_m > answers[0].sigma_m
    return np.array([one.xy_m for one in answers])


def test_velocities_add_up() -> None:
    places_m = walked(odometry.Ronin(), still(6.0), RONIN)
    assert np.allclose(places_m[0], [3.0, 4.0])
    # windows end every fifth of a second: 1.25 m/s since the beginning but for the last samples
    assert places_m[-1] == pytest.approx([3.0 + 1.25 * 5.8, 4.0], abs=0.3)


def test_displacements_teach_the_filter_a_speed() -> None:
    places_m = walked(odometry.Tlio(TlioParams("none")), still(8.0), TLIO)
    assert np.diff(places_m[-10:], axis=0)[:, 0] / 0.2 == pytest.approx(np.full(9, 1.25), abs=0.05)
    assert np.abs(places_m[:, 1] - 4.0).max() < 0.05


def test_a_gap_ends_the_window_and_goes_on_at_the_last_speed() -> None:
    rows = {name: one[(one[:, 0] < 4.0) | (one[:, 0] > 4.9)] for name, one in still(8.0).items()}
    places_m = walked(odometry.Tlio(TlioParams("none")), rows, TLIO)
    assert np.isfinite(places_m).all()
    assert places_m[-1, 0] - places_m[0, 0] == pytest.approx(1.25 * 7.6, abs=1.5)


def test_the_filter_turns_with_its_first_attitude(rng: np.random.Generator) -> None:
    gyro, accel = rng.normal(0.0, 0.3, (400, 3)), UP + rng.normal(0.0, 1.0, (400, 3))
    angle_rad = 0.9
    tracks = []
    for yaw_rad in (0.0, angle_rad):
        first = rotation_matrix(np.array([math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2)]))
        tracker = CloningFilter(first, dataclasses.replace(CloningParams(), tilt_sigma_rad=0.05))
        tracker.clone()
        for begin in range(0, 400, 40):
            tracker.propagate(gyro[begin : begin + 40], accel[begin : begin + 40], 1 / RATE_HZ)
            tracker.clone()
            if len(tracker.clones_m) == 6:
                tracker.measure_move(first @ np.array([1.0, 0.2, 0.0]), 0.01 * np.eye(3))
                tracker.forget(1)
        tracks.append(tracker.place_m)
        assert np.linalg.eigvalsh(tracker.cov).min() > -1e-12
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    expected = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]) @ tracks[0]
    assert tracks[1] == pytest.approx(expected, abs=1e-9)


def test_a_clone_is_a_copy_and_an_exact_displacement_is_met() -> None:
    tracker = CloningFilter(np.eye(3), CloningParams(overlap=1.0))
    tracker.propagate(np.zeros((40, 3)), np.tile(UP, (40, 1)), 1 / RATE_HZ)
    tracker.clone()
    own = np.r_[0:3, 6:9]
    assert np.array_equal(tracker.cov[:6, :6], tracker.current_cov[np.ix_(own, own)])
    before = np.trace(tracker.current_cov)
    tracker.propagate(np.zeros((200, 3)), np.tile(UP, (200, 1)), 1 / RATE_HZ)
    tracker.clone()
    assert np.trace(tracker.current_cov) > before
    # By closed form: a displacement without noise leaves no error of the difference of the two clones, and an error
    # of the yaw that turns it.
    tracker.measure_move(np.array([0.5, 0.0, 0.0]), 1e-12 * np.eye(3))
    assert tracker.clones_m[1] - tracker.clones_m[0] == pytest.approx([0.5, 0.0, 0.0], abs=1e-5)
    assert tracker.cov.shape == (12 + CURRENT, 12 + CURRENT)
    sideways = tracker.cov[10, 10] + tracker.cov[4, 4] - 2 * tracker.cov[10, 4]
    assert sideways == pytest.approx((0.5 * CloningParams().yaw_sigma_rad) ** 2, rel=0.05)


def test_a_yaw_is_averaged_with_the_one_before() -> None:
    tracker = CloningFilter(np.eye(3), CloningParams(yaw_sigma_rad=0.3, compass_sigma_rad=0.3))
    tracker.measure_yaw(0.2)
    assert tracker.yaw_rad == pytest.approx(0.1, abs=1e-6)
    assert math.sqrt(tracker.current_cov[2, 2]) == pytest.approx(0.3 / math.sqrt(2), rel=1e-6)
