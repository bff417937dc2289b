"""The recurrent zero-velocity detector: sizes, streams, weights, the filter around it, labels of motion capture."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import DatasetError, UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.inertial import LITERAL
from pdrbench.localizer import Briefing
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start, Trajectory

torch = pytest.importorskip("torch", reason="needs the extra `learned`")
pytest.importorskip("safetensors", reason="needs the extra `learned`")

from pdrbench_lab.foot_ins.experiments import FootWalk  # noqa: E402
from pdrbench_lab.learned.weights import load_network  # noqa: E402
from pdrbench_lab.learned.zero_velocity import FootInsLstm, LstmFootFilter, LstmRestDetector  # noqa: E402
from pdrbench_lab.learned.zero_velocity_network import ZeroVelocityNetwork, packaged, restore, store  # noqa: E402
from pdrbench_lab.learned.zero_velocity_train import truth  # noqa: E402


def network() -> ZeroVelocityNetwork:
    """A network with random weights, the same in every run."""
    torch.manual_seed(1)
    return ZeroVelocityNetwork().eval()


class Quiet(ZeroVelocityNetwork):
    """Says that the foot rests where it does not turn."""

    def probabilities(self, rows: FloatArray, memory: object = None) -> tuple[FloatArray, object]:
        return (np.abs(rows[:, 3:]).max(axis=1) < 0.1).astype(np.float64), memory


def samples(rng: np.random.Generator, count: int = 500, rate_hz: float = 200.0) -> tuple[FloatArray, ...]:
    t_s = np.arange(count) / rate_hz
    return t_s, np.array([0.0, 0.0, 9.81]) + rng.normal(0, 1, (count, 3)), rng.normal(0, 1, (count, 3))


def test_the_network_has_the_published_layers() -> None:
    lstm = network().lstm
    assert (lstm.num_layers, lstm.hidden_size, lstm.input_size) == (6, 80, 6)
    # four gates of 80 units: inputs, memory, two biases; the first layer has six inputs, five have eighty
    assert sum(one.numel() for one in lstm.parameters()) == 320 * (6 + 80 + 2) + 5 * 320 * (80 + 80 + 2)


@pytest.mark.parametrize("rate_hz", [100.0, 200.0, 250.0])
def test_a_stream_in_pieces_gives_what_the_whole_gives(rate_hz: float, rng: np.random.Generator) -> None:
    t_s, accel, gyro = samples(rng, rate_hz=rate_hz)
    whole = LstmRestDetector(network()).probabilities(t_s, accel, gyro)
    detector, found = LstmRestDetector(network()), []
    for begin, end in ((0, 1), (1, 7), (7, 200), (200, 200), (200, 500)):
        found.append(detector.probabilities(t_s[begin:end], accel[begin:end], gyro[begin:end]))
    assert np.ptp(whole) > 1e-4
    assert np.concatenate(found) == pytest.approx(whole, abs=1e-6)


def test_a_sample_has_the_answer_of_the_last_even_one(rng: np.random.Generator) -> None:
    t_s, accel, gyro = samples(rng, 200, 100.0)
    gyro[:100] = 0.0
    gyro[100:] = 1.0
    rest = LstmRestDetector(Quiet()).update(t_s, accel, gyro)
    assert rest.is_rest[:100].all()
    assert not rest.is_rest[100:].any()
    assert np.isinf(rest.rate_sigma_radps).all()
    assert (rest.sigma_mps[:100] == LITERAL.detector.sigma_mps).all()


def test_zero_velocities_hold_the_filter_of_a_foot_that_rests(rng: np.random.Generator) -> None:
    t_s = np.arange(2000) / 200.0
    accel = np.tile([0.0, 0.0, 9.81], (2000, 1)) + rng.normal(0, 0.05, (2000, 3))
    gyro = rng.normal(0, 0.01, (2000, 3))
    filtered = LstmFootFilter(200.0, LITERAL, LstmRestDetector(Quiet())).update(t_s, accel, gyro)
    assert filtered.rest.is_rest.all()
    assert np.linalg.norm(filtered.position_m[-1]) < 0.05


def test_it_needs_a_unit_on_the_foot(tmp_path: Path) -> None:
    store(network(), tmp_path / "own.safetensors")
    localizer = FootInsLstm(weights=str(tmp_path / "own.safetensors"))
    specs = {name: dataclasses.replace(sensor_spec(name), rate_hz=200.0) for name in ("accel", "gyro")}
    start = Start(xy_m=np.zeros(2), level=0)
    with pytest.raises(UnsuitableError, match="foot"):
        localizer.reset(Briefing(None, specs, 0.05, start=start, mounting="hand"), np.random.default_rng(0))
    localizer.reset(Briefing(None, specs, 0.05, start=start, mounting="foot"), np.random.default_rng(0))


def test_weights_are_known_by_their_hash(tmp_path: Path) -> None:
    path = tmp_path / "own.safetensors"
    sha256 = store(network(), path)
    rows = torch.zeros(1, 50, 6)
    with torch.inference_mode():
        assert torch.allclose(restore(path, sha256)(rows)[0], network()(rows)[0], atol=1e-3)
    with pytest.raises(DatasetError, match="sha256"):
        restore(path, "0" * 64)
    path.write_bytes(b"nothing")
    with pytest.raises(DatasetError, match="not the weights"):
        restore(path)


def test_where_pytorch_fails_the_weights_are_not_blamed(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(*_: object, **__: object) -> None:
        raise RuntimeError("Failed to initialize cpuinfo")

    monkeypatch.setattr("torch.nn.Module.load_state_dict", fails)
    for load in (lambda: packaged("foot_ins_lstm"), load_network):
        with pytest.raises(RuntimeError, match="cpuinfo"):
            load()


def test_a_foot_rests_where_motion_capture_sees_no_speed() -> None:
    t_s = np.arange(600) / 200.0
    x_m = np.clip(t_s - 1.0, 0.0, 1.0)  # stands for a second, goes at 1 m/s for another, stands
    place = Trajectory(
        t_s=t_s,
        xy_m=np.column_stack([x_m, 0 * t_s]),
        level=np.zeros(600, int),
        surveyed=np.abs(t_s - 2.5) > 0.1,
        z_m=0 * t_s,
    )
    rests, known = truth(FootWalk(Path("walk"), t_s, np.zeros((600, 3)), np.zeros((600, 3)), place))
    assert rests[:190].all()
    assert not rests[210:390].any()
    assert rests[410:].all()
    assert not known[np.abs(t_s - 2.5) <= 0.1].any()
    assert known[:400].all()
