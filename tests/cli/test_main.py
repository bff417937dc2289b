"""Exit codes, standard output and standard error."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
import typer
from typer.testing import CliRunner

from pdrbench import __version__, cli
from pdrbench.cli import data
from pdrbench.cli.output import print_json
from pdrbench.errors import PdrbenchError

PROGRAM = [sys.executable, "-c", "from pdrbench.cli import main; main()"]


def test_version_help_and_the_nearest_command(command: Any) -> None:
    assert command("--version").out == f"{__version__}\n"
    assert command("compare", "--help").code == 0
    assert "Did you mean 'compare'" in command("compere").err


@pytest.mark.parametrize(
    "arguments",
    [
        ["frob"],
        ["compare", "--frob"],
        ["run", "stay"],
        ["compare", "--walks", "0"],
        ["compare", "--jobs", "many"],
        ["plot", "absent.result"],
        ["data", "verify", "--path", "/"],
        ["list", "frobs"],
    ],
)
def test_wrong_usage_exits_2_and_leaves_standard_output_empty(arguments: list[str], command: Any) -> None:
    outcome = command(*arguments)
    assert (outcome.code, outcome.out) == (2, "")
    assert "Error" in outcome.err


@pytest.mark.parametrize(
    ("arguments", "near"),
    [
        (["run", "dead_reconing", "CampusStride-v1"], "did you mean 'dead_reckoning'?"),
        (["run", "stay", "CampsStride-v0"], "did you mean 'CampusStride-v1'?"),
        (["compare", "--env", "MallFone-v0"], "did you mean 'MallPhone-v2'?"),
        (["compare", "--localizer", "sty"], "did you mean 'stay'?"),
        (["check", "env", "CampusStrid-v0"], "did you mean 'CampusStride-v1'?"),
        (["check", "localizer", "sray"], "did you mean 'stay'?"),
        (["data", "verify", "ilc2"], "did you mean 'ilc20'?"),
        (["data", "fetch", "ilc2"], "did you mean 'ilc20'?"),
    ],
)
@pytest.mark.parametrize("as_json", [False, True])
def test_an_unknown_name_is_one_line_with_the_nearest_name(
    arguments: list[str], near: str, as_json: bool, command: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    outcome = command(*arguments, *(["--json"] if as_json else []))
    assert (outcome.code, outcome.out) == (1, "")
    (line,) = [line for line in outcome.err.splitlines() if near in line]
    assert line.startswith("pdrbench: ")
    assert "Traceback" not in outcome.err


def test_a_bug_shows_its_traceback(monkeypatch: pytest.MonkeyPatch) -> None:
    from pdrbench.cli import main

    monkeypatch.setattr(data, "_available", lambda: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        main(["data", "verify"])


def test_ctrl_c_exits_130_without_traceback(command: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt() -> list[str]:
        raise KeyboardInterrupt

    monkeypatch.setattr(data, "_available", interrupt)
    outcome = command("data", "verify")
    assert (outcome.code, outcome.out, outcome.err) == (130, "", "pdrbench: interrupted\n")


SLOW = """
import pathlib
import time

class Slow:
    def reset(self, briefing, rng):
        print("waiting", flush=True)
        pathlib.Path(BEGUN).touch()

    def step(self, observation):
        time.sleep(30)
"""


def heed_interrupts() -> None:
    """Restores the signals that a shell ignores in the children of a job with "&"."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.parametrize("reaches_children", [True, False])
def test_a_signal_in_the_middle_of_a_walk_does_the_same(reaches_children: bool, tmp_path: Path) -> None:
    begun = tmp_path / "begun"
    (tmp_path / "slow.py").write_text(SLOW.replace("BEGUN", repr(str(begun))))
    process = subprocess.Popen(
        [
            *PROGRAM,
            *("run", f"{tmp_path / 'slow.py'}:Slow", "CampusStride-v1", "--walks", "1", "--json"),
            *("--isolation", "process"),  # which may write beside its scratch folder
        ],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=heed_interrupts,
    )
    while not begun.exists():
        assert process.poll() is None
        time.sleep(0.05)
    if reaches_children:  # as a terminal's Ctrl-C does
        os.killpg(process.pid, signal.SIGINT)
    else:
        process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=25)
    assert (process.returncode, out) == (130, "")  # what a localizer prints does not reach the JSON
    assert err.endswith("pdrbench: interrupted\n")
    assert "Traceback" not in err


def test_a_reader_that_leaves_is_no_error() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    process = subprocess.run(
        [*PROGRAM, "list", "datasets", "--json"], stdout=writing, stderr=subprocess.PIPE, text=True, timeout=60
    )
    os.close(writing)
    assert (process.returncode, process.stderr) == (1, "")


def test_json_has_no_nan(capsys: pytest.CaptureFixture[str]) -> None:
    print_json({"a": float("nan"), "b": [float("-inf"), 1.5], "c": Path("x"), 3: ("d", None, True)})
    out = " ".join(capsys.readouterr().out.split())
    assert out == '{ "a": null, "b": [ null, 1.5 ], "c": "x", "3": [ "d", null, true ] }'


def test_help_is_quick_because_little_is_imported() -> None:
    code = """import contextlib, sys; from pdrbench.cli import main
with contextlib.suppress(SystemExit):
    main(["--help"])
heavy = {"numba", "torch", "matplotlib", "pandas", "scipy", "sklearn", "shapely", "joblib", "pooch"}
print(heavy & set(sys.modules))"""
    outcome = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "compare" in outcome.stdout
    assert outcome.stdout.splitlines()[-1] == "set()"


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("pdrbench compare --env CampusStri", {"CampusStride-v1"}),
        ("pdrbench run stay", {"stay"}),
        ("pdrbench compa", {"compare"}),
    ],
)
def test_the_shell_completes_commands_and_ids(
    words: str, found: set[str], command: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("_PDRBENCH_COMPLETE", "complete_bash")
    monkeypatch.setenv("COMP_WORDS", words)
    monkeypatch.setenv("COMP_CWORD", str(len(words.split()) - 1))
    outcome = command()
    assert outcome.code == 0 and set(outcome.out.split()) == found


@pytest.mark.parametrize("wanted", [True, False])
def test_no_color_is_honoured(wanted: bool, command: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """Codes of colours are 30 to 37 and 90 to 97."""
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.delenv("NO_COLOR", raising=False)
    if wanted:
        monkeypatch.setenv("NO_COLOR", "1")
    outcome = command("compare", "--no-such-option")
    assert bool(re.search(r"\x1b\[[0-9;]*\b[39][0-7]m", outcome.err)) != wanted


@pytest.mark.parametrize("arguments", [["reproduce", "woodman2008", "--quick"], ["bench"], ["validate-sim", "--help"]])
def test_a_command_of_the_laboratory_says_how_to_get_it(arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    app = typer.Typer()
    monkeypatch.setattr(cli, "app", app)
    monkeypatch.setattr(cli, "entries", lambda group: {})
    cli._add_commands.__wrapped__()
    outcome = CliRunner().invoke(app, arguments)
    assert isinstance(outcome.exception, PdrbenchError)
    assert f"`pdrbench {arguments[0]}` comes with the laboratory" in str(outcome.exception)
    assert "pip install -e lab" in str(outcome.exception)
