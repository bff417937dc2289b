"""`pdrbench leaderboard build|check|serve`."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import typer

from pdrbench.cli.options import Jobs
from pdrbench.cli.output import AsJson, answer_only, note, print_json, say
from pdrbench.errors import ResultError

if TYPE_CHECKING:
    from http.server import ThreadingHTTPServer

app = typer.Typer(no_args_is_help=True, help="Build, check and show the leaderboards.")

HOST: Final = "127.0.0.1"  # reachable from this machine only
Root = Annotated[Path, typer.Option(metavar="DIR", help="Folder that holds <env>/<localizer>/.")]


@app.command("build")
def build(
    root: Root = Path("leaderboards"),
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the site.")] = Path("site"),
    jobs: Jobs = 1,
    as_json: AsJson = False,
) -> None:
    """Score every entry, write TABLE.md of each environment and the static site."""
    with answer_only(as_json):
        from pdrbench_leaderboard.collection import read_boards, write_tables
        from pdrbench_leaderboard.site import write_site

        boards, absent = read_boards(root, jobs, lambda env: note(f"scored {env}"))
        tables = write_tables(boards, root)
        pages = write_site(boards, out, jobs)
    for env, why in absent.items():
        note(f"left out {env}: {why}")
    if as_json:
        rows = [
            {"env": board.task.id, "entries": len(board), "first": board.ranked[0].name if board.ranked else None}
            for board in boards
        ]
        print_json({"boards": rows, "absent": absent, "tables": tables, "site": out, "files": len(pages)})
    else:
        entries = sum(len(board) for board in boards)
        say(f"{entries} entries, {len(boards)} leaderboards; open {out / 'index.html'}")


@app.command("check")
def check(root: Root = Path("leaderboards"), jobs: Jobs = 1, as_json: AsJson = False) -> None:
    """Check that every score recomputes from its estimates; exit 1 where one does not, naming the entry."""
    with answer_only(as_json):
        from pdrbench_leaderboard.collection import check_boards

        checks = list(check_boards(root, jobs))
    if as_json:
        rows = [{"name": c.name, "why": c.why, "has_other_code": c.is_flag, "pass": c.passed} for c in checks]
        print_json({"checks": rows})
    else:
        for found in checks:
            if found.why:
                say(f"{'note' if found.passed else 'FAIL'}  {found.name}: {found.why}")
        changed = sum(found.is_flag for found in checks)
        if changed:
            say(f"note  {changed} entries were packed with other code; that refuses none, only estimates decide")
        say(f"{sum(found.passed for found in checks)} of {len(checks)} checks passed")
    if not all(found.passed for found in checks):
        raise typer.Exit(1)


@app.command("serve")
def serve(
    site: Annotated[Path, typer.Argument(metavar="DIR", help="What `build` wrote.")] = Path("site"),
    port: Annotated[int, typer.Option(min=0, max=65_535, metavar="N", help="0 takes a free one.")] = 8000,
) -> None:
    """Show the site on this machine only, until Ctrl-C."""
    server = make_server(site, port)
    note(f"http://{HOST}:{server.server_port}/ (Ctrl-C ends)")
    with server:
        server.serve_forever()


def make_server(site: Path, port: int) -> ThreadingHTTPServer:
    """A server of a folder that listens on this machine alone.

    Raises:
        ResultError: The folder holds no site, or the port is taken.
    """
    from functools import partial
    from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer

    if not (site / "index.html").is_file():
        raise ResultError(f"no site in {site}; `pdrbench leaderboard build --out {site}` writes it")
    try:
        return ThreadingHTTPServer((HOST, port), partial(SimpleHTTPRequestHandler, directory=str(site)))
    except OSError as error:
        raise ResultError(f"cannot listen on port {port}: {error.strerror}; choose another with --port") from error
