"""A trial gives the estimates that an episode gives, whether served online or offline."""

from __future__ import annotations

import http.client
import json
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pdrbench.episode import Episode, play
from pdrbench.io.geo import GeoFrame
from pdrbench.registry import make_localizer, make_task
from pdrbench.sensors import sensor_spec
from pdrbench_evaal.client import EvaalError, TrialClient, play_trial
from pdrbench_evaal.places import PlaceFormat
from pdrbench_evaal.records import RecordReader, plain_number, to_lines
from pdrbench_evaal.server import MAX_BODY_BYTES, store_result
from pdrbench_evaal.trial import Rules

DEGREES = PlaceFormat(("lon", "lat", "level"), GeoFrame(49.46, 11.11))


def played_here(localizer, task, walk):
    return play(make_localizer(localizer), Episode(task.load(walk), task), np.random.default_rng(0), name="x", seed=0)


def played_there(server, localizer, task, walk, **settings):
    client = TrialClient(server.url, walk)
    briefing = task.brief(task.load(walk))
    rng = np.random.default_rng(0)
    return play_trial(client, make_localizer(localizer), briefing, rng, capacity=task.capacity, **settings)


@pytest.mark.parametrize("is_offline", [False, True])
@pytest.mark.parametrize("localizer", ["stay", "dead_reckoning", "wifi_knn"])
def test_a_served_phone_walk_gives_the_estimates_of_an_episode(localizer, is_offline, phone_task, serve) -> None:
    expected = played_here(localizer, phone_task, "walk-a").estimates
    with serve(phone_task, rules=Rules(is_offline=is_offline)) as (server, ended):
        played = played_there(server, localizer, phone_task, "walk-a")
    estimates = ended["walk-a"].estimates
    assert played.num_estimates == len(estimates) == len(expected)
    assert played.skipped == {} and ended["walk-a"].division == ("offline" if is_offline else "online")
    assert np.abs(estimates.xy_m - expected.xy_m).max() < 1e-9  # w of a quaternion comes from x, y and z
    assert np.array_equal(estimates.level, expected.level)
    assert np.abs(estimates.t_s - expected.t_s)[1:].max() < 2e-6
    assert localizer == "stay" or np.ptp(expected.xy_m, axis=0).max() > 1.0


def test_strides_and_degrees_go_through_as_well(stride_task, serve) -> None:
    expected = played_here("dead_reckoning", stride_task, "walk-a").estimates
    with serve(stride_task, places=DEGREES) as (server, ended):
        played = played_there(server, "dead_reckoning", stride_task, "walk-a", places=DEGREES)
    estimates = ended["walk-a"].estimates
    assert played.state.place.startswith("11.11") and len(estimates) > 40
    same = np.searchsorted(expected.t_s, estimates.t_s + 1e-3) - 1  # none is asked for before the first stride
    assert np.abs(estimates.xy_m - expected.xy_m[same]).max() < 1e-6


def test_a_served_environment_gives_the_scores_of_evaluate(serve) -> None:
    from pdrbench.evaluation import evaluate, score

    localizer, env = "dead_reckoning", "CampusStride-v1"
    task = make_task(env)
    walk = task.split("train")[0]
    with serve(task, walks=1) as (server, ended):
        played_there(server, localizer, task, walk)
    expected = score(evaluate(localizer, env, split="train", walks=1, isolation="none").results[0])
    found = score(ended[walk])
    for name in ("mean_m", "p75_level_penalised_m", "level_hit_rate"):
        assert found[name] == pytest.approx(expected[name], abs=2e-4)  # answers are stored to 0.1 mm


def test_a_smoother_sends_its_revised_past_where_a_trial_is_offline(stride_task, serve) -> None:
    class Smoother:
        def reset(self, briefing, rng): ...

        def step(self, observation):
            return None

        def revise(self):
            return [[0.0, 1.0, 2.0, 1], [3.0, 4.0, 5.0, 1]]

    with serve(stride_task, rules=Rules(is_offline=True)) as (server, ended):
        client = TrialClient(server.url, "walk-a")
        play_trial(client, Smoother(), stride_task.brief(stride_task.load("walk-a")), np.random.default_rng(0))
    assert ended["walk-a"].estimates.xy_m.tolist() == [[1.0, 2.0], [4.0, 5.0]]


