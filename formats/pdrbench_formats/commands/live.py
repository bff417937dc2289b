"""`pdrbench live`: a phone streams, a page shows where it is."""

from __future__ import annotations

import contextlib
import importlib.util
import secrets
import socket
from pathlib import Path
from typing import Annotated, Final

import typer

from pdrbench.cli.options import LOCALIZER_HELP, make_folder
from pdrbench.cli.output import note, say
from pdrbench.errors import PdrbenchError
from pdrbench.session import WAIT_S

LOOPBACK: Final = "127.0.0.1"
TAP: Final = "tap"
NEEDED: Final = ("starlette", "uvicorn", "websockets", "segno")
MAX_CONNECTIONS: Final = 64
START_HELP: Final = "Where each walk begins, in metres of the plan and degrees from its x axis; `tap`: on the page."
PHYPHOX_HELP: Final = "Address of a phone whose phyphox allows remote access. Repeatable."
HOST_HELP: Final = "Address to listen at; 0.0.0.0 lets phones of the network in."
WAIT_HELP: Final = "How long an observation waits for rows that are late."


def live(
    plan: Annotated[
        Path | None, typer.Option("--map", metavar="PLAN", help="Plan of the building.", show_default="none")
    ] = None,
    survey: Annotated[
        list[Path] | None, typer.Option(metavar="PATH", help="Radio survey. Repeatable.", show_default="none")
    ] = None,
    localizer: Annotated[str, typer.Option(metavar="LOCALIZER", help=LOCALIZER_HELP)] = "fusion",
    start: Annotated[str, typer.Option(metavar="X,Y,LEVEL,HEADING", help=START_HELP)] = TAP,
    mounting: Annotated[str, typer.Option(metavar="WHERE", help="Where phones are carried: hand, pocket.")] = "hand",
    phyphox: Annotated[
        list[str] | None, typer.Option(metavar="ADDRESS", help=PHYPHOX_HELP, show_default="none")
    ] = None,
    out: Annotated[
        Path, typer.Option(metavar="FOLDER", file_okay=False, help="Walks are recorded here, each as a task folder.")
    ] = Path("pdrbench-live"),
    host: Annotated[str, typer.Option(metavar="ADDRESS", help=HOST_HELP)] = LOOPBACK,
    port: Annotated[int, typer.Option(min=0, max=65535, metavar="N", help="0: any that is free.")] = 8000,
    wait: Annotated[float, typer.Option(min=0.0, max=10.0, metavar="SECONDS", help=WAIT_HELP)] = WAIT_S,
) -> None:
    """Show where a phone is while it streams its sensors; prints the address of the page."""
    missing = [name for name in NEEDED if importlib.util.find_spec(name) is None]
    if missing:
        raise PdrbenchError(f'live needs {", ".join(missing)}: pip install "pdrbench[live]"')
    import segno
    import uvicorn

    from pdrbench.registry import make_localizer
    from pdrbench_formats.live.feeds import MAX_BYTES
    from pdrbench_formats.live.phone import Setup
    from pdrbench_formats.live.server import Server
    from pdrbench_formats.taskfile.schema import StartTable

    make_localizer(localizer)  # a name that is unknown is said now
    token = secrets.token_urlsafe(12)
    begin = None if start == TAP else StartTable.of_text(start)
    setup = Setup(localizer, plan, tuple(survey or ()), begin, mounting, make_folder(out), wait)
    server = Server(setup, token, tuple(phyphox or ()))
    try:
        listener = socket.create_server((host, port), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
    except OSError as error:
        raise PdrbenchError(f"cannot listen at {host}, port {port}: {error.strerror}; choose another --port") from error
    address = f"http://{_seen_as(host)}:{listener.getsockname()[1]}/{token}/"
    say(f"page: {address}")
    say(f"Sensor Logger, HTTP push to: {address}push")
    say(f"websocket: {address.replace('http', 'ws', 1)}stream?device=NAME")
    if host == LOOPBACK:
        note(f"only this machine reaches {LOOPBACK}; phones: --host 0.0.0.0, in a network that you trust")
    segno.make(address).terminal(compact=True)
    config = uvicorn.Config(
        server.app,
        log_level="error",
        access_log=False,
        ws_max_size=MAX_BYTES,
        limit_concurrency=MAX_CONNECTIONS,
        server_header=False,
    )
    with contextlib.suppress(KeyboardInterrupt):  # which uvicorn passes on when all is ended
        uvicorn.Server(config).run([listener])
    for phone in server.phones.values():
        for folder in phone.folders:
            say(f"recorded in {folder}: pdrbench try {folder} --localizer {localizer}")


def _seen_as(host: str) -> str:
    """The address under which others reach this machine."""
    if host not in ("0.0.0.0", "::"):
        return f"[{host}]" if ":" in host else host
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:  # sends nothing: asks for the way to the network
        try:
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()
