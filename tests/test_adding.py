"""One file and one line add an environment, a localizer, a metric, a reader, a sensor or a command.

The packages of `docs/adding.md`, as they stand there: the commands list and use what was added.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from installed import declare

PAGE = Path(__file__).resolve().parents[1] / "docs" / "adding.md"
WRONG = """
from pdrbench.metrics import Metric

BAD_M = Metric("bad_m", "m", "lower", "position", "A line.", "my_walks.end_error:end_error_m", takes=("held", "truth"))
"""
COMMANDS = [
    *(["list", kind, "--json"] for kind in ("localizers", "metrics", "sensors", "formats")),
    ["check", "env", "MyOffice-v1", "--json"],
    ["check", "localizer", "mine", "--env", "MyOffice-v1", "--json"],
    ["inspect", "log.txt", "--json"],
    ["convert", "log.txt", "walk", "--json"],
    ["run", "mine", "MyOffice-v1", "--json"],
    ["hello"],
]
# One process for all commands, since starting one costs more than most of them.
RUNNER = """
import contextlib, io, json, sys
from pdrbench.cli import main
answers = []
for arguments in json.loads(sys.argv[1]):
    out = io.StringIO()
    with contextlib.redirect_stdout(out):
        try:
            main(arguments)
        except SystemExit as stop:
            answers.append([stop.code, out.getvalue()])
print(json.dumps(answers))
"""


pytestmark = pytest.mark.skipif(not PAGE.is_file(), reason="documentation is not part of a wheel")


def add_from_outside(folder: Path) -> None:
    """Packages as pip leaves them, and beside their metric one that takes what no metric can be given."""
    text = PAGE.read_text(encoding="utf-8")
    for name, code in re.findall(r'^```python title="([^"]+)"\n(.*?)^```$', text, re.MULTILINE | re.DOTALL):
        (folder / name).parent.mkdir(exist_ok=True)
        (folder / name).write_text(code, encoding="utf-8")
    (folder / "my_walks" / "bad.py").write_text(WRONG)
    with (folder / "my_walks" / "__init__.py").open("a") as table:
        table.write('METRICS["bad_m"] = "my_walks.bad:BAD_M"\n')
    (declared,) = re.findall(r"^```toml\n(.*?)^```$", text, re.MULTILINE | re.DOTALL)
    points = tomllib.loads(declared)["project"]["entry-points"]
    lines = [f"[{group}]\n" + "".join(f"{k} = {v}\n" for k, v in of.items()) for group, of in points.items()]
    declare(folder, "mine", "".join(lines))


def test_additions_are_listed_checked_and_used(tmp_path: Path) -> None:
    site, work = tmp_path / "site", tmp_path / "work"
    site.mkdir()
    work.mkdir()
    add_from_outside(site)
    (work / "log.txt").write_text("my log\n0.0 20.5\n1.0 21.5\n")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(
        [sys.executable, "-c", RUNNER, json.dumps(COMMANDS)], cwd=work, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    answers = {" ".join(arguments): answer for arguments, answer in zip(COMMANDS, json.loads(done.stdout), strict=True)}
    assert {name: code for name, (code, _) in answers.items() if code} == {}, done.stderr
    assert answers.pop("hello")[1] == "hello\n"
    found = {name: json.loads(out) for name, (_, out) in answers.items()}
    for kind, name in {
        "localizers": "mine", "metrics": "end_error_m", "sensors": "thermometer", "formats": "mylog",
    }.items():  # fmt: skip
        (item,) = [item for item in found[f"list {kind} --json"]["items"] if item["id"] == name]
        assert item["broken"] is None and item["package"] == "mine"
    checks = (
        found["check env MyOffice-v1 --json"]["checks"]
        + found["check localizer mine --env MyOffice-v1 --json"]["checks"]
    )
    assert len(checks) > 10 and all(check["pass"] for check in checks)
    assert found["inspect log.txt --json"]["format"] == found["convert log.txt walk --json"]["from"] == "mylog"
    assert (work / "walk" / "stream.thermometer.npy").is_file()
    rows = found["run mine MyOffice-v1 --json"]["rows"]
    assert [row["division"] for row in rows] == ["online", "offline"]
    for row in rows:
        assert row["metrics"]["mean_m"]["value"] < 1e-9 and row["metrics"]["end_error_m"]["value"] < 1e-9
        assert "bad_m" not in row["metrics"]
    (refused,) = [item["broken"] for item in found["list metrics --json"]["items"] if item["id"] == "bad_m"]
    assert "takes 'truth'" in refused and "held" in refused
