"""The command line: one file per command; each prints for people, or JSON with `--json`."""

from __future__ import annotations

import functools
import importlib.util
import io
import os
import re
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from pdrbench.cli.output import note, say
from pdrbench.errors import PdrbenchError
from pdrbench.registry import COMMANDS_GROUP, PluginError, broken, entries

# By name: `module:attribute`, a function or a typer application. Other packages register theirs in the same way.
COMMANDS = {
    "list": "pdrbench.cli.list:app",
    "run": "pdrbench.cli.run:run",
    "compare": "pdrbench.cli.compare:compare",
    "check": "pdrbench.cli.check:app",
    "data": "pdrbench.cli.data:app",
    "plot": "pdrbench.cli.plot:plot",
}
OF_THE_LAB = ("reproduce", "bench", "warm-up", "validate-sim", "error-model", "tune")  # which it registers itself
INTERRUPTED = 130  # 128 + SIGINT, as shells count

ANY_ARGUMENTS: dict[str, Any] = {"allow_extra_args": True, "ignore_unknown_options": True, "help_option_names": []}

app = typer.Typer(
    name="pdrbench",
    help="The benchmark for indoor pedestrian localisation.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
)


def _print_version(wanted: bool) -> None:
    if wanted:
        from pdrbench import __version__

        say(__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    """The benchmark for indoor pedestrian localisation."""


@functools.cache
def _add_commands() -> None:
    """Adds every registered command; one that does not load is named on stderr and left out."""
    for name, entry in entries(COMMANDS_GROUP).items():
        try:
            command = entry.load()
        except PluginError as error:
            note(f"pdrbench: left out: {error}")
            continue
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=name)
        else:
            app.command(name)(command)
    for name in OF_THE_LAB:
        if name not in entries(COMMANDS_GROUP):
            app.command(name, help="Comes with the laboratory.", context_settings=ANY_ARGUMENTS)(_stub(name))
    for name, why in broken(COMMANDS_GROUP).items():
        note(f"pdrbench: left out: {name}: {why}")


def _stub(name: str) -> Callable[[], None]:
    """A command that says how to get the one that is asked for."""

    def refer() -> None:
        raise PdrbenchError(
            f"`pdrbench {name}` comes with the laboratory, which is not installed: in a checkout of pdrbench, "
            f"`pip install -e lab`"
        )

    return refer


def main(arguments: Sequence[str] | None = None) -> None:
    """Runs the command line and exits: 0, 1 for an error that a user can fix, 2 for wrong usage, 130 for Ctrl-C.

    Args:
        arguments: Without the program's name; those of the process where None.
    """
    if importlib.util.find_spec("numba") is None:
        note("pdrbench: numba, which compiles what most localizers and simulators call, is missing: pip install numba")
        sys.exit(1)
    if (here := str(Path.cwd())) not in sys.path:
        sys.path.append(here)  # so that package.module:Class finds what lies here; behind everything installed
    _add_commands()
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # a console of Windows may lack what a name or a table has
    try:
        status = _run(arguments)
        sys.stdout.flush()
    except BrokenPipeError:  # the reading end, such as `head`, has exited
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        status = 1
    sys.exit(status)


def _run(arguments: Sequence[str] | None) -> int:
    try:
        app(args=None if arguments is None else [*arguments], prog_name="pdrbench")
    except SystemExit as stop:
        status = stop.code if isinstance(stop.code, int) else 1
    except PdrbenchError as error:
        note(re.sub(r"\n(?=\S)", "\n    ", f"pdrbench: {error}"))  # no line of it looks like another error
        return 1
    except KeyboardInterrupt:
        status = INTERRUPTED
    else:
        status = 0
    if status == INTERRUPTED:
        note("pdrbench: interrupted")
    return status
