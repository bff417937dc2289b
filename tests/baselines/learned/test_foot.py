"""Learned stride and heading of a unit on a foot: its attitude, its frame, its network."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError, RecordingError, UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.inertial import to_world
from pdrbench.inertial.foot_motion import FootMotion, walk
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.recording import Recording
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start

torch = pytest.importorskip("torch", reason="needs the extra `learned`")
pytest.importorskip("safetensors", reason="needs the extra `learned`")

from pdrbench_baselines.learned.attitude_sources import FOOT, PHONE, FootSource, foot_rows  # noqa: E402
from pdrbench_baselines.learned.localizer import Learned, load_network  # noqa: E402
from pdrbench_baselines.learned.model import Network  # noqa: E402
from pdrbench_baselines.learned.reckoning import Move, Reckoner  # noqa: E402
from pdrbench_baselines.learned.rest_velocity import RestVelocity  # noqa: E402
from pdrbench_baselines.learned.weights import restore, store  # noqa: E402
from pdrbench_lab.learned.data import gather, windows_of_sources  # noqa: E402
from pdrbench_lab.learned.feet import levelled, train_foot  # noqa: E402
from pdrbench_lab.learned.train import TrainParams, train  # noqa: E402

PERIOD_S = 0.1
Rows = dict[str, FloatArray]


def rows_of(motion: FootMotion) -> Rows:
    """Rows of a perfect unit."""
    return {name: np.column_stack([motion.t_s, getattr(motion, name)]) for name in ("accel", "gyro")}


def strides(count: int = 8, **changes: float) -> Rows:
    return rows_of(walk(count, turn_rad=0.1, **changes))


def briefing(heading_rad: float | None = 0.0, rate_hz: float = 200.0, **changes: Any) -> Briefing:
    """A unit on a foot that begins at (5, 2)."""
    specs = {name: dataclasses.replace(sensor_spec(name), rate_hz=rate_hz) for name in ("accel", "gyro")}
    start = Start(np.array([5.0, 2.0]), 0, heading_rad=heading_rad)
    return Briefing(None, **({"sensors": specs, "period_s": PERIOD_S, "start": start, "mounting": FOOT} | changes))


def pieces(rows: Rows, chunk_s: float = PERIOD_S) -> list[tuple[float, Rows]]:
    """Times of observations and the rows since the one before."""
    count = math.ceil(max(one[-1, 0] for one in rows.values()) / chunk_s - 1e-9)
    ends_s = chunk_s * np.arange(count + 1)
    return [
        (
            now_s,
            {
                name: one[(one[:, 0] > now_s - chunk_s + 1e-9) & (one[:, 0] <= now_s + 1e-9)]
                for name, one in rows.items()
            },
        )
        for now_s in ends_s.tolist()
    ]


def moves(rows: Rows, given: Briefing | None = None, chunk_s: float = PERIOD_S) -> list[Move]:
    torch.manual_seed(1)
    reckoner = Reckoner(Network("tcn", 8, FOOT).eval(), given or briefing())
    return [move for _, part in pieces(rows, chunk_s) for move in reckoner.update(part)]


def answers(rows: Rows, given: Briefing | None = None) -> list[Estimate]:
    localizer = Learned()
    localizer.reset(given or briefing(), np.random.default_rng(0))
    return [localizer.step(Observation(now_s, part)) for now_s, part in pieces(rows)]


def test_rows_are_level_however_the_unit_is_mounted() -> None:
    motion = walk(4)
    upside_down = np.array([1.0, -1.0, -1.0])
    rows = {name: one * [1.0, *upside_down] for name, one in rows_of(motion).items()}
    out = FootSource(200.0).update(rows)
    np.testing.assert_allclose(out["rotation"][0, 1:], [1.0, 0.0, 0.0, 0.0], atol=1e-6)
    turned = to_world(out["rotation"][:, 1:], out["accel"][-len(out["rotation"]) :, 1:])
    resting = motion.is_rest[-len(turned) :]
    np.testing.assert_allclose(turned[resting].mean(axis=0), [0.0, 0.0, 9.81], atol=0.1)


def test_the_frame_is_aligned_with_the_given_heading() -> None:
    rows = FootSource(200.0, heading_rad=1.0)
    for _, part in pieces(strides(1)):
        rows.update(part)
        if part["accel"][-1, 0] < 1.5:
            assert rows.turn_rad is None  # on the way
    for _, part in pieces(rows_of(walk(3))):
        later = {name: one + np.array([10.0, 0.0, 0.0, 0.0]) for name, one in part.items()}
        rows.update(later)
    assert rows.turn_rad == pytest.approx(1.0, abs=0.15)  # of a first stride that turns by 0.1


@pytest.mark.parametrize("chunk_s", [0.05, 1.0])
def test_chunks_do_not_matter(chunk_s: float) -> None:
    one, two = moves(strides()), moves(strides(), chunk_s=chunk_s)
    assert [move.end_s for move in one] == [move.end_s for move in two]
    # half of the last cell of a window is after the reported second, and may be missing
    np.testing.assert_allclose([move.move_m for move in one], [move.move_m for move in two], atol=2e-3)


def test_rotating_the_walk_rotates_the_estimate() -> None:
    angle_rad = 2.1
    one, two = (np.array([estimate.xy_m for estimate in answers(strides(), briefing(rad))]) for rad in (0.0, angle_rad))
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    about = (one - [5.0, 2.0]) @ np.array([[c, s], [-s, c]]) + [5.0, 2.0]
    assert np.hypot(*(one[-1] - one[0])) > 3.0
    np.testing.assert_allclose(two, about, atol=1e-4)


def test_without_a_heading_the_frame_is_that_of_the_unit() -> None:
    first = [move.move_m for move in moves(strides(), briefing(None))]
    turned = [move.move_m for move in moves(strides(), briefing(0.1))]
    angles = [
        math.atan2(*(b @ [[0, 1], [1, 0]])) - math.atan2(*(a @ [[0, 1], [1, 0]]))
        for a, b in zip(first, turned, strict=True)
    ]
    wrapped = (np.array(angles) + math.pi) % (2 * math.pi) - math.pi
    assert np.ptp(wrapped) < 1e-5


def test_a_walk_with_a_gap_stays_finite() -> None:
    rows = strides(10)
    for names in (("accel", "gyro"), ("gyro",)):
        torn = {
            name: one[(one[:, 0] < 4.2) | (one[:, 0] > 7.3)] if name in names else one for name, one in rows.items()
        }
        found = moves(torn)
        assert all(np.isfinite(move.move_m).all() and np.isfinite(move.covariance_m2).all() for move in found)
        assert any(move.is_guess for move in found) and not found[-1].is_guess
        assert found[-1].end_s == moves(rows)[-1].end_s


def test_samples_that_are_no_numbers_are_left_out() -> None:
    rows = strides()
    rows["accel"][300:304, 2] = np.nan
    assert np.isfinite([move.move_m for move in moves(rows)]).all()


def test_unsuitable_input_is_an_error() -> None:
    only_accel = {"accel": briefing().sensors["accel"]}
    with pytest.raises(UnsuitableError, match="'gyro'"):
        Learned().reset(briefing(sensors=only_accel), np.random.default_rng(0))
    with pytest.raises(UnsuitableError, match="80 Hz or more"):
        Learned().reset(briefing(rate_hz=50.0), np.random.default_rng(0))
    with pytest.raises(UnsuitableError, match="known start"):
        Learned().reset(briefing(start=None), np.random.default_rng(0))
    with pytest.raises(UnsuitableError, match="for a phone, not for a foot"):
        Reckoner(Network("tcn", 8, PHONE).eval(), briefing())


def test_other_units_and_times_that_go_back_are_refused() -> None:
    in_g = strides()
    in_g["accel"][:, 1:] /= 9.80665
    with pytest.raises(RecordingError, match=r"multiply by 9\.80665"):
        moves(in_g)
    in_degrees = strides()
    in_degrees["gyro"][:, 1:] *= 57.3
    with pytest.raises(RecordingError, match="multiply by pi/180"):
        moves(in_degrees)
    back = strides()
    back["gyro"][900:, 0] -= 1.0
    with pytest.raises(RecordingError, match="order of time"):
        Reckoner(Network("tcn", 8, FOOT).eval(), briefing()).update(back).__next__()
    with pytest.raises(RecordingError, match="comes at 50 Hz"):
        moves({name: one[::4] for name, one in strides().items()})  # briefed as 200 Hz


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
    assert load_network("learned_foot-v0").carried == FOOT


def test_a_simulated_walk_is_followed(recorded: Recording) -> None:
    way = recorded.reference
    first = int(np.argmax(np.hypot(*(way.xy_m - way.xy_m[0]).T) > 0.5))
    heading_rad = math.atan2(*(way.xy_m[first] - way.xy_m[0])[::-1])
    specs = {name: stream.spec for name, stream in recorded.streams.items()}
    given = briefing(sensors=specs, subject=recorded.subject, start=Start(way.xy_m[0], 0, heading_rad=heading_rad))
    found = answers({name: stream.rows for name, stream in recorded.streams.items()}, given)
    now_s = PERIOD_S * np.arange(len(found))
    true_m = np.column_stack([np.interp(now_s, way.t_s, one) for one in way.xy_m.T])
    error_m = np.hypot(*(np.array([one.xy_m for one in found]) - true_m).T)
    stays_m = np.hypot(*(way.xy_m[0] - true_m).T)
    assert error_m.mean() < 0.25 * stays_m.mean()
    assert all(one.sigma_m is not None and math.isfinite(one.sigma_m) for one in found)