def test_lines_are_those_of_getsensordata(phone_task) -> None:
    lines, t_s = to_lines(phone_task.load("walk-a").streams)
    assert (np.diff(t_s) >= 0).all() and len(lines) == len(t_s)
    first = {line.split(";")[0]: line for line in reversed(lines)}
    assert first["WIFI"] == f"WIFI;0.4;0.36;;00:00:00:00:00:05;2412;{first['WIFI'].split(';')[-1]}"
    assert first["ACCE"].startswith("ACCE;0.013;0.013;0.0;") and first["ACCE"].endswith(";3")
    assert first["BLE4"].split(";")[2:4][0] == "iBeacon" and first["PRES"].count(";") == 4


def test_the_reader_of_getsensordata_reads_what_is_served(phone_task, tmp_path) -> None:
    from pdrbench_formats.recordings import getsensordata

    streams = phone_task.load("walk-a").streams
    (tmp_path / "log.txt").write_text("\n".join(to_lines(streams)[0]))
    log = getsensordata.read(tmp_path / "log.txt", strict=False)
    assert set(log.rows) == set(streams)
    for name in ("accel", "gyro", "mag", "baro", "rotation"):
        rows = streams[name].rows
        if name == "rotation":
            rows = np.column_stack([rows[:, 0], rows[:, 1:] * np.sign(rows[:, 1:2])])
        assert log.rows[name] == pytest.approx(rows - [0.013, *[0.0] * (rows.shape[1] - 1)], abs=1e-6), name


def test_angles_of_ahrs_are_those_of_the_app() -> None:
    """A record of an SM-A520F: quaternion and the angles that the app computed from it."""
    given = "AHRS;0.0547;65093.5471;49.975651;11.576796;-16.530445;0.42904782;0.03004867;-0.08747417;3"
    reader = RecordReader({"rotation": sensor_spec("rotation")}, {}, plain_number)
    reader.add([given])
    from pdrbench.recording import SensorStream

    rows = reader.take(1.0)["rotation"]
    (line,), _ = to_lines({"rotation": SensorStream(sensor_spec("rotation"), rows)})
    assert [float(field) for field in line.split(";")[3:9]] == pytest.approx(
        [float(field) for field in given.split(";")[3:9]], abs=2e-4
    )


def test_a_foreign_server_has_two_clocks_and_lines_that_cannot_be_read() -> None:
    """The time of a sensor, moved by the least delay so far; never later than the arrival."""
    sensors = {name: sensor_spec(name) for name in ("accel", "wifi")}
    reader = RecordReader(sensors, {"accel": 2}, lambda kind, address: 7.0)
    lines = [
        "% a comment",
        "ACCE;0.110;500.100;1;2;3;0",
        "ACCE;0.111;500.110;1;2;3;0",
        "ACCE;0.125;500.120;1;2;3;0",
        "WIFI;0.200;499.700;a;name;02:00:00:00:00:01;2437;-60;",
        "GYRO;0.2;500.2;0;0;0;3",
        "ACCE;0.3;500.3;1;2;x;0",
        "ACCE",
        "SOUN;0.3;1;2",
        "ACCE;0.31;500.31;1;2;1e9;0",
        "",
    ]
    reader.add(lines)
    assert reader.first_s == 0.110
    first = reader.take(0.2)
    assert first["accel"][:, 0] == pytest.approx([0.110, 0.111])  # the third waits: two is the capacity
    assert first["wifi"].tolist() == [[0.2, 7.0, -60.0, 2437.0, pytest.approx(0.199 - 500.0 + 500.301 + 0.0, abs=1)]]
    assert reader.take(0.2)["accel"][:, 0] == pytest.approx([0.121])
    assert sum(reader.skipped.values()) == 5
    comma = RecordReader(sensors, {}, plain_number)
    comma.add(["ACCE,1.5,2.5,1,2,3,0"])
    assert comma.take(2.0)["accel"].tolist() == [[1.5, 1.0, 2.0, 3.0]]


