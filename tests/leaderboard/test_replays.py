"""Replays: the same walk in another frame is a walk of the same difficulty, and another one for whoever kept it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.building.connectivity import reachable_parts
from pdrbench.episode import Episode, Player, play
from pdrbench.errors import PdrbenchError, UnknownNameError
from pdrbench.geometry import FloatArray, wrap_rad
from pdrbench.inertial.phone_attitude import PhoneAttitude
from pdrbench.inertial.quaternions import about_vertical, inverse, phone_heading_rad, to_world
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.metrics import score
from pdrbench.radio import survey_of_readings
from pdrbench.recording import MagneticMap, RadioMap, Recording, SensorStream
from pdrbench.registry import make_localizer, make_task
from pdrbench.sensors import sensor_spec
from pdrbench.task import HELD_OUT, Task
from pdrbench.trajectory import Start, Trajectory
from pdrbench_leaderboard.replays import NOISE, Disguise, Motion, replayed

SECRET, OTHER = "c0ffee" * 8, "decade" * 8
MOTION = Motion(2.1, (37.0, -211.0))
BACK = Motion(-2.1, tuple((-Motion(-2.1).places(np.array([37.0, -211.0]))).tolist()))
WALKS = ("test-1", "test-2", "test-3")
FIELD_UT = np.array([0.0, 20.0, -45.0])
DISGUISE = Disguise("walk", "names")


def recorded(walk: str, office: Building) -> Recording:
    """A minute with a phone that lies flat and points where its owner goes, one metre each second."""
    rng = np.random.default_rng(int(walk[-1]))
    t_s = np.arange(3000) / 50.0
    heading_rad = 0.5 * rng.integers(-6, 7) + 0.02 * t_s
    attitude = about_vertical(heading_rad - np.pi / 2)  # a phone that points along y has the attitude 1
    second = np.arange(60.0)
    at_second = np.interp(second, t_s, heading_rad)
    turns = np.diff(at_second, prepend=at_second[0])
    steps = np.column_stack([np.cos(at_second), np.sin(at_second)]) * (second > 0)[:, None]
    begin = office.sample_uniform(rng, 1, level=0)[1][0]
    xy_m = begin + np.cumsum(steps, axis=0)
    field = to_world(inverse(attitude), np.broadcast_to(FIELD_UT, (len(t_s), 3)))
    scans = np.repeat(second[::4], 5)
    rows = {
        "accel": np.column_stack([t_s, *rng.normal([[0.0], [0.0], [9.81]], 0.05, (3, len(t_s)))]),
        "gyro": np.column_stack([t_s, np.zeros((len(t_s), 2)), np.full(len(t_s), 0.02)]),
        "mag": np.column_stack([t_s, field]),
        "rotation": np.column_stack([t_s, attitude]),
        "position": np.column_stack([second, xy_m]),
        "stride": np.column_stack([second, second > 0, np.zeros(60), turns])[1:],
        "wifi": np.column_stack(
            [scans, np.tile([11, 12, 13, 14, 15], 15), -rng.integers(40, 90, 75), np.full(75, 2412), np.zeros(75)]
        ),
    }
    reference = Trajectory(
        t_s=second, xy_m=xy_m, level=np.zeros(60, int), surveyed=second > 0, heading_rad=wrap_rad(at_second)
    )
    streams = {name: SensorStream(sensor_spec(name), table) for name, table in rows.items()}
    return Recording(walk, office, streams, reference, mounting="hand")


def survey(recording: Recording) -> RadioMap:
    """One scan at each of the first ten places."""
    readings = np.column_stack([np.tile([11, 12, 13], 10), -np.arange(40, 70), np.zeros(30)])
    return survey_of_readings(recording.reference.xy_m[:10], 0, np.zeros(10), np.full(10, 3), readings, surveyed=True)


def field_survey(recording: Recording) -> MagneticMap:
    """One sample at each of the first ten places, of a phone that turns by and by."""
    turn = np.linspace(0.0, 3.0, 10)
    field_ut = np.column_stack([30.0 * np.sin(turn), 30.0 * np.cos(turn), np.linspace(-40.0, -30.0, 10)])
    return MagneticMap(recording.reference.xy_m[:10], np.zeros(10, int), np.zeros(10, int), field_ut)


def start_of(recording: Recording) -> Start:
    reference = recording.reference
    return Start(reference.xy_m[0], 0, heading_rad=float(reference.heading_rad[0]))  # type: ignore[index]


@pytest.fixture(scope="module")
def walk(office: Building) -> Recording:
    return recorded("test-1", office)


@pytest.fixture
def task(office: Building) -> Task:
    names = ("accel", "gyro", "mag", "rotation", "position", "stride", "wifi")
    return Task(
        id="Recorded-v0",
        summary="",
        description="",
        sensors=tuple(sensor_spec(name) for name in names),
        capacity=dict.fromkeys(names, 128),
        period_s=0.5,
        start="pose",
        walks={"test": WALKS, "val": ("val-4",)},
        load=lambda walk: recorded(walk, office),
        tell_start=start_of,
        radio_map=survey,
        magnetic_map=field_survey,
        licence="MIT",
        source="recorded",
        units={"test-1": "anna", "test-2": "anna", "test-3": "bert", "val-4": "carl"},
        groups={"test-1": ("slow",)},
    )


def arrays_of(recording: Recording) -> Iterator[FloatArray]:
    reference = recording.reference
    assert reference.heading_rad is not None and recording.building is not None
    yield from (stream.rows for _, stream in sorted(recording.streams.items()))
    yield from (reference.t_s, reference.xy_m, reference.heading_rad, recording.building.edge_start_xy_m)


def moved(recording: Recording, motion: Motion) -> Recording:
    assert recording.building is not None
    return replace(
        recording,
        building=motion.building(recording.building),
        streams=motion.streams(recording),
        reference=motion.reference(recording.reference),
    )


@pytest.mark.parametrize("has_attitude", [True, False])
def test_the_inverse_motion_gives_the_walk_back(walk: Recording, has_attitude: bool) -> None:
    if not has_attitude:
        walk = replace(walk, streams={name: one for name, one in walk.streams.items() if name != "rotation"})
    for was, now in zip(arrays_of(walk), arrays_of(moved(moved(walk, MOTION), BACK)), strict=True):
        np.testing.assert_allclose(now, was, rtol=0, atol=1e-9)


def test_nothing_changes_that_is_measured_in_the_building(walk: Recording, rng: np.random.Generator) -> None:
    office, there = walk.building, MOTION.building(walk.building)  # type: ignore[arg-type]
    assert office is not None
    assert (there.edge_neighbour == office.edge_neighbour).all() and (there.edge_twin == office.edge_twin).all()
    assert (reachable_parts(there) == reachable_parts(office)).all()
    assert there.area_m2 == pytest.approx(office.area_m2, abs=1e-8)
    polygon, xy_m = office.sample_uniform(rng, 500)
    level = office.level(polygon)
    assert (there.locate(MOTION.places(xy_m), level) == office.locate(xy_m, level)).all()
    outside_m = rng.uniform(-5, 60, (500, 2))
    assert (there.contains(MOTION.places(outside_m), 0) == office.contains(outside_m, 0)).all()
    ends_m = xy_m + rng.normal(0, 3, xy_m.shape)
    for was, now in zip(
        office.move(polygon, xy_m, ends_m), there.move(polygon, MOTION.places(xy_m), MOTION.places(ends_m)), strict=True
    ):
        assert (was == now).all()
    steps_m = [np.hypot(*np.diff(one, axis=0).T) for one in (xy_m, MOTION.places(xy_m))]
    np.testing.assert_allclose(steps_m[1], steps_m[0], atol=1e-9)


def test_whoever_takes_y_for_north_is_still_right(walk: Recording) -> None:
    there = moved(walk, MOTION)
    before, after = (one.streams["rotation"].rows[:, 1:] for one in (walk, there))
    np.testing.assert_allclose(wrap_rad(phone_heading_rad(after) - phone_heading_rad(before) - 2.1), 0, atol=1e-12)
    np.testing.assert_allclose(
        to_world(after, there.streams["mag"].rows[:, 1:]), np.broadcast_to(FIELD_UT, (3000, 3)), atol=1e-9
    )
    for name in ("accel", "gyro", "wifi", "stride"):
        assert there.streams[name].rows.tobytes() == walk.streams[name].rows.tobytes()


def test_the_compass_of_a_phone_without_attitude_turns_with_the_map(walk: Recording) -> None:
    """The filter of the toolbox takes y for north, and is off by as much as before."""
    walk = replace(walk, streams={name: one for name, one in walk.streams.items() if name != "rotation"})
    errors = []
    for one in (walk, moved(walk, MOTION)):
        rows = {name: stream.rows for name, stream in one.streams.items()}
        found = PhoneAttitude().update(rows["accel"], rows["gyro"], rows["mag"])
        assert one.reference.heading_rad is not None
        at_end = phone_heading_rad(found[-50, 1:]) - one.reference.heading_rad[-1]
        errors.append(float(wrap_rad(at_end)))
    assert errors[0] == pytest.approx(0.0, abs=0.1)
    assert errors[1] == pytest.approx(errors[0], abs=0.01)


def test_noise_is_small_and_keeps_what_a_sensor_cannot_read() -> None:
    rng = np.random.default_rng(5)
    signal = np.clip(rng.normal(0.0, 6.0, 4000), -9.2, 9.2)  # a gyroscope that ends at 9.2 rad/s
    noisy = DISGUISE.noisy(signal, 2e-4, np.random.default_rng(6))
    assert noisy.max() == 9.2 and noisy.min() == -9.2
    inside = np.abs(signal) < 9.19
    assert np.std(noisy[inside] - signal[inside]) == pytest.approx(2e-4, rel=0.1)  # 3 % is a standard error of 1 sigma
    held = np.repeat(rng.normal(size=50), 4)
    assert (np.diff(DISGUISE.noisy(held, 2e-4, rng).reshape(-1, 4)) == 0).all()
    rssi = -rng.integers(40, 90, 4000).astype(float)
    again = DISGUISE.noisy(rssi, NOISE["rssi_dbm"], rng)
    assert (again == np.rint(again)).all()
    assert 0.2 < (again != rssi).mean() < 0.4 and np.abs(again - rssi).max() <= 3  # 2 Q(1) = 0.32


def test_clocks_keep_the_order_and_what_was_at_once(walk: Recording) -> None:
    streams = {name: DISGUISE.stream(one) for name, one in walk.streams.items()}
    for name, one in walk.streams.items():
        slow_s = one.t_s - streams[name].t_s
        assert (slow_s >= 0).all() and (slow_s <= 2e-5 * 60).all()
    assert (streams["accel"].t_s == streams["gyro"].t_s).all()
    assert (np.diff(streams["wifi"].t_s.reshape(-1, 5)) == 0).all()
    assert not (streams["accel"].t_s[1:] == walk.streams["accel"].t_s[1:]).any()


def test_identifiers_are_permuted() -> None:
    numbers = np.concatenate([np.arange(5000.0), 2.0**48 - 1 - np.arange(5000.0)])
    others = DISGUISE.identifiers(numbers)
    assert len(np.unique(others)) == len(numbers)
    assert others.min() >= 0 and others.max() < 2**48
    assert not np.isin(others, numbers).any()
    assert (DISGUISE.identifiers(numbers[::-1]) == others[::-1]).all()
    assert not (Disguise("another", "names").identifiers(numbers) == others).any()


def test_a_task_of_recordings_has_replays(task: Task) -> None:
    held_out = replayed(task, SECRET)
    ids = held_out.split(HELD_OUT)
    assert len(ids) == 6 and list(ids) == sorted(ids)
    assert ids == replayed(task, SECRET).split(HELD_OUT)
    assert not set(ids) & set(replayed(task, OTHER).split(HELD_OUT))
    units = [held_out.units[walk] for walk in ids]
    assert len(set(units)) == 2 and not set(units) & {"anna", "bert"}
    assert [held_out.groups[walk] for walk in ids if walk in held_out.groups] == [("slow",)] * 2
    public = held_out.load("test-2")
    assert public.streams["accel"].rows.tobytes() == task.load("test-2").streams["accel"].rows.tobytes()
    assert (held_out.tell_start(public).xy_m == public.reference.xy_m[0]).all()
    motions = set()
    for walk in ids:
        recording, again = held_out.load(walk), replayed(task, SECRET).load(walk)
        assert [one.tobytes() for one in arrays_of(recording)] == [one.tobytes() for one in arrays_of(again)]
        briefing = held_out.brief(recording)
        assert briefing.start is not None and briefing.radio_map is not None and briefing.building is not None
        np.testing.assert_allclose(briefing.start.xy_m, recording.reference.xy_m[0], atol=1e-9)
        np.testing.assert_allclose(briefing.radio_map.xy_m, recording.reference.xy_m[:10], atol=1e-9)
        assert briefing.magnetic_map is not None
        np.testing.assert_array_equal(briefing.magnetic_map.xy_m, briefing.radio_map.xy_m)
        off_ut = briefing.magnetic_map.field_ut - field_survey(recording).field_ut  # as of the phone: no turn is in it
        assert 0.0 < np.abs(off_ut).max() < 6 * NOISE["x_ut"]
        scanned = recording.streams["wifi"].column("access_point")
        assert set(briefing.radio_map.access_point.tolist()) == set(scanned[:3].tolist())
        assert recording.id == walk and briefing.building.name != "office"
        public_building = task.load("test-1").building
        assert public_building is not None
        assert not {p.id for p in briefing.building.polygons} & {p.id for p in public_building.polygons}
        motions.add(tuple(briefing.start.xy_m.tolist()))
    assert len(motions) == 6  # three walks are few: each is replayed twice, in two frames
    assert len({held_out.load(walk).building.name for walk in ids}) == 1  # type: ignore[union-attr]


def test_what_cannot_be_replayed_is_refused(task: Task) -> None:
    with pytest.raises(UnknownNameError, match="split of Recorded-v0"):
        replayed(replace(task, walks={"train": WALKS}), SECRET)
    spec = replace(sensor_spec("position"), name="gnss", columns=("t_s", "lat_deg", "lon_deg"))
    strange = replace(task, sensors=(spec,), capacity={"gnss": 8})
    with pytest.raises(PdrbenchError, match="'lat_deg' of the sensor 'gnss' turns with the map"):
        replayed(strange, SECRET)


class Memoriser:
    """Has every public walk, truth included, and answers the one whose beginning is nearest to that of the given one.

    Args:
        task: Whose test walks it has.
        key: What it knows a walk by: "digest" of the first observation, "start" or the first "scan".
    """

    def __init__(self, task: Task, key: str) -> None:
        self._key_of: Callable[[Briefing, Observation], FloatArray] = getattr(self, f"_{key}")
        episodes = [Episode(task.load(walk), task) for walk in task.split("test")]
        self._kept = [(self._key_of(one.briefing, one.observe()), one.recording.reference) for one in episodes]

    def _start(self, briefing: Briefing, first: Observation) -> FloatArray:
        assert briefing.start is not None
        return briefing.start.xy_m

    def _scan(self, briefing: Briefing, first: Observation) -> FloatArray:
        return first["wifi"][:, 1:3].ravel()  # who was heard, and how loud

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        self._briefing, self._found = briefing, Trajectory([], np.zeros((0, 2)), [], [])  # type: ignore[arg-type]

    def step(self, observation: Observation) -> Estimate:
        if not len(self._found):
            key = self._key_of(self._briefing, observation)
            self._found = min(self._kept, key=lambda kept: float(np.abs(kept[0] - key).sum()))[1]
        row = np.searchsorted(self._found.t_s, observation.now_s + 1e-9, side="right") - 1
        return Estimate(self._found.xy_m[row], 0)


def mean_errors_m(localizer: Player, task: Task, walks: tuple[str, ...]) -> list[float]:
    errors = []
    for walk in walks:
        recording = task.load(walk)
        result = play(localizer, Episode(recording, task), np.random.default_rng(0), name="x", seed=0)
        assert result.status == "complete", f"{result.status}: {result.failure}"
        scores = score(result.estimates, recording.reference, recording.building, task.fallback(recording))
        errors.append(scores["mean_m"])
    return sorted(errors)


@pytest.mark.parametrize("key", ["start", "scan"])
def test_a_memoriser_collapses(task: Task, key: str) -> None:
    held_out = replayed(task, SECRET)
    memoriser = Memoriser(task, key)
    assert max(mean_errors_m(memoriser, task, WALKS)) < 1e-9
    assert min(mean_errors_m(memoriser, held_out, held_out.split(HELD_OUT))) > 30.0


def test_an_honest_localizer_scores_alike(task: Task) -> None:
    """Strides of a localizer that errs by 5 %, with noise of 3 mm and 1 mrad each: after 60 m it is off by 3 mm
    sqrt(60) = 0.02 m along and 60 m * 1 mrad * sqrt(60 / 3) = 0.27 m across, twice that at one walk in twenty."""

    def load(walk: str) -> Recording:
        recording = recorded_walk(walk)
        rows = recording.streams["stride"].rows * [1.0, 1.05, 1.0, 1.0]
        return replace(recording, streams={**recording.streams, "stride": SensorStream(sensor_spec("stride"), rows)})

    recorded_walk, task = task.load, replace(task, load=load)
    held_out = replayed(task, SECRET)
    honest = make_localizer("dead_reckoning")
    public, replays = (mean_errors_m(honest, *given) for given in ((task, WALKS), (held_out, held_out.split(HELD_OUT))))
    assert public[0] > 1.0
    np.testing.assert_allclose(sorted(replays), sorted([*public, *public]), atol=0.5)


@pytest.mark.data
@pytest.mark.parametrize("env", ["FootVicon-v1", "MallPhone-v2", "IpinPhone-v1"])
def test_recorded_environments_have_replays(env: str, data_root: Path) -> None:
    task = make_task(env, SECRET)
    if not (data_root / str(task.dataset)).is_dir():
        pytest.skip(f"{task.dataset} not found")
    walk = task.split(HELD_OUT)[0]
    recording = task.load(walk)
    start = task.brief(recording).start
    assert len(task.split(HELD_OUT)) == len(task.split("test"))
    assert start is not None and np.hypot(*(start.xy_m - recording.reference.xy_m[0])) < 1e-9
    assert Episode(recording, task).observe().now_s == 0.0
