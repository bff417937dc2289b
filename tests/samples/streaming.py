"""Simulated walks as phones send them, and a server that receives them."""

from __future__ import annotations

import contextlib
import http.client
import json
import socket
import threading
import time
import urllib.parse
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final

import numpy as np
import uvicorn
from websockets.sync.client import ClientConnection

import pdrbench
from pdrbench.geometry import FloatArray
from pdrbench.recording import Recording
from pdrbench_formats.live.phone import WALK, Phone, Setup
from pdrbench_formats.live.server import Server
from pdrbench_formats.maps.geojson import write
from pdrbench_formats.taskfile.load import walks_of_file
from pdrbench_formats.taskfile.schema import StartTable
from pdrbench_sim.buildings.office import make_office
from pdrbench_sim.record import IN_HAND, make_scene, simulate_walk

TOKEN: Final = "a-token"
PACKET_S: Final = 0.25
BEGIN_NS: Final = 1_698_501_144_401_404_000
COLUMNS: Final = {"gyro": ("gyroscope", "xyz"), "mag": ("magnetometer", "xyz"), "baro": ("barometer", ("pressure",))}
BUFFERS: Final = {"accel": ("accelerometer", "acc"), "gyro": ("gyroscope", "gyr"), "mag": ("magnetic_field", "mag")}


@dataclass(frozen=True)
class Stroll:
    """A walk, its plan as a file, and where it begins."""

    walk: Recording
    plan: Path
    start: StartTable

    @property
    def ends_s(self) -> FloatArray:
        """When each packet is sent."""
        return np.arange(PACKET_S, self.walk.end_s + PACKET_S, PACKET_S)

    def rows(self, sensor: str, end_s: float) -> FloatArray:
        """Of one packet."""
        rows = self.walk.streams[sensor].rows
        return rows[(rows[:, 0] >= end_s - PACKET_S) & (rows[:, 0] < end_s)]

    def push(self, end_s: float, *, device: str = "android", is_apple: bool = False) -> bytes:
        """A packet as Sensor Logger pushes it, of Android or an iPhone."""
        samples: list[dict[str, Any]] = []

        def add(name: str, rows: FloatArray, names: Sequence[str]) -> None:
            for t_s, *values in rows.tolist():
                time_ns = BEGIN_NS + round(t_s * 1e9)
                samples.append({"name": name, "time": time_ns, "values": dict(zip(names, values, strict=True))})

        accel, rotation, down = self.rows("accel", end_s), self.rows("rotation", end_s), np.array([0.0, 0.0, 0.0, 9.81])
        if is_apple:  # user acceleration and gravity apart, with the opposite sign
            add("accelerometer", (accel - down) * [1, -1, -1, -1], "xyz")
            t_s, w, x, y, z = rotation.T  # from north along x
            rotation = np.column_stack([t_s, np.array([w + z, x + y, y - x, z - w]).T * np.sqrt(0.5)])
            add("gravity", np.column_stack([accel[:, 0], np.tile(-down[1:], (len(accel), 1))]), "xyz")
        else:
            add("totalacceleration", accel, "xyz")
        add("orientation", rotation, ("qw", "qx", "qy", "qz"))
        for sensor, (name, names) in COLUMNS.items():
            if sensor in self.walk.streams:
                add(name, self.rows(sensor, end_s), tuple(names))
        return json.dumps({"messageId": 1, "sessionId": "s", "deviceId": device, "payload": samples}).encode()

    def unreliable(self, rng: np.random.Generator) -> list[float]:
        """Packets with 10 % of loss and of doubling after the first seconds, each up to four places late."""
        kept = self.ends_s[(rng.random(len(self.ends_s)) > 0.1) | (self.ends_s < 2.0)]
        sent = np.concatenate([kept, kept[rng.random(len(kept)) < 0.1]])
        late_s = np.where(sent < 2.0, 0.0, rng.uniform(0.0, 4 * PACKET_S, len(sent)))
        return sent[np.argsort(sent + late_s, kind="stable")].tolist()

    def send(self, client: ClientConnection, end_s: float) -> None:
        """A packet as rows of each sensor, over a websocket."""
        for sensor in ("accel", "gyro", "rotation", "baro", "wifi"):
            if sensor in self.walk.streams:
                client.send(json.dumps({"sensor": sensor, "rows": self.rows(sensor, end_s).tolist()}))
                assert "error" not in json.loads(client.recv())