@given(
    st.lists(
        st.text(max_size=60)
        | st.tuples(
            st.sampled_from(["ACCE", "AHRS", "WIFI", "BLE4", "STRIDE", "PRES"]),
            st.lists(st.sampled_from(["", "nan", "1e400", "-1e308", "1e200", "0.5", "3", "ff:00", "x"]), max_size=10),
        ).map(lambda record: ";".join([record[0], *record[1]])),
        max_size=8,
    )
)
def test_whatever_a_server_sends_gives_rows_within_bounds_or_none(lines) -> None:
    names = ("accel", "rotation", "wifi", "ble", "stride", "baro")
    reader = RecordReader({name: sensor_spec(name) for name in names}, {}, plain_number)
    reader.add(lines)
    for name, rows in reader.take(1e9).items():
        spec = sensor_spec(name)
        assert ((rows >= spec.low) & (rows <= spec.high)).all() and (np.diff(rows[:, 0]) >= 0).all()


def asked(server, method: str, path: str, body: bytes | None = None, **headers: str) -> tuple[int, str]:
    connection = http.client.HTTPConnection(*server.server_address[:2], timeout=5)
    try:
        connection.request(method, path, body, headers)
        answer = connection.getresponse()
        return answer.status, answer.read().decode()
    finally:
        connection.close()


def test_the_server_refuses_what_is_no_request(stride_task, serve) -> None:
    with serve(stride_task) as (server, _):
        assert server.server_address[0] == "127.0.0.1"
        assert asked(server, "GET", "/")[1].endswith("walk-a\n")
        assert asked(server, "GET", "/walk-a/state") == asked(server, "GET", "/evaalapi/walk-a/state")
        for path, status in {
            "/nobody/state": 404,
            "/walk-a": 404,
            "/walk-a/state/more": 404,
            "/walk-a/truth": 422,
            "/walk-a/../walk-a/state": 404,
            "/walk-a/nextdata?horizon=1&horizon=2": 422,
            "/walk-a/nextdata?" + "&".join(f"a{i}=1" for i in range(20)): 422,
            "/walk-a/nextdata?position=" + "1" * 3000: 414,
            "/walk-a/nextdata?horizon=%ff": 422,
        }.items():
            assert asked(server, "GET", path)[0] == status, path
        assert asked(server, "POST", "/walk-a/estimates", b"", **{"Content-Length": str(MAX_BODY_BYTES + 1)})[0] == 413
        assert asked(server, "POST", "/walk-a/estimates", b"", **{"Content-Length": "-1"})[0] == 411
        assert asked(server, "DELETE", "/walk-a/state")[0] == 501


def test_no_answer_holds_the_reference(stride_task, serve) -> None:
    """The x of the reference is 77.25 m and more; but for the start, which is given, no answer has it."""
    with serve(stride_task, "test") as (server, ended):
        played_there(server, "stay", stride_task, "5ea1ed")
        texts = [asked(server, "GET", f"/5ea1ed/{what}")[1] for what in ("state", "estimates", "log", "reload")]
        texts.append(asked(server, "GET", "/")[1])
    for x_m in stride_task.load("5ea1ed").reference.xy_m[1:, 0].tolist():
        assert not any(re.search(rf"(?<!\d){x_m:.2f}", text) for text in texts)  # not the end of a clock time
    assert "played once" in texts[3] and ended["5ea1ed"].split == "test"


def test_a_client_says_what_is_wrong(stride_task, serve) -> None:
    with pytest.raises(EvaalError, match="http://"):
        TrialClient("ftp://host/", "a")
    with serve(stride_task) as (server, _):
        with pytest.raises(EvaalError, match="404"):
            TrialClient(server.url, "walk-z").state()
        client = TrialClient(server.url, "walk-a")
        client.next_data(1.0)
        with pytest.raises(EvaalError, match="started already"):
            played_there(server, "stay", stride_task, "walk-a")
        url = server.url
    with pytest.raises(EvaalError, match="check the address"):
        TrialClient(url, "walk-a").state()


