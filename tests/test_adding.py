"""One file and one line add an environment, a localizer, a metric, a reader, a sensor or a command.

A package with entry points on the path; the commands list and use what was added.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

# By kind: entry-point group, id, attribute, and content of the file.
FILES = {
    "sensor": (
        "sensors",
        "thermometer",
        "THERMOMETER",
        """
        import numpy as np
        from pdrbench.recording import SensorSpec

        THERMOMETER = SensorSpec(
            name="thermometer", columns=("t_s", "temperature_c"), low=np.array([0.0, -50.0]),
            high=np.array([1e5, 60.0]), rate_hz=1.0, what="Temperature of the air.",
        )
        """,
    ),
    "environment": (
        "environments",
        "Tiny-v0",
        "task",
        """
        import numpy as np
        from pdrbench.recording import Recording, SensorStream
        from pdrbench.sensors import sensor_spec
        from pdrbench.task import Task
        from pdrbench.trajectory import Start, Trajectory

        def load(walk):
            t_s = np.arange(0.0, 10.0)
            xy_m = np.column_stack([np.sqrt(t_s + 0.2), np.sqrt(t_s + 0.3)])
            truth = Trajectory(t_s=t_s, xy_m=xy_m, level=np.zeros(10, int), surveyed=t_s > 0)
            rows = np.column_stack([t_s, 20 + t_s])
            stream = SensorStream(sensor_spec("thermometer"), rows)
            return Recording(id=walk, building=None, streams={"thermometer": stream}, reference=truth)

        def task():
            return Task(
                id="Tiny-v0", summary="A line.", description="A line.", sensors=(sensor_spec("thermometer"),),
                capacity={"thermometer": 4}, period_s=1.0, start="pose", walks={"train": ("a",), "test": ("b",)},
                load=load, tell_start=lambda walk: Start(xy_m=walk.reference.xy_m[0], level=0, heading_rad=0.0),
                licence="MIT", source="generated",
            )
        """,
    ),
    "localizer": (
        "localizers",
        "tiny-v0",
        "Tiny",
        """
        import numpy as np
        from pdrbench.localizer import Estimate

        class Tiny:
            \"\"\"Reads the place off the thermometer.\"\"\"

            def reset(self, briefing, rng):
                briefing.require(sensors=("thermometer",))
                self.xy_m = [0.0, 0.0]

            def step(self, observation):
                rows = observation.rows["thermometer"]
                if len(rows):
                    self.xy_m = np.sqrt(rows[-1, 1] - 20 + np.array([0.2, 0.3]))
                return Estimate(xy_m=self.xy_m, level=0)
        """,
    ),
    "metric": (
        "metrics",
        "tiny_m",
        "TINY_M",
        """
        from pdrbench.metrics import Metric

        def tiny_m(held, reference):
            return 4.25

        TINY_M = Metric("tiny_m", "m", "lower", "position", "Always 4.25 m.", f"{__name__}:tiny_m")
        """,
    ),
    "reader": (
        "readers",
        "tiny",
        "READER",
        """
        \"\"\"Times and temperatures.\"\"\"

        import numpy as np
        from pdrbench.io import Reader
        from pdrbench.io.log import Log, ReadReport
        from pdrbench.trajectory import Start, Trajectory

        def read(path):
            rows = np.loadtxt(path, skiprows=1, ndmin=2)
            nowhere = Trajectory(
                t_s=np.zeros(0), xy_m=np.zeros((0, 2)), level=np.zeros(0, int), surveyed=np.zeros(0, bool)
            )
            return Log(rows={"thermometer": rows}, reference=nowhere, device="tiny", report=ReadReport())

        READER = Reader(read, lambda head: head.content.startswith(b"tiny log"))
        """,
    ),
    "command": (
        "commands",
        "tiny",
        "tiny",
        """
        import typer

        def tiny():
            typer.echo("tiny command")
        """,
    ),
}  # fmt: skip
COMMANDS = [
    *(["list", kind, "--json"] for kind in ("localizers", "metrics", "sensors", "formats")),
    ["check", "env", "Tiny-v0", "--json"],
    ["check", "localizer", "tiny-v0", "--env", "Tiny-v0", "--json"],
    ["inspect", "log.txt", "--json"],
    ["convert", "log.txt", "walk", "--json"],
    ["run", "tiny-v0", "Tiny-v0", "--json"],
    ["tiny"],
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


def add_from_outside(folder: Path) -> None:
    """Packages as pip leaves them, with one entry point for each kind; no localizer may read what registers walks."""
    info = folder / "tiny-1.0.dist-info"
    info.mkdir()
    points = []
    for kind, (group, name, attribute, content) in FILES.items():
        package = folder / ("tiny_localizers" if kind == "localizer" else "tiny_package")
        package.mkdir(exist_ok=True)
        (package / f"{kind}.py").write_text(textwrap.dedent(content))
        with (package / "__init__.py").open("a") as table:
            table.write(f'{group.upper()} = {{"{name}": "{package.name}.{kind}:{attribute}"}}\n')
        points.append(f"[pdrbench.{group}]\nmine = {package.name}:{group.upper()}\n")
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: tiny\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("".join(points))


def test_additions_are_listed_checked_and_used(tmp_path: Path) -> None:
    site, work = tmp_path / "site", tmp_path / "work"
    site.mkdir()
    work.mkdir()
    add_from_outside(site)
    (work / "log.txt").write_text("tiny log\n0.0 20.5\n1.0 21.5\n")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(site), os.environ.get("PYTHONPATH", "")])}
    done = subprocess.run(
        [sys.executable, "-c", RUNNER, json.dumps(COMMANDS)], cwd=work, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    answers = {" ".join(arguments): answer for arguments, answer in zip(COMMANDS, json.loads(done.stdout), strict=True)}
    assert {name: code for name, (code, _) in answers.items() if code} == {}, done.stderr
    assert answers.pop("tiny")[1] == "tiny command\n"
    found = {name: json.loads(out) for name, (_, out) in answers.items()}
    for kind, name in {
        "localizers": "tiny-v0", "metrics": "tiny_m", "sensors": "thermometer", "formats": "tiny",
    }.items():  # fmt: skip
        (item,) = [item for item in found[f"list {kind} --json"]["items"] if item["id"] == name]
        assert item["broken"] is None and item["package"] == "tiny"
    checks = (
        found["check env Tiny-v0 --json"]["checks"] + found["check localizer tiny-v0 --env Tiny-v0 --json"]["checks"]
    )
    assert len(checks) > 10 and all(check["pass"] for check in checks)
    assert found["inspect log.txt --json"]["format"] == found["convert log.txt walk --json"]["from"] == "tiny"
    assert (work / "walk" / "stream.thermometer.npy").is_file()
    (row,) = found["run tiny-v0 Tiny-v0 --json"]["rows"]
    assert row["metrics"]["mean_m"]["value"] < 1e-4 and row["metrics"]["tiny_m"]["value"] == 4.25
