"""`pdrbench check env|localizer NAME`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from pdrbench.cli.options import LOCALIZER_HELP, Confined, complete_env, complete_localizer
from pdrbench.cli.output import AsJson, answer_only, note, print_json, say, verdict
from pdrbench.cli.ready import check_localizer_exists

if TYPE_CHECKING:
    from pdrbench.gym import Check

app = typer.Typer(no_args_is_help=True, help="Check an environment or a localizer against the rules.")


@app.command("env")
def env(
    name: Annotated[str, typer.Argument(metavar="ENV", autocompletion=complete_env, help="Registered id.")],
    as_json: AsJson = False,
) -> None:
    """Check an environment; exit 1 where a check fails."""
    with answer_only(as_json):
        from pdrbench.registry import make_task

        make_task(name)  # what is not registered or does not load is an error, not a failed check
        from pdrbench.gym import check_task

        note(f"checking {name}, some 5 s")
        checks = check_task(name)
    _print_checks(checks, as_json)


@app.command("localizer")
def localizer(
    name: Annotated[str, typer.Argument(metavar="LOCALIZER", autocompletion=complete_localizer, help=LOCALIZER_HELP)],
    env: Annotated[
        str | None,
        typer.Option(
            metavar="ENV",
            autocompletion=complete_env,
            help="Environment to check it on.",
            show_default="the first that suits it",
        ),
    ] = None,
    confined: Confined = False,
    as_json: AsJson = False,
) -> None:
    """Check a localizer; exit 1 where a check fails."""
    with answer_only(as_json):
        from pdrbench.cli.process_check import check_in_process

        kind: Literal["process", "confined"] = "confined" if confined else "process"
        check_localizer_exists(name, kind)
        note(f"checking {name}, some 10 s; 20 s where what it calls has to be compiled")
        checks = check_in_process(name, env, kind)
    _print_checks(checks, as_json)


def _print_checks(checks: Sequence[Check], as_json: bool) -> None:
    if as_json:
        print_json({"checks": [{"name": c.name, "pass": c.passed, "why": c.why} for c in checks]})
    else:
        for check in checks:
            say(verdict(check.passed, check.name, check.why))
        failed = sum(not check.passed for check in checks)
        say(f"{len(checks) - failed} of {len(checks)} checks passed")
    if not all(check.passed for check in checks):
        raise typer.Exit(1)
