"""The command line: one file per command; each prints for people, or JSON with `--json`."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from pdrbench.cli import check as checking
from pdrbench.cli import data
from pdrbench.cli import leaderboard as leaderboards
from pdrbench.cli import list as listing
from pdrbench.cli import submit as submitting
from pdrbench.cli.bench import bench as bench_command
from pdrbench.cli.bench import warm_up as warm_up_command
from pdrbench.cli.compare import compare as compare_command
from pdrbench.cli.convert import convert as convert_command
from pdrbench.cli.error_model import error_model as error_model_command
from pdrbench.cli.inspect import inspect as inspect_command
from pdrbench.cli.output import note
from pdrbench.cli.plot import plot as plot_command
from pdrbench.cli.replay import replay as replay_command
from pdrbench.cli.reproduce import reproduce as reproduce_command
from pdrbench.cli.run import run as run_command
from pdrbench.cli.validate_sim import validate_sim as validate_sim_command
from pdrbench.errors import PdrbenchError

INTERRUPTED = 130  # 128 + SIGINT, as shells count

app = typer.Typer(
    name="pdrbench",
    help="The benchmark for indoor pedestrian localisation.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)
app.add_typer(listing.app, name="list", help="List what is registered.")
app.command("run")(run_command)
app.command("compare")(compare_command)
app.command("reproduce")(reproduce_command)
app.add_typer(checking.app, name="check", help="Check an environment or a localizer against the rules.")
app.add_typer(submitting.app, name="submit", help="Pack, check and verify a submission.")
app.add_typer(data.app, name="data", help="List, fetch and verify recorded datasets.")
app.add_typer(leaderboards.app, name="leaderboard", help="Build, check and show the leaderboards.")
app.command("inspect")(inspect_command)
app.command("convert")(convert_command)
app.command("plot")(plot_command)
app.command("replay")(replay_command)
app.command("error-model")(error_model_command)
app.command("validate-sim")(validate_sim_command)
app.command("bench")(bench_command)
app.command("warm-up")(warm_up_command)


def _print_version(wanted: bool) -> None:
    if wanted:
        from pdrbench import __version__

        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """The benchmark for indoor pedestrian localisation."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command line and exits: 0, 1 for an error that a user can mend, 2 for wrong usage, 130 for Ctrl-C.

    Args:
        arguments: Without the program's name; those of the process where None.
    """
    sys.path.append(str(Path.cwd()))  # so that package.module:Class finds what lies here; behind everything installed
    try:
        status = _run(arguments)
        sys.stdout.flush()
    except BrokenPipeError:  # the reader, such as `head`, has left: nobody is there to be told
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 1
    sys.exit(status)


def _run(arguments: Sequence[str] | None) -> int:
    try:
        app(args=None if arguments is None else [*arguments], prog_name="pdrbench")
    except SystemExit as stop:
        status = stop.code if isinstance(stop.code, int) else 1
    except PdrbenchError as error:
        note(f"pdrbench: {error}")
        return 1
    except KeyboardInterrupt:
        status = INTERRUPTED
    else:
        status = 0
    if status == INTERRUPTED:
        note("pdrbench: interrupted")
    return status
