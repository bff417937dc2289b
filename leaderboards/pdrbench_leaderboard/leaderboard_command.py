"""`pdrbench leaderboard build|check|serve|verify|key`."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Final, Literal

import typer

from pdrbench.cli.options import Jobs, Scheduler
from pdrbench.cli.output import AsJson, answer_only, note, print_json, say
from pdrbench.errors import BundleError, ResultError

if TYPE_CHECKING:
    from http.server import ThreadingHTTPServer

app = typer.Typer(no_args_is_help=True, help="Build, check, show and verify the leaderboards.")
keys = typer.Typer(no_args_is_help=True, help="For maintainers: keys that sign verifications.")
app.add_typer(keys, name="key")

HOST: Final = "127.0.0.1"  # reachable from this machine only
Root = Annotated[Path, typer.Option(metavar="DIR", help="Folder that holds <env>/<localizer>/.")]


@app.command("run")
def run(
    board: Annotated[list[str] | None, typer.Argument(metavar="[BOARD]...", show_default="all")] = None,
    localizer: Annotated[
        list[str] | None,
        typer.Option(
            metavar="LOCALIZER",
            help="Registered id, path/to/file.py:Class or path/to/folder; repeat for several.",
            show_default="every entry, and every localizer of pdrbench",
        ),
    ] = None,
    card: Annotated[
        Path | None,
        typer.Option(metavar="FILE", dir_okay=False, help="card.toml of the localizer, where it brings none."),
    ] = None,
    round_number: Annotated[
        int | None,
        typer.Option("--round", min=0, metavar="N", help="Held-out walks of which round.", show_default="the newest"),
    ] = None,
    secret: Annotated[
        Path | None,
        typer.Option(metavar="FILE", dir_okay=False, help="Secret of the round, where it is not published."),
    ] = None,
    part: Annotated[
        Literal["public", "held-out"] | None,
        typer.Option(metavar="PART", help="Only public or only held-out walks.", show_default="both"),
    ] = None,
    root: Root = Path("leaderboards"),
    work: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR", file_okay=False, help="Keep drawn walks and answers here.", show_default="in the cache"
        ),
    ] = None,
    jobs: Jobs = 1,
    scheduler: Scheduler = None,
    isolation: Annotated[
        Literal["process", "confined", "none"] | None,
        typer.Option(
            metavar="KIND", help="What localizers run in.", show_default="process, confined where not registered"
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Play every entry on every board, public and held-out walks; what is done already is skipped."""
    with answer_only(as_json):
        from pdrbench.datasets import cache_folder
        from pdrbench_leaderboard.boards import PARTS, chosen_boards, find_round
        from pdrbench_leaderboard.run import Settings
        from pdrbench_leaderboard.run import run as run_boards

        of_round = find_round(round_number)
        settings = Settings(
            root=root,
            work=work or cache_folder() / "boards" / f"round-{of_round.number}",
            round=of_round,
            secret=None if secret is None else read_secret(secret),
            jobs=jobs,
            scheduler=scheduler,
            parts=PARTS if part is None else (part,),
            isolation=isolation,
            progress=True,
        )
        rows = []
        for outcome in run_boards(chosen_boards(board or ()), localizer or (), settings, card=card):
            rows.append(dataclasses.asdict(outcome))
            said = (
                outcome.why
                or f"{len(outcome.played)} played, {len(outcome.kept)} done before, {len(outcome.declined)} declined"
            )
            note(f"{outcome.board}  {outcome.env}, {outcome.part}: {said}")
    if as_json:
        print_json({"parts": rows})
    else:
        say(f"{root} holds what came of it; `pdrbench leaderboard build` makes tables and pages")


def read_secret(path: Path) -> str:
    """The secret in a file."""
    try:
        return path.read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise BundleError(f"cannot read the secret in {path}: {type(error).__name__}") from None


@app.command("build")
def build(
    root: Root = Path("leaderboards"),
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the site.")] = Path("site"),
    jobs: Jobs = 1,
    as_json: AsJson = False,
) -> None:
    """Score every entry, write TABLE.md of each environment and the static site; again only what has changed."""
    with answer_only(as_json):
        from pdrbench.datasets import cache_folder
        from pdrbench_leaderboard.collection import read_boards, write_tables
        from pdrbench_leaderboard.site import write_site

        boards, absent = read_boards(root, jobs, lambda env: note(f"scored {env}"), cache_folder() / "scores")
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


@app.command("verify")
def verify(
    secret: Annotated[
        list[Path],
        typer.Option(metavar="FILE", dir_okay=False, help="Secret behind held-out walks; repeat for several."),
    ],
    key: Annotated[Path, typer.Option(metavar="FILE", dir_okay=False, help="Private key that signs what was found.")],
    root: Root = Path("leaderboards"),
    env: Annotated[
        list[str] | None, typer.Option(metavar="ENV", help="Only this environment; repeat for several.")
    ] = None,
    results: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", file_okay=False, help="Keep every walk here, and continue what was left here."),
    ] = None,
    jobs: Jobs = 1,
    as_json: AsJson = False,
) -> None:
    """For maintainers: run every entry again that is not verified in this round, and sign what came of it.

    Exit 1 where an entry does not give what was sent. Entries that are verified already are left as they are.
    """
    with answer_only(as_json):
        from pdrbench.cli.options import make_folder
        from pdrbench_leaderboard.collection import verify_boards
        from pdrbench_leaderboard.submit_command import read_secret, verified_facts, verified_line

        if results is not None:
            make_folder(results)
        rows: list[dict[str, Any]] = []
        for outcome in verify_boards(root, [read_secret(path) for path in secret], key, env or (), results, jobs):
            facts = {"name": outcome.name, "why": outcome.why, "is_left_out": outcome.is_left_out}
            facts |= {} if outcome.found is None else verified_facts(outcome.found)
            rows.append(facts)
            if outcome.why:
                word = "left out" if outcome.is_left_out else "REFUSED"
                note(f"{outcome.number} of {outcome.of}  {word}  {outcome.name}: {outcome.why}")
            else:
                note(f"{outcome.number} of {outcome.of}  {outcome.name}  {verified_line(facts)}")
    refused = sum(bool(row["why"]) and not row["is_left_out"] for row in rows)
    left_out = sum(row["is_left_out"] for row in rows)
    if as_json:
        print_json({"entries": rows})
    else:
        say(f"{len(rows) - refused - left_out} verified, {refused} refused, {left_out} left out of {len(rows)} entries")
    if refused:
        raise typer.Exit(1)


@keys.command("new")
def new_key(
    path: Annotated[
        Path, typer.Argument(metavar="FILE", help="New file for the private key, outside of any repository.")
    ],
    owner: Annotated[str, typer.Option(metavar="NAME", help="Who signs with it.")] = "maintainer",
) -> None:
    """Make a private key that only you can read, and print what goes into keys.toml."""
    import datetime

    from pdrbench_leaderboard.signing import new_key as make_key

    say(make_key(path, owner, datetime.datetime.now(datetime.UTC).date()).rstrip("\n"))


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