def make_stroll(folder: Path, duration_s: float = 12) -> Stroll:
    """A walk with a phone in the hand."""
    building = make_office(np.random.default_rng(1), num_levels=1, area_m2=1500)
    walk = simulate_walk(make_scene(np.random.default_rng(2), building), 3, IN_HAND, duration_s=duration_s)
    plan = folder / "plan.geojson"
    write(building, plan)
    x_m, y_m = walk.reference.xy_m[0].tolist()
    return Stroll(walk, plan, StartTable(xy_m=(x_m, y_m), level=int(walk.reference.level[0]), heading_deg=154.0))


@dataclass
class Running:
    """A server that runs in a thread of its own."""

    server: Server
    port: int

    def post(self, content: bytes, path: str = f"/{TOKEN}/push", method: str = "POST") -> tuple[int, str]:
        with contextlib.closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=120)) as connection:
            connection.request(method, path, content)
            answer = connection.getresponse()
            return answer.status, answer.read().decode()

    def play(self, ends_s: list[float], packet: Callable[[float], bytes]) -> None:
        """Ten times as fast as real time."""
        for end_s in ends_s:
            assert self.post(packet(end_s))[0] == 200
            time.sleep(PACKET_S / 10)

    def ended(self, name: str) -> Phone:
        """A phone whose walk is over."""
        self.server.phones[name].end()
        return self.server.phones[name]


@contextlib.contextmanager
def running(setup: Setup, phyphox: tuple[str, ...] = ()) -> Iterator[Running]:
    server = Server(setup, TOKEN, phyphox)
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        web = uvicorn.Server(uvicorn.Config(server.app, log_level="error", access_log=False))
        thread = threading.Thread(target=web.run, args=([listener],))
        listener.listen()
        thread.start()
        try:
            yield Running(server, listener.getsockname()[1])
        finally:
            web.should_exit = True
            thread.join(60)
            assert not thread.is_alive()


class FakePhyphox(BaseHTTPRequestHandler):
    """The remote interface of a phone that is `now_s` into its walk; each request moves it on by a packet."""

    stroll: Stroll
    now_s = 0.0

    def do_GET(self) -> None:
        path, _, query = self.path.partition("?")
        answer = self.config() if path == "/config" else self.get(query)
        self.send_response(200)
        self.end_headers()
        self.wfile.write(json.dumps(answer).encode())

    def config(self) -> Any:
        return {
            "inputs": [
                {"source": name, "outputs": [{axis: f"{short}{axis}"} for axis in "xyzt"]}
                for name, short in BUFFERS.values()
            ]
        }

    def get(self, query: str) -> Any:
        type(self).now_s += PACKET_S
        buffers = {}
        for asked in query.split("&"):
            name, _, since = urllib.parse.unquote(asked).partition("=")
            sensor = next(sensor for sensor, (_, short) in BUFFERS.items() if name.startswith(short))
            rows = self.stroll.walk.streams[sensor].rows
            after_s = -1.0 if since == "full" else float(since.partition("|")[0])
            rows = rows[(rows[:, 0] > after_s) & (rows[:, 0] <= self.now_s)]
            buffers[name] = {"size": 0, "updateMode": "partial", "buffer": rows[:, " xyz".find(name[-1]) % 4].tolist()}
            if name.endswith("t"):
                buffers[name]["buffer"] = rows[:, 0].tolist()
        return {"buffer": buffers, "status": {"session": "s", "measuring": True}}

    def log_message(self, *_: object) -> None:
        pass


@contextlib.contextmanager
def fake_phyphox(stroll: Stroll) -> Iterator[tuple[str, type[FakePhyphox]]]:
    handler = type("Handler", (FakePhyphox,), {"stroll": stroll})
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,)).start()
        yield f"http://127.0.0.1:{server.server_port}", handler
        server.shutdown()


def assert_replays(phone: Phone, localizer: str) -> FloatArray:
    """The folder of a phone's walk plays to the answers that the page was given; gives its rows of acceleration."""
    (folder,) = phone.folders
    result = pdrbench.evaluate(localizer, str(folder), split="test", isolation="none").results[0]
    assert result.status == "complete", result.failure
    trail = np.array(phone.trail, dtype=np.float64)
    k = np.rint(trail[:, 4] / 0.2).astype(int)
    assert k[-1] == len(result.estimates) - 1 and len(np.unique(k)) == len(k) > 10
    np.testing.assert_allclose(trail[:, :2], result.estimates.xy_m[k], atol=6e-4)  # the page has millimetres
    recording = walks_of_file(folder / "task.toml").task.load(WALK)
    return recording.streams["accel"].rows
