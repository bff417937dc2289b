"""`pdrbench validate-sim` with toy blocks."""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from pdrbench_lab.realism import scorecard
from pdrbench_lab.realism.measure import MeasuredBlock, measure

SOURCE = Path(__file__).parents[1] / "realism" / "toy_blocks.py"
WALK, PUBLISHED, BROKEN = "toy_blocks:WALK", "toy_blocks:PUBLISHED", "toy_blocks:BROKEN"


@pytest.fixture(autouse=True)
def toys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Toy blocks on the path, and a folder that passes for recordings."""
    (tmp_path / "site").mkdir()
    shutil.copy(SOURCE, tmp_path / "site")
    data = tmp_path / "data" / "ilc20"
    data.mkdir(parents=True)
    (data / "manifest.json").write_text("{}")
    monkeypatch.syspath_prepend(str(tmp_path / "site"))
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)


@pytest.fixture
def here(monkeypatch: pytest.MonkeyPatch) -> None:
    """Blocks are measured in this process: starting one takes seconds."""

    def measured(
        names: Sequence[str], source: Any, *, seed: int, count: int | None, **_: object
    ) -> list[MeasuredBlock]:
        return [measure(name, source, seed, count) for name in names]

    monkeypatch.setattr(scorecard, "measure_blocks", measured)


def test_for_people(command: Any) -> None:
    done = command("validate-sim", "--block", WALK, "--block", PUBLISHED)
    assert done.code == 0
    line = next(line for line in done.out.splitlines() if "time of a step" in line)
    assert all(cell in line for cell in ("Toy walk", "s", "walk", "0.55 (0.525 to 0.575)", "0.10", "yes"))
    assert "synthetic median 0.83 outside" in done.out
    assert "Toy walk: at half the pace -> step_s fails: yes" in done.out
    assert "5 of 6 rows pass (83%; the gate is 85%)" in done.out
    assert "2/2 blocks" in done.err and "2/2 blocks" not in done.out


@pytest.mark.usefixtures("here")
def test_for_machines(command: Any) -> None:
    done = command("validate-sim", "--json", "--block", WALK, "--count", 20, "--seed", 3, "--part", "fit")
    assert done.code == 0
    first = done.json["rows"][0]
    assert (first["block"], first["statistic"], first["pass"]) == (WALK, "step_s", True)
    assert first["num_synthetic"] == 20 and first["num_real"] == 40
    assert (done.json["seed"], done.json["part"], done.json["gate"]) == (3, "fit", 0.85)
    assert [control["fails"] for control in done.json["controls"]] == [True, False, True]


@pytest.mark.usefixtures("here")
def test_a_gate_that_is_missed(command: Any) -> None:
    done = command("validate-sim", "--strict", "--block", WALK)
    assert done.code == 1 and "2 of 3 negative controls fail" in done.err and "gate is missed" in done.err
    assert "rows pass" in done.out


@pytest.mark.usefixtures("here")
def test_something_that_cannot_be_measured(command: Any) -> None:
    done = command("validate-sim", "--json", "--block", WALK, "--block", BROKEN)
    assert done.code == 1 and "not everything could be measured" in done.err and BROKEN in done.err
    assert "ZeroDivisionError" in done.err
    assert [row["pass"] for row in done.json["rows"]].count(True) == 5


@pytest.mark.usefixtures("here")
def test_a_folder_with_the_scorecard_and_its_figures(command: Any, tmp_path: Path) -> None:
    done = command("validate-sim", "--json", "--block", WALK, "--out", tmp_path / "out")
    assert done.code == 0
    folder = tmp_path / "out"
    assert sorted(path.name for path in folder.iterdir()) == ["scorecard.json", "scorecard.md", "toy_blocks.WALK.png"]
    assert json.loads((folder / "scorecard.json").read_text()) == done.json
    assert (folder / "toy_blocks.WALK.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.usefixtures("here")
def test_targets_are_written_and_score_without_recordings(
    command: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded = command("validate-sim", "--json", "--block", WALK).json["rows"]
    refused = command("validate-sim", "--block", WALK, "--write-targets", "real.json")
    assert refused.code == 1 and "pdrbench data verify ilc20" in refused.err  # a manifest alone is not the set
    monkeypatch.setattr("pdrbench_lab.realism.targets.verify", lambda name: [])
    assert command("validate-sim", "--block", WALK, "--write-targets", "real.json").code == 0
    monkeypatch.delenv("PDRBENCH_DATA")
    stored = command("validate-sim", "--json", "--block", WALK, "--real", "real.json")
    assert stored.code == 0 and stored.json["rows"] == recorded
    assert stored.json["real_from"] == {WALK: "stored"}
    source = json.loads(Path("real.json").read_text())["datasets"]["ilc20"]
    assert source["licence"] == "MIT" and len(source["sha256"]) == 64 and source["commit"]


@pytest.mark.usefixtures("here")
def test_without_recordings(command: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PDRBENCH_DATA")
    done = command("validate-sim", "--json", "--block", "toy_blocks:WALK", "--real", "data")
    assert done.code == 0  # the toy's own reading needs none
    done = command("validate-sim", "--json", "--block", "toy_blocks:ABSENT", "--real", "data")
    assert done.code == 1 and "not available" in done.err
    assert [row["pass"] for row in done.json["rows"]] == [False, False, False, True]


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (("--block", "phon"), "did you mean 'phone'"),
        (("--real", "none.json"), "none.json"),
        (("--out", "taken/out"), "cannot make the folder"),
        (("--block", "toy_blocks:NOT_A_BLOCK"), "not a Block"),
    ],
)
def test_wrong_words(command: Any, arguments: tuple[str, ...], reported: str) -> None:
    Path("taken").write_text("a file")
    done = command("validate-sim", *arguments)
    assert done.code == 1 and reported in done.err and "Traceback" not in done.err and not done.out
