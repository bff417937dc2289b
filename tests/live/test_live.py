"""`pdrbench live`: four formats with loss, reordering and doubling; packets that nobody means; the page."""

from __future__ import annotations

import contextlib
import copy
import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from streaming import TOKEN, Running, Stroll, assert_replays, fake_phyphox, make_stroll, running
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench_formats.live.feeds import MAX_BYTES
from pdrbench_formats.live.phone import ENDED, FAILED, TAP, Setup
from pdrbench_formats.live.server import Allowance

LOCALIZER = "dead_reckoning"
WAIT_S = 1.5  # of what comes up to four packets late


@pytest.fixture(scope="session")
def stroll(tmp_path_factory: pytest.TempPathFactory) -> Stroll:
    return make_stroll(tmp_path_factory.mktemp("plan"))


@pytest.fixture
def setup(stroll: Stroll, tmp_path: Path) -> Setup:
    return Setup(LOCALIZER, stroll.plan, start=stroll.start, out=tmp_path, wait_s=WAIT_S)


@pytest.fixture
def live(setup: Setup) -> Iterator[Running]:
    with running(setup) as server:
        yield server


@contextlib.contextmanager
def websocket(live: Running, path: str) -> Iterator[ClientConnection]:
    with connect(f"ws://127.0.0.1:{live.port}/{TOKEN}/{path}", proxy=None, max_size=None) as client:
        yield client


@pytest.mark.parametrize("is_apple", [False, True], ids=["android", "iphone"])
def test_sensor_logger(
    live: Running, stroll: Stroll, rng: np.random.Generator, tmp_path: Path, command: Any, is_apple: bool
) -> None:
    sent = stroll.unreliable(rng)
    live.play(sent, lambda end_s: stroll.push(end_s, is_apple=is_apple))
    accel = assert_replays(live.ended("android"), LOCALIZER)
    arrived = np.concatenate([stroll.rows("accel", end_s) for end_s in sorted(set(sent))])
    np.testing.assert_allclose(accel[:, 0], arrived[:, 0] - arrived[0, 0], atol=1e-6)
    np.testing.assert_allclose(accel[:, 1:], arrived[:, 1:], atol=1e-9)
    if not is_apple:
        phone = live.server.phones["android"]
        words = ("--localizer", LOCALIZER, "--isolation", "none", "--out", tmp_path / "tried")
        (path,) = command("try", phone.folders[0], *words, "--json").json["paths"]
        np.testing.assert_allclose([path["end_x_m"], path["end_y_m"]], phone.trail[-1][:2], atol=6e-4)
        assert "leave out" in command("try", phone.folders[0], *words, "--heading", "3").err


def test_websocket(live: Running, stroll: Stroll, rng: np.random.Generator) -> None:
    with websocket(live, "stream?device=my%20phone") as client:
        for end_s in stroll.unreliable(rng):
            stroll.send(client, end_s)
    assert_replays(live.ended("my phone"), LOCALIZER)


def test_phyphox(setup: Setup, stroll: Stroll) -> None:
    with fake_phyphox(stroll) as (address, handler), running(replace(setup, localizer="learned"), (address,)) as live:
        name = f"phyphox {address[7:]}"
        wait(lambda: handler.now_s > stroll.walk.end_s)
        accel = assert_replays(live.ended(name), "learned")
    assert len(accel) > 0.9 * len(stroll.walk.streams["accel"].rows)


def test_two_phones_at_once(live: Running, stroll: Stroll) -> None:
    for end_s in stroll.ends_s:
        for device in ("one", "two"):
            assert live.post(stroll.push(end_s if device == "one" else end_s / 2, device=device))[0] == 200
    for device in ("one", "two"):
        assert_replays(live.ended(device), LOCALIZER)
    assert live.server.phones["one"].trail != live.server.phones["two"].trail


