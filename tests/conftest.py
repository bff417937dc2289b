"""Fixtures for the tests of every room, among them headless Chromium, driven over its own pipe without a package."""

from __future__ import annotations

import contextlib
import ctypes
import gc
import importlib
import itertools
import json
import os
import re
import select
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, Final

# A hundred processes would compile every module of this house and of others again, each for itself.
if os.environ.pop("PYTHONDONTWRITEBYTECODE", ""):
    sys.dont_write_bytecode = False

import numpy as np
import psutil
import pytest
from hypothesis import HealthCheck, settings
from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

from pdrbench.building import Building
from pdrbench.cli import main
from pdrbench_sim.buildings.office import make_office

# Matrices are small: where processes share the cores, threads for them wait ten times as long as they work.
os.environ["OPENBLAS_NUM_THREADS"] = "1"  # of libraries that are loaded later, and of children
threadpool_limits(1, user_api="blas")
# Threads of kernels that wait spin instead, on cores that others need; compiling makes objects by the million, and a
# collector that looks for cycles every 700 of them takes a tenth of the time.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
gc.set_threshold(50_000, 20, 20)

# What takes longest to compile, in as many parts as there are workers: each begins with another, and reads what the
# others have written.
PARTS: Final = (
    ("scipy.stats", "scipy.io", "scipy.signal", "scipy.interpolate"),
    ("pandas", "starlette.applications"),
    ("matplotlib.backends.backend_agg", "pdrbench.evaluation", "pdrbench_formats", "pdrbench_leaderboard.run"),
)
if worker := os.environ.get("PYTEST_XDIST_WORKER", "").removeprefix("gw"):
    for number in range(len(PARTS)):
        for module in PARTS[(int(worker) + number) % len(PARTS)]:
            with contextlib.suppress(ImportError):
                importlib.import_module(module)

# How long drawing takes says how busy a machine is, and nothing of what is tested.
settings.register_profile("busy", suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("busy")

PR_SET_CHILD_SUBREAPER = 36
GONE_WITHIN_S = 20.0  # a process that has just been started takes some seconds to look around
TIMEOUT_S: Final = 30.0
KERNELS: Final = ("tests/inertial/", "tests/baselines/", "tests/sensors/", "tests/filters/", "tests/radio/")
NAMES: Final = ("chromium", "chromium-browser", "google-chrome")
FLAGS: Final = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run"),
    *("--remote-debugging-pipe", "--hide-scrollbars", "--disable-background-networking", "--disable-extensions"),
)
KEYS: Final = {"Tab": 9, "Enter": 13, " ": 32, "ArrowRight": 39, "ArrowDown": 40, "Home": 36, "End": 35}


def pytest_xdist_auto_num_workers() -> int | None:
    """Of `-n auto`: one more than there are cores, since there is always a test that waits for a deadline or a page."""
    if "PYTEST_XDIST_AUTO_NUM_WORKERS" in os.environ:
        return None  # xdist takes that
    return len(os.sched_getaffinity(0)) + 1 if hasattr(os, "sched_getaffinity") else (os.cpu_count() or 1) + 1


@pytest.fixture
def rng() -> np.random.Generator:
    """A generator with a fixed seed: same numbers in every run."""
    return np.random.default_rng(20080921)


class _Quiet(SimpleHTTPRequestHandler):
    """Serves a folder without a word."""

    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture
def serve(monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[Path], str]]:
    """Serves folders on loopback, and gives the address of each."""
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    with contextlib.ExitStack() as stack:

        def start(folder: Path) -> str:
            server = stack.enter_context(ThreadingHTTPServer(("127.0.0.1", 0), partial(_Quiet, directory=str(folder))))
            threading.Thread(target=server.serve_forever, args=(0.01,)).start()
            stack.callback(server.shutdown)
            return f"http://127.0.0.1:{server.server_port}"

        yield start


@pytest.fixture(scope="session")
def office() -> Building:
    """Two levels of 750 m2, with stairs."""
    return make_office(np.random.default_rng(7), num_levels=2, area_m2=1500.0)


@pytest.fixture(scope="session")
def data_root() -> Path:
    """Folder that holds the recorded datasets by name; skips where there is none."""
    for place in os.environ.get("PDRBENCH_DATA", "").split(os.pathsep):
        if place and Path(place).is_dir() and any(Path(place).iterdir()):
            return Path(place)
    pytest.skip("recorded data not found: set PDRBENCH_DATA to the folder that holds ilc20/")


