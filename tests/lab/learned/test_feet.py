"""Simulated feet as windows for training, and what the networks make of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench.localizer import Briefing, Observation
from pdrbench.recording import Recording
from pdrbench.trajectory import Start
from pdrbench_sim.foot.known_walk import walk

torch = pytest.importorskip("torch", reason="needs the extra `learned`")

from pdrbench_baselines.learned.attitude_sources import FOOT, PHONE  # noqa: E402
from pdrbench_baselines.learned.localizer import Learned  # noqa: E402
from pdrbench_lab.learned.data import gather, windows_of_sources  # noqa: E402
from pdrbench_lab.learned.feet import foot_rows, levelled, train_foot  # noqa: E402
from pdrbench_lab.learned.model import Network  # noqa: E402
from pdrbench_lab.learned.rest_velocity import RestVelocity  # noqa: E402
from pdrbench_lab.learned.train import TrainParams, train  # noqa: E402
from pdrbench_lab.learned.weights import load_network, restore, store  # noqa: E402

PERIOD_S = 0.1


def test_velocity_is_nothing_where_the_foot_rests() -> None:
    motion = walk(3, still_s=1.5, rate_hz=50.0)
    window = torch.zeros(1, 9, 200)
    world = np.einsum("nij,nj->ni", motion.attitude, motion.accel) - [0.0, 0.0, 9.81]
    first = len(motion) - 200
    window[0, 0:3] = torch.tensor(world[first:].T + np.array([[0.1], [0.0], [0.0]]))  # as of a tilt of half a degree
    window[0, 3:6] = torch.tensor(np.einsum("nij,nj->ni", motion.attitude, motion.gyro)[first:].T)
    velocity_mps = RestVelocity()(window)[0].numpy().T
    moved_m = motion.position_m[-1, :2] - motion.position_m[first + 20, :2]
    np.testing.assert_allclose(velocity_mps[20:].sum(axis=0) / 50.0, moved_m, atol=0.03)
    assert moved_m[0] > 2.0
    assert np.abs(velocity_mps[motion.is_rest[first:]]).mean() < 0.03


@pytest.fixture(scope="module")
def recorded() -> Recording:
    return train_foot(3, group="val", walk_s=40.0)


def test_people_are_the_same_again_and_those_of_val_are_others(recorded: Recording) -> None:
    again, other = train_foot(3, group="val", walk_s=40.0), train_foot(3, walk_s=5.0)
    np.testing.assert_array_equal(again.streams["accel"].rows, recorded.streams["accel"].rows)
    np.testing.assert_array_equal(again.reference.xy_m, recorded.reference.xy_m)
    assert other.building is not None and recorded.building is not None
    outlines = [one.building.polygons[0].outline_xy_m.tobytes() for one in (recorded, other)]
    assert outlines[0] != outlines[1]


def test_places_are_given_in_the_frame_of_the_filter(recorded: Recording) -> None:
    states, _ = foot_rows(recorded)
    way = levelled(recorded).reference
    own_m = np.column_stack([np.interp(way.t_s, states.t_s[50:], one) for one in states.position_m[50:, :2].T])
    away_m = (way.xy_m - way.xy_m[-1]) - (own_m - own_m[-1])
    length_m = np.hypot(*np.diff(way.xy_m, axis=0).T).sum()
    assert length_m > 15.0
    assert np.hypot(*away_m.T).max() < 0.5 + 0.03 * length_m  # a foot is half a stride from the body at most


def test_the_source_gives_windows() -> None:
    windows, rows = gather(windows_of_sources(("feet",), 1, "val"))
    assert [row["source"] for row in rows] == ["feet"]
    assert windows.known.all() and len(windows) > 140
    assert 0.3 < np.hypot(*windows.move_m.T).mean() < 1.5


def test_feet_and_phones_are_not_mixed(tmp_path) -> None:
    for carried, sources in ((FOOT, ("people",)), (PHONE, ("feet",)), (FOOT, ("feet", "own"))):
        with pytest.raises(PdrbenchError, match="alone is of feet"):
            train(tmp_path, TrainParams(carried=carried, sources=sources))


def test_weights_state_their_mounting(tmp_path) -> None:
    store(Network("tcn", 8, FOOT), tmp_path / "model.safetensors")
    assert restore(tmp_path / "model.safetensors").carried == FOOT
    assert load_network("foot").carried == FOOT


def test_a_simulated_walk_is_followed(recorded: Recording) -> None:
    way = recorded.reference
    first = int(np.argmax(np.hypot(*(way.xy_m - way.xy_m[0]).T) > 0.5))
    heading_rad = math.atan2(*(way.xy_m[first] - way.xy_m[0])[::-1])
    specs = {name: stream.spec for name, stream in recorded.streams.items()}
    start = Start(way.xy_m[0], 0, heading_rad=heading_rad)
    localizer = Learned()
    localizer.reset(
        Briefing(None, specs, PERIOD_S, start, subject=recorded.subject, mounting=FOOT), np.random.default_rng(0)
    )
    now_s = PERIOD_S * np.arange(round(40.0 / PERIOD_S))
    found = []
    for at_s in now_s.tolist():
        part = {
            name: one.rows[(one.rows[:, 0] > at_s - PERIOD_S + 1e-9) & (one.rows[:, 0] <= at_s + 1e-9)]
            for name, one in recorded.streams.items()
        }
        found.append(localizer.step(Observation(at_s, part)))
    true_m = np.column_stack([np.interp(now_s, way.t_s, one) for one in way.xy_m.T])
    error_m = np.hypot(*(np.array([one.xy_m for one in found]) - true_m).T)
    stays_m = np.hypot(*(way.xy_m[0] - true_m).T)
    assert error_m.mean() < 0.25 * stays_m.mean()
    assert all(one.sigma_m is not None and math.isfinite(one.sigma_m) for one in found)
