"""A file server on loopback that can break off, refuse ranges and lose files, and a small dataset to fetch from it."""

from __future__ import annotations

import hashlib
import re
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import pytest

from pdrbench.datasets import DataFile, Dataset
from pdrbench.datasets.download import git_blob
from pdrbench.datasets.recipes import compress, radio_survey


@dataclass
class Server:
    """Served files, simulated faults and received requests."""

    address: str
    files: dict[str, bytes] = field(default_factory=dict)
    has_ranges: bool = True
    break_after: dict[str, int] = field(default_factory=dict)
    sent: list[tuple[str, int]] = field(default_factory=list)
    before: Callable[[str], object] = lambda path: None  # called with each path before it is served

    def requests_of(self, path: str) -> list[int]:
        """Bytes sent for each request of a path."""
        return [count for asked, count in self.sent if asked == path]


class _Handler(BaseHTTPRequestHandler):
    server: _FileServer

    def do_GET(self) -> None:
        state = self.server.state
        path = self.path.lstrip("/")
        state.before(path)
        if path not in state.files:
            self.send_error(404)
            state.sent.append((path, 0))
            return
        content, first = state.files[path], 0
        asked = re.fullmatch(r"bytes=(\d+)-", self.headers.get("Range", ""))
        if asked and state.has_ranges:
            first = int(asked[1])
            if first >= len(content):
                self.send_error(416)
                return
            self.send_response(206)
            self.send_header("Content-Range", f"bytes {first}-{len(content) - 1}/{len(content)}")
        else:
            self.send_response(200)
        body = content[first:]
        self.send_header("Content-Length", str(len(body)))
        self.end_headers()
        body = body[: state.break_after.pop(path, len(body))]
        self.wfile.write(body)
        state.sent.append((path, len(body)))

    def log_message(self, *_: object) -> None:
        pass


class _FileServer(ThreadingHTTPServer):
    state: Server
    daemon_threads = True


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[Server]:
    """A server on loopback that begins with no files."""
    for name in ("http_proxy", "HTTP_PROXY", "all_proxy", "ALL_PROXY"):
        monkeypatch.delenv(name, raising=False)
    with _FileServer(("127.0.0.1", 0), _Handler) as httpd:
        httpd.state = Server(f"http://127.0.0.1:{httpd.server_port}")
        thread = threading.Thread(target=httpd.serve_forever, args=(0.01,))
        thread.start()
        yield httpd.state
        httpd.shutdown()
        thread.join()


LICENCE = b"Do as you please.\n"
WALK = b"#\tstartTime:0\n" + b"".join(
    b"%d\tTYPE_ACCELEROMETER\t0.1\t0.2\t%.1f\n" % (step, 9.8) for step in range(20_000)
)
SURVEY = (
    b"#\tstartTime:0\n1\tTYPE_WAYPOINT\t1.0\t2.0\n2\tTYPE_GYROSCOPE\t0\t0\t0\n"
    b"3\tTYPE_WIFI\t\taa:bb\t-60\t2412\t2\n4\tTYPE_BEACON\tu\t1\t2\t-59\t-70\n5\tTYPE_WIFI_LIKE\tx\n#\tendTime:6\n"
)


def file_of(path: str, content: bytes, role: str = "data", **facts: str) -> DataFile:
    """The row of a file with this content."""
    return DataFile(path=path, sha256=hashlib.sha256(content).hexdigest(), bytes=len(content), role=role, **facts)


@pytest.fixture
def small(server: Server) -> Dataset:
    """A set of a licence, a map as it is, a compressed walk and a filtered survey, all served by `server`."""
    server.files.update({"LICENSE": LICENCE, "map.json": b"{}", "walk.txt": WALK, "survey.txt": SURVEY})
    return _make_small(lambda name: f"{server.address}/{name}")


@pytest.fixture
def make_small(small: Dataset) -> Callable[[Callable[[str], str]], Dataset]:
    """Makes the small set with other urls."""
    return _make_small


def _make_small(url: Callable[[str], str]) -> Dataset:
    """The small set with urls made by `url`."""
    rows = []
    for path, source, recipe in (("walk.txt.gz", WALK, "gzip"), ("survey.txt.gz", SURVEY, "radio_survey_gzip")):
        text = radio_survey(source) if recipe == "radio_survey_gzip" else source
        made = {"content_sha256": hashlib.sha256(text).hexdigest(), "recipe": recipe, "source_blob": git_blob(source)}
        rows.append(file_of(f"floor/{path}", compress(text), url=url(path.removesuffix(".gz")), **made))
    return Dataset(
        name="small",
        summary="A set for tests",
        licence="MIT",
        licence_note="",
        source_url="",
        commit="",
        citation="",
        how_to_get="",
        by_content=False,
        files=(
            *rows,
            file_of("map.json", b"{}", "map", url=url("map.json"), source_blob=git_blob(b"{}")),
            file_of("README.md", b"words", "note"),
            file_of("LICENSE", LICENCE, "licence", url=url("LICENSE"), source_blob=git_blob(LICENCE)),
        ),
    )
