"""The server of `pdrbench live`: what it receives from phones, and the page that it shows.

Each address begins with a token, and without it there is nothing. A request that is too large, comes too often or holds
something else is answered with the reason, and changes nothing.
"""

from __future__ import annotations

import asyncio
import contextlib
import hmac
import importlib.resources
import math
import time
from collections.abc import AsyncIterator
from typing import Any, Final

import msgspec
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from pdrbench.building import Building
from pdrbench.errors import PdrbenchError, plain_line
from pdrbench.report.pages import render
from pdrbench_formats.live import feeds
from pdrbench_formats.live.phone import Phone, Setup
from pdrbench_formats.replays.page import PACKAGE as REPLAYS
from pdrbench_formats.replays.page import Box, box_of, building_data
from pdrbench_formats.taskfile.files import read_plan_once, stamp
from pdrbench_formats.taskfile.schema import StartTable

PACKAGE: Final = "pdrbench_formats.live"
FRAME_S: Final = 0.2  # of the page, at most so often
POLL_S: Final = 0.1  # of phyphox
REPLY_S: Final = 1.0  # after which a phone is answered
MAX_PHONES: Final = 8
MAX_VIEWERS: Final = 8
MAX_BYTES_PER_S: Final = 4 * feeds.MAX_BYTES
MAX_REQUESTS_PER_S: Final = 400.0
NOWHERE_M: Final = (-40.0, -40.0, 40.0, 40.0)  # what is shown without a plan
HEADERS: Final = {
    "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",  # the token is part of the address
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}
_FILES: Final = {
    "live.js": (PACKAGE, "text/javascript"),
    "live.css": (PACKAGE, "text/css"),
    "replay.js": (REPLAYS, "text/javascript"),
}


class _Wish(msgspec.Struct, forbid_unknown_fields=True):
    """What a viewer asks for: a walk of a phone that begins here, or its end where there is no place."""

    device: str
    xy_m: tuple[float, float] | None = None
    level: int = 0
    heading_deg: float | None = None


class Allowance:
    """So much a second, and at once so much of one second."""

    def __init__(self, per_s: float) -> None:
        self._per_s, self._left, self._last_s = per_s, per_s, time.monotonic()

    def takes(self, amount: float) -> bool:
        """Whether that much is allowed now."""
        now_s = time.monotonic()
        self._left = min(self._per_s, self._left + (now_s - self._last_s) * self._per_s)
        self._last_s = now_s
        if amount > self._left:
            return False
        self._left -= amount
        return True


