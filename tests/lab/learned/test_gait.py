"""The network whose lengths are step rates times bounded steps: what it can be deceived by, and what not."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the extra `learned`")
pytest.importorskip("safetensors", reason="needs the extra `learned`")

from pdrbench.errors import UnsuitableError  # noqa: E402
from pdrbench.localizer import Briefing, Observation  # noqa: E402
from pdrbench.recording import Recording  # noqa: E402
from pdrbench.trajectory import Start  # noqa: E402
from pdrbench_baselines.learned.constants import LAGS, MAX_LOG_FACTOR, MAX_STEPS_HZ  # noqa: E402
from pdrbench_baselines.learned.localizer import Learned  # noqa: E402
from pdrbench_baselines.learned.signals import turned  # noqa: E402
from pdrbench_lab.learned.batches import UNCHANGED, filtered, spectral_gain  # noqa: E402
from pdrbench_lab.learned.gait import GaitNetwork, step_law_m  # noqa: E402
from pdrbench_lab.learned.people import train_bearer  # noqa: E402
from pdrbench_lab.learned.walks import gentler, reckon, walk_figures, without_rotation  # noqa: E402
from pdrbench_lab.learned.weights import load_network, restore, store  # noqa: E402

STEP_HZ = 1.8


def walking(scale: float = 1.0, seconds: int = 3) -> torch.Tensor:
    """(1, T, 9, 200) windows, a second apart, of a phone that swings at the pace of a walk."""
    t_s = np.arange(200 + 50 * seconds) / 50.0
    swing = 3.0 * scale * np.sin(2 * np.pi * STEP_HZ * t_s)
    rows = np.zeros((9, len(t_s)))
    rows[0], rows[2], rows[3], rows[8] = 0.4 * np.roll(swing, 7), swing, 0.2 * swing, 1.0
    windows = np.stack([rows[:, 50 * k : 50 * k + 200] for k in range(seconds)])
    return torch.tensor(windows[None], dtype=torch.float32)


def network(seed: int = 0) -> GaitNetwork:
    torch.manual_seed(seed)
    return GaitNetwork(8).eval()


def test_the_size_of_the_shaking_hardly_matters() -> None:
    with torch.no_grad():
        lengths = [network().walks(walking(scale), torch.zeros(1, 3))[0].length_m for scale in (1.0, 0.5, 2.0)]
    np.testing.assert_allclose(lengths[1], lengths[0], rtol=0.02)
    np.testing.assert_allclose(lengths[2], lengths[0], rtol=0.02)


@pytest.mark.parametrize("seed", range(3))
def test_lengths_are_step_rates_times_steps_near_the_law(seed: int) -> None:
    with torch.no_grad():
        said, _ = network(seed).walks(10 * torch.randn(2, 4, 9, 200), torch.full((2, 4), 1.8))
    assert float(said.steps_hz.max()) <= MAX_STEPS_HZ
    factor = said.length_m / (said.steps_hz * step_law_m(said.steps_hz, torch.tensor(1.8)))
    assert float(factor.log().abs().max()) <= MAX_LOG_FACTOR + 1e-5
    np.testing.assert_allclose(said.move_m.norm(dim=1), said.length_m, rtol=1e-3)


def test_the_rhythm_of_steps_is_seen_at_any_size() -> None:
    from pdrbench_lab.learned.gait import rhythm

    net = network()
    for scale in (0.3, 1.0):
        _, shaking = net.split(walking(scale)[0, :1])
        vertical = rhythm(shaking)[0, : len(LAGS)]
        lag_s = LAGS[int(vertical[8:].argmax()) + 8] / 50.0
        assert lag_s == pytest.approx(1.0 / STEP_HZ, abs=0.03) or lag_s == pytest.approx(2.0 / STEP_HZ, abs=0.03)


def test_what_was_never_seen_is_doubted_and_left_to_the_step_law() -> None:
    net = network()
    with torch.no_grad():
        window, height_m = walking(), torch.zeros(1, 3)
        seen = net.seen(window.flatten(0, 1), height_m.flatten())[:, :96]
        net.usual_features.copy_(seen.mean(dim=0))
        net.whitening.copy_(torch.eye(96))
        net.near.fill_(float((seen - seen.mean(dim=0)).square().sum(dim=1).max()) * 1.1)
        known, _ = net.walks(window, height_m)
        other, _ = net.walks(30.0 * torch.randn(1, 3, 9, 200, generator=torch.Generator().manual_seed(1)), height_m)
    assert float(known.doubt.max()) == 0.0
    assert float(other.doubt.min()) > 0.5
    law = other.steps_hz * step_law_m(other.steps_hz, torch.tensor(1.7))
    assert float((other.length_m / law).log().abs().max()) < 0.5 * MAX_LOG_FACTOR
    covariance = other.cholesky_m @ other.cholesky_m.transpose(1, 2)
    assert float(torch.linalg.eigvalsh(covariance).min()) > (0.4 * 0.5) ** 2


def test_doubt_widens_a_covariance_as_said() -> None:
    from pdrbench_lab.learned.gait import widened

    factor = torch.tensor([[[0.3, 0.0], [-0.2, 0.4]]])
    wide = widened(factor, torch.tensor([2.5]), torch.tensor([0.3]))
    expected = 2.5 * factor @ factor.transpose(1, 2) + 0.09 * torch.eye(2)
    np.testing.assert_allclose(wide @ wide.transpose(1, 2), expected, atol=1e-6)


def test_shaking_is_multiplied_and_the_motion_of_the_body_is_not() -> None:
    how = dataclasses.replace(UNCHANGED, shake_share=1.1, shake_range=(0.4, 0.4), dull_range_hz=(4.0, 4.0))
    gain = spectral_gain(torch.Generator().manual_seed(0), 1, how, "cpu")
    t_s = torch.arange(200) / 50.0
    slow, fast = torch.sin(2 * torch.pi * 0.2 * t_s), torch.sin(2 * torch.pi * STEP_HZ * t_s)
    rows = (slow + fast)[None, None].expand(1, 6, -1)
    out = filtered(rows, gain)[0, 2, 50:150]
    np.testing.assert_allclose(out, (slow + 0.4 * fast)[50:150], atol=0.08)


def test_weights_come_back_as_they_were_stored(tmp_path) -> None:
    net = network()
    store(net, tmp_path / "model.safetensors")
    same = restore(tmp_path / "model.safetensors")
    assert isinstance(same, GaitNetwork)
    with torch.no_grad():
        one, other = (each.walks(walking(), torch.zeros(1, 3))[0].move_m for each in (net, same))
    np.testing.assert_array_equal(one, other)


@pytest.fixture(scope="module")
def walks() -> dict[str, Recording]:
    """A minute of a simulated person of each of two kinds, of those who are in no training."""
    return {kind: train_bearer(0, group="val", kinds=(kind,), walk_s=60.0)[0] for kind in ("usual", "cart")}


def length_m(weights: str, walk: Recording) -> float:
    return float(np.hypot(*reckon(load_network(weights), walk).move_m.T).sum())


def test_softer_shaking_does_not_shorten_a_walk(walks: dict[str, Recording]) -> None:
    walk, softer = walks["usual"], gentler(walks["usual"], 0.4)
    assert length_m("phone", softer) == pytest.approx(length_m("phone", walk), rel=0.1)
    assert length_m("phone_plain", softer) < 0.9 * length_m("phone_plain", walk)  # what it is for


def test_a_cart_is_not_claimed_to_stand(walks: dict[str, Recording]) -> None:
    figures = walk_figures(load_network("phone"), [walks["cart"]])
    assert figures["coverage_95_pct"] > 85.0
    assert figures["sigma_m"] > 0.4
    assert walk_figures(load_network("phone"), [walks["usual"]])["sigma_m"] < 0.4


def test_an_attitude_is_computed_where_the_phone_reports_none(walks: dict[str, Recording]) -> None:
    walk = walks["usual"]
    assert length_m("phone", without_rotation(walk)) == pytest.approx(length_m("phone", walk), rel=0.05)
    with pytest.raises(UnsuitableError, match="rotation"):
        length_m("phone_plain", without_rotation(walk))


def test_the_attitude_is_turned_to_the_heading_of_the_start(walks: dict[str, Recording]) -> None:
    walk, ends_m = without_rotation(walks["usual"]), []
    specs = {name: one.spec for name, one in walk.streams.items()}
    rows = {name: one.rows for name, one in walk.streams.items()}
    for heading_rad in (0.3, 1.3):
        start = Start(xy_m=np.zeros(2), level=0, heading_rad=heading_rad)
        localizer = Learned()
        localizer.reset(Briefing(None, specs, 60.0, start=start), np.random.default_rng(0))
        ends_m.append(localizer.step(Observation(60.0, rows)).xy_m)
    np.testing.assert_allclose(turned(ends_m[0], 1.0), ends_m[1], atol=1e-6)
    with pytest.raises(UnsuitableError, match="heading of the start"):
        localizer.reset(Briefing(None, specs, 60.0, start=Start(np.zeros(2), 0)), np.random.default_rng(0))
