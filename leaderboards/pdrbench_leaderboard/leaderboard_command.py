"""`pdrbench leaderboard new|run|draw|play|score|build|check|key|round`."""

from __future__ import annotations

import contextlib
import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from pdrbench.cli.output import AsJson, answer_only, print_json, say
from pdrbench.errors import BundleError
from pdrbench_leaderboard import rounds_command
from pdrbench_leaderboard.steps_command import ROOT, KeptWork, Root, add_step_commands
from pdrbench_leaderboard.submit_command import tell_findings

app = typer.Typer(no_args_is_help=True, help="Play, build, check and show the boards.")
keys = typer.Typer(no_args_is_help=True, help="For maintainers: keys that sign verifications.")
app.add_typer(keys, name="key")
app.add_typer(rounds_command.app, name="round")
add_step_commands(app)


@app.command("new")
def new(
    folder: Annotated[Path, typer.Argument(metavar="DIR", file_okay=False, help="New folder of the competition.")],
    env: Annotated[list[str], typer.Option(metavar="ENV", help="Id or task folder; repeat for several.")],
    title: Annotated[str, typer.Option(metavar="TEXT", show_default="name of the folder")] = "",
    private: Annotated[
        Path | None,
        typer.Option(metavar="DIR", file_okay=False, help="New folder of secret and key.", show_default="DIR-private"),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Lay out a competition of one's own: boards, rounds, keys, and a workflow that publishes the pages."""
    with answer_only(as_json):
        from pdrbench_leaderboard.competition import new_competition

        apart = private or folder.absolute().with_name(f"{folder.absolute().name}-private")
        written = new_competition(folder, env, title or folder.absolute().name, apart)
    if as_json:
        print_json({"files": written, "private": apart})
        return
    say(f"{folder}: {', '.join(path.name for path in written)}")
    say(f"{apart} holds the master secret and the key that signs: keep it with two people, and never publish it")


@app.command("build")
def build(
    root: Root = ROOT,
    out: Annotated[Path, typer.Option(metavar="DIR", help="Folder for the site.")] = Path("site"),
    as_json: AsJson = False,
) -> None:
    """Write the table of each board, and the static site."""
    with answer_only(as_json):
        from pdrbench.evaluation.store import make_folder, write_whole
        from pdrbench_leaderboard import table
        from pdrbench_leaderboard.boards import boards
        from pdrbench_leaderboard.checking import separability
        from pdrbench_leaderboard.site import write_site
        from pdrbench_leaderboard.standings import read_tables

        tables = {board: read_tables(root, board) for board in boards(root).values()}
        written = []
        for board, of in tables.items():
            written.append(make_folder(root / board.name) / table.FILE_NAME)
            write_whole(written[-1], table.page(board, of).encode())
        pages = write_site(tables, out)
        rows = [dataclasses.asdict(separability(board, of)) for board, of in tables.items()]
    if as_json:
        print_json({"boards": rows, "tables": written, "site": out, "files": len(pages)})
        return
    for row in rows:
        say(f"{row['board']}: {row['entries']} entries, {row['significant']} of {row['pairs']} pairs separated")
    say(f"open {out / 'index.html'}")


@app.command("check")
def check(root: Root = ROOT, as_json: AsJson = False) -> None:
    """Check that entries are whole, that scores come out of answers, and that tables are those of the entries."""
    with answer_only(as_json):
        from pdrbench_leaderboard.boards import boards
        from pdrbench_leaderboard.checking import check_board, separability
        from pdrbench_leaderboard.standings import read_tables

        checks, rows = [], []
        for board in boards(root).values():
            checks += list(check_board(root, board))
            with contextlib.suppress(BundleError):  # a check has said so
                rows.append(separability(board, read_tables(root, board)))
    if as_json:
        print_json(
            {
                "checks": [{"name": c.name, "pass": c.passed, "why": c.why} for c in checks],
                "boards": [dataclasses.asdict(row) for row in rows],
            }
        )
    else:
        for found in checks:
            if found.why:
                say(f"{'note' if found.passed else 'FAIL'}  {found.name}: {found.why}")
        for row in rows:
            say(f"{row.board}: {row.entries} entries, {row.significant} of {row.pairs} pairs separated")
        say(f"{sum(found.passed for found in checks)} of {len(checks)} checks passed")
    if not all(found.passed for found in checks):
        raise typer.Exit(1)


@app.command("compare")
def compare(
    one: Annotated[Path, typer.Argument(metavar="DIR", file_okay=False, help="<root>/<board>/<entry> of one run.")],
    other: Annotated[Path, typer.Argument(metavar="DIR", file_okay=False, help="That of another run.")],
    as_json: AsJson = False,
) -> None:
    """Compare two runs of an entry, its sender's and a maintainer's, by their scores; exit 1 where they differ."""
    with answer_only(as_json):
        from pdrbench_leaderboard.checking import compare_entries

        findings = compare_entries(one, other)
    tell_findings(findings, as_json=as_json)


@app.command("release")
def release(
    entry: Annotated[Path, typer.Argument(metavar="DIR", file_okay=False, help="<root>/<board>/<entry>.")],
    key: Annotated[Path, typer.Option(metavar="FILE", dir_okay=False, help="Private key that signs it.")],
    work: KeptWork = None,
) -> None:
    """Sign an entry that was held, once a person has read its source: it ranks from then on."""
    from pdrbench_leaderboard.boards import find_round
    from pdrbench_leaderboard.record import held, read_entry, sign_entry
    from pdrbench_leaderboard.run import Settings, is_ours
    from pdrbench_leaderboard.signing import check_listed

    record, _ = read_entry(entry)
    root = entry.absolute().parents[1]
    of_round = find_round(max((of.round for of in record.parts), default=0), root)
    check_listed(key, root)
    if not is_ours(entry.absolute(), Settings(root, work or Settings.work_of(of_round), of_round, key=key)):
        raise BundleError(
            f"{entry} was written, but not by this host: play it, or name the folder of its run with --work"
        )
    sign_entry(entry, key)
    say(f"{record.name} on {record.board} is verified{f'; it was held: {why}' if (why := held(record)) else ''}")


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
