"""The network of phones: what it says of people whom it never saw, and where a phone reports no attitude."""

from __future__ import annotations

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="needs the extra `learned`")

from pdrbench.errors import UnsuitableError  # noqa: E402
from pdrbench.localizer import Briefing, Observation  # noqa: E402
from pdrbench.recording import Recording  # noqa: E402
from pdrbench.trajectory import Start  # noqa: E402
from pdrbench_baselines.learned.localizer import Learned  # noqa: E402
from pdrbench_baselines.learned.signals import turned  # noqa: E402
from pdrbench_lab.learned.cnn import CnnParams, train_cnn  # noqa: E402
from pdrbench_lab.learned.figures import draw, numbers  # noqa: E402
from pdrbench_lab.learned.people import train_bearer  # noqa: E402
from pdrbench_lab.learned.walks import reckon, walk_figures, without_rotation  # noqa: E402
from pdrbench_lab.learned.weights import load_network, restore  # noqa: E402


@pytest.fixture(scope="module")
def walks() -> dict[str, list[Recording]]:
    """A minute of four simulated people of each of two kinds, of those who are in no training."""
    kinds = ("usual", "cart")
    return {kind: [train_bearer(n, group="val", kinds=(kind,), walk_s=60.0) for n in range(4)] for kind in kinds}


def length_m(walk: Recording) -> float:
    return float(np.hypot(*reckon(load_network(), walk).move_m.T).sum())


def test_distances_and_ellipses_of_people_never_seen(walks: dict[str, list[Recording]]) -> None:
    usual, cart = (walk_figures(load_network(), walks[kind]) for kind in ("usual", "cart"))
    assert usual["distance_pct"] < 15.0
    assert min(usual["coverage_95_pct"], cart["coverage_95_pct"]) > 85.0


def test_an_attitude_is_computed_where_the_phone_reports_none(walks: dict[str, list[Recording]]) -> None:
    walk = walks["usual"][0]
    assert length_m(without_rotation(walk)) == pytest.approx(length_m(walk), rel=0.05)


def test_the_attitude_is_turned_to_the_heading_of_the_start(walks: dict[str, list[Recording]]) -> None:
    walk, ends_m = without_rotation(walks["usual"][0]), []
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


def test_training_is_the_same_again_leaves_walks_out_and_is_drawn(tmp_path) -> None:
    params = CnnParams({"bearers": 1.0}, people=3, val_people=1, steps=60, batch=32)
    first, again = (train_cnn(tmp_path / name, params, windows_in=tmp_path) for name in ("one", "two"))
    for one, other in zip(first.state_dict().values(), again.state_dict().values(), strict=True):
        assert torch.equal(one, other)
    assert torch.equal(restore(tmp_path / "one" / "model.safetensors").head.bias, first.head.bias)
    left_out = CnnParams({"bearers": 1.0}, people=3, val_people=1, steps=2, left_out=("train-usual",))
    fewer = train_cnn(tmp_path / "three", left_out, windows_in=tmp_path)
    assert not torch.equal(fewer.head.bias, first.head.bias)
    measured = numbers([tmp_path / "one", tmp_path / "three"], tmp_path)
    assert [row["batch"] for row in measured["curves"]["one"]] == [60]
    assert len(measured["people"]) == 1
    assert len(draw(measured, tmp_path)) == 3