def test_addresses_of_another_server_are_hashed_as_readers_do(phone_task, serve, monkeypatch) -> None:
    from pdrbench_formats.recordings.opaque import opaque_id

    with serve(phone_task) as (server, _):
        client = TrialClient(server.url, "walk-a")
        assert client.number_of("wifi", "02:00:00:00:00:01") == opaque_id("wifi", "02:00:00:00:00:01")
        client.state()
        assert client.number_of("wifi", "02:00:00:00:00:01") == 0x020000000001
        monkeypatch.setattr(server.RequestHandlerClass, "server_version", "Werkzeug/3.0")
        other = TrialClient(server.url, "walk-a")
        other.state()
        assert other.number_of("wifi", "02:00:00:00:00:01") == opaque_id("wifi", "02:00:00:00:00:01")


def test_another_server_is_played_once_it_is_said_how_it_writes_positions(
    command, stride_task, serve, monkeypatch
) -> None:
    with serve(stride_task, places=DEGREES) as (server, ended):
        monkeypatch.setattr(server.RequestHandlerClass, "server_version", "Werkzeug/3.0")
        play = ("evaal", "play", server.url, "walk-a", "stay", "--isolation", "none")
        unsaid = command(*play)
        said = command(*play, "--positions", "lon,lat,level", "--reload")
    assert unsaid.code == 2 and "--positions" in unsaid.err
    assert said.code == 0, said.err
    expected = stride_task.load("walk-a").reference.xy_m[0]  # the frame of the client begins at the start
    assert np.abs(ended["walk-a"].estimates.xy_m - expected).max() < 1e-6


def test_a_client_slows_down_where_the_server_asks_for_it(stride_task, serve) -> None:
    now_s = [1000.0]

    def sleep(seconds: float) -> None:
        now_s[0] += seconds

    with serve(stride_task, "test", rules=Rules(slowdown=3.0), clock=lambda: now_s[0]) as (server, ended):
        client = TrialClient(server.url, "5ea1ed", sleep=sleep)
        briefing = stride_task.brief(stride_task.load("5ea1ed"))
        play_trial(client, make_localizer("stay"), briefing, np.random.default_rng(0))
    assert ended["5ea1ed"].status == "complete" and now_s[0] - 1000.0 > 9.0  # from the first stride to the last


def test_where_it_is_carried_can_be_said(command, stride_task, serve, tmp_path) -> None:
    (tmp_path / "mine.py").write_text(
        "from pdrbench.errors import UnsuitableError\n\n\nclass Mine:\n    def reset(self, briefing, rng):\n"
        '        raise UnsuitableError(f"carried: {briefing.mounting}")\n\n    def step(self, observation): ...\n'
    )
    with serve(stride_task) as (server, _):
        play = ("evaal", "play", server.url, "walk-a", f"{tmp_path / 'mine.py'}:Mine", "--isolation", "none")
        done = command(*play, "--mounting", "foot")
    assert done.code == 1 and "carried: foot" in done.err


def test_the_command_plays_and_a_trial_is_stored(command, stride_task, serve, tmp_path, monkeypatch) -> None:
    for module in ("registry", "evaluation.walk_job", "evaluation.tables"):
        monkeypatch.setattr(f"pdrbench.{module}.make_task", lambda name: stride_task)
    with serve(stride_task) as (server, ended):
        play = ("evaal", "play", server.url, "walk-a", "dead_reckoning", "--env", "Served-v0", "--isolation", "none")
        done = command(*play, "--out", tmp_path / "e.csv", "--json")
        again = command(*play)
        reloaded = command(*play, "--reload")
        bare = command("evaal", "play", server.url, "walk-a", "stay", "--isolation", "none", "--reload")
    assert done.code == 0, done.err
    assert done.json["in_time"] and done.json["num_estimates"] > 40
    assert (tmp_path / "e.csv").read_text().splitlines()[0] == "pts,c,h,s,pos"
    assert again.code == 1 and "reload it" in again.err
    assert bare.code == 0, bare.err
    assert reloaded.code == 0 and "finished" in reloaded.out
    assert bare.code == 0, bare.err
    path = store_result(ended["walk-a"], tmp_path)
    from pdrbench.evaluation import load_results

    (result,) = load_results(tmp_path).results
    assert path.exists() and result.localizer == "evaal" and json.dumps(dict(result.provenance))
