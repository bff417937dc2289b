"""`pdrbench leaderboard round new|end|rotate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

from pdrbench.cli.output import note, say
from pdrbench_leaderboard.steps_command import ROOT, Root

LOST_MASTER: Final = (
    "keep the master secret with two people: without it no entry can be played in an open round, and its walks "
    "cannot be published; what is verified keeps its rank"
)
app = typer.Typer(no_args_is_help=True, help="For maintainers: rounds of held-out walks.")

Master = Annotated[Path, typer.Option(metavar="FILE", dir_okay=False, help="Master secret, of all rounds.")]


@app.command("new")
def new(master: Master, root: Root = ROOT) -> None:
    """Begin the next round: its number, and what is published of its secret, before there are submissions."""
    from pdrbench_leaderboard.boards import boards_file, read_secret, rounds
    from pdrbench_leaderboard.rounds import begin_round

    number, digest = begin_round(boards_file(root), list(rounds(root)), read_secret(master))
    say(f"round {number}: {digest}")
    note(LOST_MASTER)


@app.command("end")
def end(number: Annotated[int, typer.Argument(metavar="N", min=0)], master: Master, root: Root = ROOT) -> None:
    """Publish the secret of a round, so that any user can play its held-out walks."""
    from pdrbench_leaderboard.boards import boards_file, read_secret
    from pdrbench_leaderboard.rounds import end_round

    say(f"round {number} is over: {end_round(boards_file(root), number, read_secret(master))}")


@app.command("rotate")
def rotate(master: Master, root: Root = ROOT) -> None:
    """End the newest round and begin the next; verified entries keep their ranks until each has been played again."""
    from pdrbench_leaderboard.boards import boards_file, find_round, read_secret, rounds
    from pdrbench_leaderboard.rounds import begin_round, end_round

    secret = read_secret(master)
    before, place, known = find_round(None, root), boards_file(root), list(rounds(root))
    if not before.secret:
        say(f"round {before.number} is over: {end_round(place, before.number, secret)}")
    number, digest = begin_round(place, known, secret)
    say(f"round {number}: {digest}")
    note("ranks stay those of the round before until `pdrbench leaderboard run` has played every entry again")