class Server:
    """Phones and those who look at them.

    Args:
        setup: What all phones share.
        token: That every address begins with.
        phyphox: Addresses of phones to be asked.
    """

    def __init__(self, setup: Setup, token: str, phyphox: tuple[str, ...] = ()) -> None:
        self._setup, self._token = setup, token
        self._feeds = [feeds.PhyphoxFeed(address) for address in phyphox]
        self.phones: dict[str, Phone] = {}
        self._bytes, self._requests = Allowance(MAX_BYTES_PER_S), Allowance(MAX_REQUESTS_PER_S)
        self._viewers: set[asyncio.Event] = set()
        self._playing: set[asyncio.Task[str] | None] = set()  # tasks that nobody refers to may vanish
        plan = setup.plan
        self._building: Building | None = None
        if plan is not None:
            self._building = read_plan_once(plan, "", "rooms", stamp(plan)).building
        self._box: Box = box_of(self._building, NOWHERE_M)
        self.app = Starlette(
            routes=[
                Route("/{token}/", self._page),
                Route("/{token}/plan", self._plan),
                Route("/{token}/push", self._push, methods=["POST"]),
                Route("/{token}/{file}", self._file),
                WebSocketRoute("/{token}/stream", self._stream),
                WebSocketRoute("/{token}/view", self._view),
            ],
            lifespan=self._lifespan,
        )
        self.app.router.redirect_slashes = False

    @contextlib.asynccontextmanager
    async def _lifespan(self, _: Starlette) -> AsyncIterator[None]:
        polls = [asyncio.create_task(self._poll(feed)) for feed in self._feeds]
        yield
        for poll in polls:
            poll.cancel()
        for phone in self.phones.values():
            await asyncio.to_thread(phone.end)

    def _knows(self, connection: Request | WebSocket) -> bool:
        return hmac.compare_digest(connection.path_params["token"].encode(), self._token.encode())

    async def _page(self, request: Request) -> Response:
        if not self._knows(request):
            return _refused(404, "not found")
        return _answer(render("live.html", package=PACKAGE, localizer=self._setup.localizer), "text/html")

    async def _file(self, request: Request) -> Response:
        package, kind = _FILES.get(request.path_params["file"], ("", ""))
        if not self._knows(request) or not kind:
            return _refused(404, "not found")
        file = importlib.resources.files(package) / "templates" / request.path_params["file"]
        return _answer(file.read_text(encoding="utf-8"), kind)

    async def _plan(self, request: Request) -> Response:
        if not self._knows(request):
            return _refused(404, "not found")
        return JSONResponse(building_data(self._building, self._box), headers=HEADERS)

    async def _push(self, request: Request) -> Response:
        """A push of Sensor Logger."""
        if not self._knows(request):
            return _refused(404, "not found")
        content = bytearray()
        async for part in request.stream():
            content += part
            if len(content) > feeds.MAX_BYTES:
                return _refused(413, f"a push holds at most {feeds.MAX_BYTES} bytes; send more often")
        if not self._allows(len(content)):
            return _refused(429, "too much, too often")
        try:
            push = feeds.decoded(bytes(content), feeds.Push)
            phone = self._phone(push.deviceId)
            why = await self._played(phone, push)
        except PdrbenchError as error:
            why = str(error)
        if why:
            return _refused(400, plain_line(why)[:300])
        return JSONResponse({"phone": phone.name, "state": phone.state}, headers=HEADERS)

    async def _stream(self, socket: WebSocket) -> None:
        """Messages `{"sensor": ..., "rows": [[t_s, ...], ...]}` of the phone `?device=NAME`; each is answered."""
        if not self._knows(socket):
            await socket.close()
            return
        await socket.accept()
        with contextlib.suppress(WebSocketDisconnect):
            while True:
                content = await _received(socket)
                why = "" if self._allows(len(content)) else "too much, too often"
                try:
                    if not why:
                        tables = feeds.packet_tables(feeds.decoded(content, feeds.Packet))
                        phone = self._phone(socket.query_params.get("device", "phone"))
                        why = await self._played(phone, tables)
                except PdrbenchError as error:
                    why = str(error)
                await socket.send_json({"error": plain_line(why)[:300]} if why else {"state": phone.state})

    async def _view(self, socket: WebSocket) -> None:
        """A page: frames of all phones whenever one has moved, at most five a second; and what is tapped."""
        if not self._knows(socket) or len(self._viewers) >= MAX_VIEWERS:
            await socket.close()
            return
        await socket.accept()
        moved = asyncio.Event()
        moved.set()
        self._viewers.add(moved)
        shows = asyncio.create_task(self._show(socket, moved))
        try:
            while True:
                content = await _received(socket)
                if self._allows(len(content)):
                    with contextlib.suppress(PdrbenchError):  # a page says nothing wrong
                        await self._fulfil(feeds.decoded(content, _Wish))
        except WebSocketDisconnect:
            pass
        finally:
            shows.cancel()
            self._viewers.discard(moved)

    async def _show(self, socket: WebSocket, moved: asyncio.Event) -> None:
        sent: dict[str, tuple[int, int]] = {}
        while True:
            await moved.wait()
            moved.clear()
            frames = []
            for device, phone in self.phones.items():
                walk, places = sent.get(device, (0, 0))
                frame = phone.frame(self._box, places if walk == phone.walk else 0)
                sent[device] = frame["walk"], frame["from"] + len(frame["trail"])
                frames.append({"device": device, **frame})
            await socket.send_json({"phones": frames})
            await asyncio.sleep(FRAME_S)

    async def _fulfil(self, wish: _Wish) -> None:
        phone = self.phones.get(wish.device)
        numbers = (*(wish.xy_m or ()), wish.heading_deg or 0.0)
        if phone is None or not all(math.isfinite(number) and abs(number) < 1e6 for number in numbers):
            return
        if wish.xy_m is None:
            await asyncio.to_thread(phone.end)
        elif wish.level in self._box.levels:
            start = StartTable(xy_m=wish.xy_m, level=wish.level, heading_deg=wish.heading_deg)
            await asyncio.to_thread(phone.start, start)
        self._notify()

    async def _poll(self, feed: feeds.PhyphoxFeed) -> None:
        phone = self._phone(f"phyphox {feed.address.partition('://')[2]}")
        while True:
            try:
                tables = await asyncio.to_thread(feed.tables)
                phone.why = "" if phone.state != "failed" else phone.why
                await self._played(phone, tables)
            except PdrbenchError as error:
                phone.why = str(error)
                await asyncio.sleep(10 * POLL_S)
                self._notify()
            await asyncio.sleep(POLL_S)

    async def _played(self, phone: Phone, packet: feeds.Push | feeds.Tables) -> str:
        """Plays a packet; a phone does not wait for a localizer that compiles. Why it was left out, as far as known."""
        playing = asyncio.create_task(asyncio.to_thread(phone.take, packet))
        self._playing.add(playing)
        playing.add_done_callback(self._notify)
        await asyncio.wait({playing}, timeout=REPLY_S)
        return playing.result() if playing.done() else ""

    def _phone(self, name: str) -> Phone:
        name = plain_line(name)[: feeds.MAX_NAME] or "phone"
        if name not in self.phones:
            if len(self.phones) >= MAX_PHONES:
                raise PdrbenchError(f"there are {MAX_PHONES} phones already; start another server")
            self.phones[name] = Phone(name, self._setup)
        return self.phones[name]

    def _allows(self, num_bytes: int) -> bool:
        return self._requests.takes(1.0) and self._bytes.takes(num_bytes)

    def _notify(self, played: asyncio.Task[str] | None = None) -> None:
        self._playing -= {played}
        for viewer in self._viewers:
            viewer.set()


async def _received(socket: WebSocket) -> bytes:
    """The next message, text or not."""
    message = await socket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect
    content: Any = message.get("bytes") or message.get("text") or ""
    return content.encode("utf-8", "replace") if isinstance(content, str) else content


def _answer(content: str, kind: str) -> Response:
    return Response(content, media_type=f"{kind}; charset=utf-8", headers=HEADERS)


def _refused(status: int, why: str) -> Response:
    return JSONResponse({"error": why}, status, headers=HEADERS)
