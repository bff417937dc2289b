"""The rules of the EvAAL API on one trial, with a clock of its own."""

from __future__ import annotations

import lzma
from pathlib import Path
from urllib.parse import parse_qsl

import numpy as np
import pytest

from pdrbench.errors import EstimateError, PdrbenchError
from pdrbench.io.geo import GeoFrame
from pdrbench_evaal.places import PlaceFormat
from pdrbench_evaal.trial import Rules, Trial

TRANSCRIPT = Path(__file__).with_name("transcript.txt")
T_S = [0.015, 0.515, 1.015, 2.5]
CSV_TYPE = "text/csv; charset=us-ascii"


class Clock:
    def __init__(self) -> None:
        self.now_s = 1000.0

    def __call__(self) -> float:
        return self.now_s


def make_trial(clock: Clock, **rules: object) -> Trial:
    lines = [f"ACCE;{t_s};{t_s};0.0;0.0;9.8;3" for t_s in T_S]
    settings = Rules(**{"slowdown": 3.0, "slack_s": 15.0, **rules})
    return Trial("t", lambda: (lines, np.array(T_S)), PlaceFormat(), lambda: "1.0,2.0,0", settings, clock=clock)


def ask(trial: Trial, request: str) -> tuple[int, str]:
    command, _, query = request.partition("?")
    reply = trial.get(command, dict(parse_qsl(query, keep_blank_values=True)))
    assert isinstance(reply.body, str)
    return reply.status, reply.body


def test_a_trial_keeps_to_the_written_transcript() -> None:
    clock = Clock()
    trial = make_trial(clock)
    played: list[str] = []
    for line in TRANSCRIPT.read_text(encoding="utf-8").splitlines():
        word, _, rest = line.partition(" ")
        if word == "@":
            clock.now_s = float(rest)
        if word in ("@", "#"):
            played.append(line)
        elif word == "GET":
            status, body = ask(trial, rest)
            played += [line, str(status), *body.splitlines()]
        elif word == "POST":
            command, _, body = rest.partition(" ")
            reply = trial.post(command, body.encode(), CSV_TYPE)
            played += [line, str(reply.status), *str(reply.body).splitlines()]
    assert "\n".join(played) + "\n" == TRANSCRIPT.read_text(encoding="utf-8")


def test_a_scoring_trial_is_played_once_and_not_faster_than_real_time() -> None:
    clock = Clock()
    trial = make_trial(clock, is_reloadable=False)
    assert ask(trial, "reload")[0] == 200  # nothing has been served yet
    assert ask(trial, "nextdata?horizon=1")[0] == 200
    before = ask(trial, "state")[1]
    clock.now_s += 0.9
    assert ask(trial, "nextdata?horizon=1&position=5,5,0")[0] == 423
    assert before.split(",")[0] == ask(trial, "state")[1].split(",")[0]
    clock.now_s += 0.2
    assert ask(trial, "nextdata?horizon=1&position=5,5,0")[0] == 200
    assert ask(trial, "reload")[0] == 422
    slow = make_trial(clock, is_reloadable=False, slowdown=2.0)  # the rule is of V > 2
    assert [ask(slow, "nextdata")[0] for _ in range(3)] == [200] * 3


def test_the_log_has_requests_and_answers() -> None:
    trial = make_trial(Clock())
    ask(trial, "nextdata?horizon=1")
    status, text = ask(trial, "log")
    assert status == 200 and "1970-01-01T00:16:40.000 GET nextdata?horizon=1 --> 200" in text and "ACCE;0.515" in text
    assert lzma.decompress(trial.get("log", {"xzcompr": ""}).body).decode() == text
    ask(trial, "reload?keeplog")
    assert ask(trial, "log")[1] == text
    ask(trial, "reload")
    assert ask(trial, "log")[0] == 405


@pytest.mark.parametrize(
    ("body", "kind", "after_s", "status", "num_estimates"),
    [
        (b"0.5,1,2,0\n1.0,3,4,1\n", CSV_TYPE, 15.0, 200, 2),
        (b"0.5,1,2,0\n0.4,3,4,1\n-1,0,0,0\nx\n", CSV_TYPE, 1.0, 409, 1),
        (b"0.5,1,2,0\n", CSV_TYPE, 15.1, 405, 0),
        (b"0.5,1,2,0\n", "text/plain", 1.0, 400, 0),
        (b"0.5,1,2,\xff\n", CSV_TYPE, 1.0, 400, 0),
    ],
)
def test_an_offline_trial_takes_estimates_once(
    body: bytes, kind: str, after_s: float, status: int, num_estimates: int
) -> None:
    clock = Clock()
    trial = make_trial(clock, is_offline=True)
    assert ask(trial, "state")[1] == "0.000,-2.000,0.000,15.000,0.000,0.000,0.000,1.0,2.0,0"
    assert trial.post("estimates", body, kind).status == 422
    assert ask(trial, "nextdata")[0] == 422
    assert len(ask(trial, "nextdata?offline")[1].splitlines()) == len(T_S)
    assert ask(trial, "nextdata?offline")[0] == 405
    clock.now_s += 1.0
    assert ask(trial, "state")[1] == "0.015,14.000,0.000,15.000,1000.000,-2.000,0.000,1.0,2.0,0"
    clock.now_s += after_s - 1.0
    assert trial.post("estimates", body, kind).status == status
    assert len(trial.estimates) - 1 == num_estimates
    if status in (200, 409):
        assert trial.post("estimates", body, kind).status == 405


@pytest.mark.parametrize("text", ["1,2", "1,2,0,0", "1,2,0.5", "nan,2,0", "1,x,0", "", "9" * 1000])
def test_what_is_no_position_is_refused(text: str) -> None:
    with pytest.raises(EstimateError, match="x,y,level"):
        PlaceFormat().read(text)


def test_positions_in_degrees_go_there_and_back() -> None:
    places = PlaceFormat(("lon", "lat", "level"), GeoFrame(49.46, 11.11))
    lon, lat, level = places.write(np.array([30.0, -12.5]), -1).split(",")
    assert float(lon) == pytest.approx(11.1104138, abs=1e-6) and float(lat) == pytest.approx(49.4598876, abs=1e-6)
    xy_m, back = places.read(f"{lon};{lat};{level}")
    assert xy_m == pytest.approx([30.0, -12.5], abs=1e-6) and back == -1


@pytest.mark.parametrize("names", [("x",), ("x", "lat"), ("x", "y", "y"), ("lon", "lat")])
def test_a_format_that_cannot_be_is_refused(names: tuple[str, ...]) -> None:
    with pytest.raises(PdrbenchError, match="position"):
        PlaceFormat(names)