def odd_packets(stroll: Stroll, rng: np.random.Generator, num: int) -> Iterator[bytes]:
    """Bytes that are no JSON, JSON that is no push, and pushes of which something was changed."""
    good = stroll.push(1.0)
    yield from (b"", b"{", b"null", b"[]", b"[" * 100_000, b'{"a":' * 50_000, b"\xff\xfe\x00", b'{"payload": {}}')
    odd: tuple[Any, ...] = (1e308, -1, 10**400, None, "x", [], {}, "NaN", True, -(2**70), "9" * 400)
    for _ in range(num):
        kind = rng.integers(4)
        if kind == 0:
            yield rng.bytes(int(rng.integers(2000)))
        elif kind == 1:
            yield good[: rng.integers(len(good))]
        elif kind == 2:
            mutated = bytearray(good)
            for place in rng.integers(len(good), size=5):
                mutated[place] = rng.integers(256)
            yield bytes(mutated)
        else:
            push = json.loads(good)
            push["deviceId"] = odd[rng.integers(len(odd))] if rng.random() < 0.2 else "android"
            for _ in range(20):
                sample = push["payload"][rng.integers(len(push["payload"]))]
                key = str(rng.choice(["name", "time", "values", "x"]))
                changed = sample["values"] if key == "x" and isinstance(sample["values"], dict) else sample
                changed[key] = copy.deepcopy(odd[rng.integers(len(odd))])
            yield json.dumps(push).encode()


def test_no_packet_ends_it(live: Running, stroll: Stroll, rng: np.random.Generator) -> None:
    packets = odd_packets(stroll, rng, 10**9)
    until_s = time.monotonic() + float(os.environ.get("LIVE_FUZZ_S", "1"))
    count = 0
    with websocket(live, "stream?device=socket") as client, websocket(live, "view") as view:
        while time.monotonic() < until_s or count < 40:
            packet = next(packets)
            assert live.post(packet)[0] in (200, 400, 429)
            client.send(packet)
            assert client.recv()
            view.send(packet)
            count += 1
    for end_s in stroll.ends_s:
        assert live.post(stroll.push(end_s, device="after"))[0] == 200
    assert_replays(live.ended("after"), LOCALIZER)


def test_without_the_token_there_is_nothing(live: Running) -> None:
    wrong = ("", "push", "wrong/", "wrong/push", "wrong/plan", "wrong/live.js", f"{TOKEN}x/", "wr%C3%B6ng/")
    for path in (f"/{place}" for place in wrong):
        for method in ("GET", "POST"):
            assert live.post(b"{}", path, method)[0] in (404, 405)
    assert live.post(b"", f"/{TOKEN}/task.toml", "GET")[0] == 404
    for path in ("view", "stream"):
        with (
            pytest.raises((InvalidStatus, ConnectionClosed)),
            connect(f"ws://127.0.0.1:{live.port}/wrong/{path}", proxy=None) as client,
        ):
            client.recv()


def test_what_is_too_large_or_comes_too_often_is_refused(live: Running, stroll: Stroll) -> None:
    assert live.post(b" " * (MAX_BYTES + 1))[0] == 413
    live.server._requests = Allowance(2.5)
    assert sorted({live.post(stroll.push(end_s))[0] for end_s in stroll.ends_s[:12]})[-1] == 429