@dataclass(frozen=True)
class Outcome:
    """The outcome of a command."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> Any:
        """Standard output, which must be one JSON document without NaN and nothing else."""
        return json.loads(self.out, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))


Command = Callable[..., Outcome]


@pytest.fixture
def command(capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Command:
    """Runs `pdrbench ARGUMENTS...` as in a log, where no terminal says how wide it is."""
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.setattr(sys, "path", [*sys.path])  # a command adds its folder; workers of another path are not reused

    def run(*arguments: object) -> Outcome:
        with pytest.raises(SystemExit) as stop:
            main([str(argument) for argument in arguments])
        captured = capfd.readouterr()
        assert isinstance(stop.value.code, int)
        return Outcome(stop.value.code, captured.out, captured.err)

    return run


@pytest.fixture
def one_figure(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reports have their first figure only, of few pixels; the tests of `report` draw all of them."""
    from pdrbench.report import folder

    monkeypatch.setattr(folder, "DPI", 40)

    draw = folder._figures
    monkeypatch.setattr(folder, "_figures", lambda *given: itertools.islice(draw(*given), 1))


class Orphans:
    """Inside, processes whose parents end become children of this one (Linux), so that none is missed."""

    def __enter__(self) -> Orphans:
        self._adopt(True)
        self._before = set(psutil.Process().children())
        return self

    def __exit__(self, *error: object) -> None:
        self._adopt(False)

    def left(self) -> list[str]:
        """Command lines of processes that came to be and are still there after some seconds; they are ended."""
        until_s = time.monotonic() + GONE_WITHIN_S
        while (left := self._living()) and time.monotonic() < until_s:
            time.sleep(0.05)
        names = []
        for process in left:
            with contextlib.suppress(psutil.Error):
                names.append(" ".join(process.cmdline())[:200])
                process.kill()
        return names

    def _adopt(self, adopts: bool) -> None:
        if sys.platform == "linux":
            ctypes.CDLL(None).prctl(PR_SET_CHILD_SUBREAPER, int(adopts), 0, 0, 0)

    def _living(self) -> set[psutil.Process]:
        """New children and their descendants; older children, such as a browser, may start processes of their own."""
        ours = set(psutil.Process().children()) - self._before
        with contextlib.suppress(psutil.Error):
            ours |= {process for child in ours for process in child.children(recursive=True)}
        return {process for process in ours if self._lives(process)}

    def _lives(self, process: psutil.Process) -> bool:
        """False for an ended process; an ended adopted child is reaped."""
        with contextlib.suppress(psutil.Error, ChildProcessError):
            if process.status() != psutil.STATUS_ZOMBIE:
                return True
            if process not in getattr(self, "_before", ()):
                os.waitpid(process.pid, os.WNOHANG)
        return False