def test_a_localizer_that_fails_ends_its_walk_only(
    setup: Setup, stroll: Stroll, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pdrbench_formats.live.phone.make_localizer", lambda _: Drifting(1.5))
    with running(setup) as live:
        for end_s in stroll.ends_s:
            assert live.post(stroll.push(end_s))[0] == 200
        phone = live.ended("android")
        assert phone.state == FAILED and "of the user" in phone.why
    assert phone.folders[0].is_dir()  # what it was given is kept


class Drifting:
    """A metre a second along x, with ten particles; fails after a while."""

    def __init__(self, fails_s: float) -> None:
        self._fails_s = fails_s

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        assert briefing.start is not None
        self._xy_m = briefing.start.xy_m

    def step(self, observation: Observation) -> Estimate:
        if observation.now_s > self._fails_s:
            raise ValueError("<b>of the user</b>")
        return Estimate(self._xy_m + np.array([observation.now_s, 0.0]), 0, sigma_m=1.0)

    def debug(self) -> dict[str, Any]:
        return {"particles_xy_m": self._xy_m + np.arange(10.0)[:, None]}


def wait(is_so: Callable[[], bool], within_s: float = 120.0) -> None:
    until_s = time.monotonic() + within_s
    while not is_so():
        assert time.monotonic() < until_s
        time.sleep(0.02)


@pytest.mark.parametrize("width", [390, 1200])
def test_the_page_shows_the_phone_and_takes_its_start(
    setup: Setup, stroll: Stroll, browser: Any, monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    monkeypatch.setattr("pdrbench_formats.live.phone.make_localizer", lambda _: Drifting(60.0))
    device = "<img src=x onerror=alert(1)>"
    with running(replace(setup, start=None, wait_s=0.1)) as live:
        browser.size(width, 800)
        browser.open(f"http://127.0.0.1:{live.port}/{TOKEN}/")
        for end_s in stroll.ends_s[:12]:
            live.post(stroll.push(end_s, device=device))
        browser.wait("document.getElementById('says').textContent.startsWith('tap')")
        assert live.server.phones[device].state == TAP
        x, y = browser.run(
            "(() => { const b = document.getElementById('plan').getBoundingClientRect();"
            " return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )
        for kind, dx in (("mousePressed", 0), ("mouseMoved", 40), ("mouseReleased", 40)):
            browser.call("Input.dispatchMouseEvent", type=kind, x=x + dx, y=y, button="left", buttons=1, clickCount=1)
        wait(lambda: live.server.phones[device].walk == 1)
        for end_s in stroll.ends_s[12:]:
            live.post(stroll.push(end_s, device=device))
        wait(lambda: any(place[4] > 5.0 for place in live.server.phones[device].trail))
        browser.wait("Number(document.getElementById('plan').dataset.time) > 5")
        assert browser.run("document.querySelector('#phone option').textContent") == device
        facts = browser.run("document.getElementById('facts').textContent")
        assert "particles10" in facts and "95 % within2.4 m" in facts
        assert browser.run("document.documentElement.scrollWidth <= window.innerWidth")
        browser.click("#end")
        wait(lambda: bool(live.server.phones[device].folders))
        assert live.server.phones[device].state == ENDED
        assert browser.complaints() == []
        folder = live.server.phones[device].folders[0]
    assert re.search(r"heading_deg = -?0(\.0)?\b", (folder / "task.toml").read_text())


def test_the_command(stroll: Stroll, tmp_path: Path, command: Any) -> None:
    assert "--start" in command("live", "--start", "here", "--out", tmp_path).err
    x_m, y_m = stroll.start.xy_m or (0.0, 0.0)
    words = ("live", "--map", str(stroll.plan), "--localizer", LOCALIZER, "--port", "0", "--out", str(tmp_path))
    process = subprocess.Popen(
        [sys.executable, "-u", "-c", "from pdrbench.cli import main; main()", *words, "--start", f"{x_m},{y_m},0,154"],
        stdout=subprocess.PIPE,
        text=True,
    )
    with contextlib.ExitStack() as stack:
        stack.callback(process.kill)
        assert process.stdout is not None
        found = re.search(r"http://127\.0\.0\.1:(\d+)/([\w-]+)/", process.stdout.readline())
        assert found is not None
        live = Running(None, int(found[1]))  # type: ignore[arg-type]
        for end_s in stroll.ends_s:
            assert live.post(stroll.push(end_s), f"/{found[2]}/push")[0] == 200
        process.send_signal(signal.SIGINT)
        said, _ = process.communicate(timeout=120)
    assert f"pdrbench try {tmp_path / 'android-1'} --localizer {LOCALIZER}" in said