@pytest.hookimpl(tryfirst=True)
@pytest.hookimpl(tryfirst=True)
def pytest_collection(session: pytest.Session) -> None:
    """Each worker begins to read the tests with another folder, and finds what the others have compiled."""
    if worker and session.config.args == ["tests"]:
        rooms = sorted(map(str, Path("tests").glob("[!_]*/")))
        begin = len(rooms) * (int(worker) % len(PARTS)) // len(PARTS)
        session.config.args = [*rooms[begin:], *rooms[:begin], *sorted(map(str, Path("tests").glob("test_*.py")))]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Tests of confinement skip where there is none.

    Those of kernels come first, by room, for one worker, which compiles them once: workers begin at equal distances.
    """
    paths = {item: item.path.relative_to(item.config.rootpath).as_posix() for item in items}
    items.sort(key=lambda item: ([not paths[item].startswith(room) for room in KERNELS], paths[item]))
    for item in items:
        if sys.platform != "linux" and item.get_closest_marker("confinement"):
            item.add_marker(pytest.mark.skip(reason="localizers are confined on Linux only"))


@pytest.fixture(scope="session")
def orphans() -> type[Orphans]:
    """The class, to be used as a context."""
    return Orphans


def find_browser() -> str:
    """Path of a Chromium; skips where there is none."""
    found = next(filter(None, map(shutil.which, NAMES)), None)
    if found is None:
        pytest.skip(f"no browser was found: none of {', '.join(NAMES)} is installed")
    return found


class PageLeftError(AssertionError):
    """The page went to another one before it answered."""


class Page:
    """One tab of one browser."""

    def __init__(self, process: subprocess.Popen[bytes], send: int, receive: int) -> None:
        self.process, self._send, self._receive = process, send, receive
        self._buffer = b""
        self._ids = itertools.count(1)
        self.events: list[dict[str, Any]] = []
        self._session = ""
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """One command of the DevTools protocol, and its answer."""
        number = next(self._ids)
        message: dict[str, Any] = {"id": number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._send, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._read()
            if answer.get("id") == number:
                error = answer.get("error", {}).get("message", "")
                if "navigated" in error:
                    raise PageLeftError(method)
                assert "error" not in answer, f"{method}: {answer.get('error')}"
                result: dict[str, Any] = answer["result"]
                return result
            self.events.append(answer)

    def _read(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            ready, _, _ = select.select([self._receive], [], [], TIMEOUT_S)
            assert ready, "the browser does not answer"
            part = os.read(self._receive, 1 << 20)
            assert part, "the browser ended"
            self._buffer += part
        message, _, self._buffer = self._buffer.partition(b"\0")
        found: dict[str, Any] = json.loads(message)
        return found

    def open(self, path: Path | str, query: str = "") -> None:
        """Goes to a file, and waits until it is loaded."""
        self.events.clear()
        url = (path.as_uri() if isinstance(path, Path) else path) + query
        self.call("Page.navigate", url=url)
        file = json.dumps(re.split("[?#]", url)[0])
        self.wait(f"document.readyState === 'complete' && location.href.startsWith({file})")

    def run(self, expression: str) -> Any:
        """The value of some JavaScript."""
        answer = self.call("Runtime.evaluate", expression=expression, returnByValue=True, awaitPromise=True)
        assert "exceptionDetails" not in answer, answer["exceptionDetails"]
        return answer["result"].get("value")

    def wait(self, condition: str) -> Any:
        """Waits until some JavaScript is true."""
        until = time.monotonic() + TIMEOUT_S
        while time.monotonic() < until:
            with contextlib.suppress(PageLeftError):  # a click leads to another page
                value = self.run(condition)
                if value or value == {}:  # an element of the page arrives as an empty object
                    return value
            time.sleep(0.02)
        raise AssertionError(f"never came true: {condition}")

    def key(self, name: str) -> None:
        """Presses a key as a keyboard does."""
        text = {"Enter": "\r", " ": " "}.get(name, "")
        common = {"key": name, "code": {" ": "Space"}.get(name, name), "windowsVirtualKeyCode": KEYS[name]}
        self.call("Input.dispatchKeyEvent", type="keyDown" if text else "rawKeyDown", text=text, **common)
        self.call("Input.dispatchKeyEvent", type="keyUp", **common)

    def type(self, text: str) -> None:
        """Types into whatever has the focus."""
        self.call("Input.insertText", text=text)

    def click(self, selector: str) -> None:
        """Clicks with the mouse on the middle of an element."""
        place = json.dumps(selector)
        box = self.run(
            f"(() => {{ const e = document.querySelector({place}); e.scrollIntoView({{block: 'center'}});"
            " const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; })()"
        )
        for kind in ("mousePressed", "mouseReleased"):
            self.call("Input.dispatchMouseEvent", type=kind, x=box[0], y=box[1], button="left", clickCount=1)

    def media(self, **features: str) -> None:
        """Sets media features, as in `prefers_color_scheme="dark"`."""
        media = [{"name": name.replace("_", "-"), "value": value} for name, value in features.items()]
        self.call("Emulation.setEmulatedMedia", features=media)

    def size(self, width: int, height: int, mobile: bool = False) -> None:
        """The size of the window in pixels."""
        self.call("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=mobile)

    def complaints(self) -> list[str]:
        """Console messages since the page was opened: errors, exceptions, policy violations."""
        self.run("1")  # takes what is still in the pipe
        said = []
        for event in self.events:
            parameters = event.get("params", {})
            if event.get("method") == "Runtime.exceptionThrown":
                said.append(json.dumps(parameters["exceptionDetails"])[:500])
            if event.get("method") == "Log.entryAdded" and parameters["entry"]["level"] in ("error", "warning"):
                said.append(parameters["entry"]["text"])
        return said


@contextlib.contextmanager
def browse() -> Iterator[Page]:
    """A browser with a profile of its own, ended with everything it started."""
    program = find_browser()
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        to_browser, send = os.pipe()
        receive, from_browser = os.pipe()
        # The protocol is spoken on descriptors 3 and 4.
        shell = f'exec "$@" 3<&{to_browser} 4>&{from_browser}'
        command = ["sh", "-c", shell, "sh", program, *FLAGS, f"--user-data-dir={profile}", "about:blank"]
        if max(to_browser, from_browser) > 9:  # sh supports single digits only
            command[:3] = ["bash", "-c", shell]
        process = subprocess.Popen(
            command,
            pass_fds=(to_browser, from_browser),
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(to_browser)
        os.close(from_browser)
        try:
            page = Page(process, send, receive)
            page.size(1280, 900)
            yield page
            page._session = ""
            page.call("Browser.close")
        finally:
            os.close(send)
            os.close(receive)
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


@pytest.fixture(scope="session")
def browser() -> Iterator[Page]:
    """One browser for all tests that need one."""
    with browse() as page:
        yield page
