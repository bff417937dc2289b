"""`pdrbench replay`: a stored walk becomes a page, or an error of one line."""

from __future__ import annotations

import json
import re
import shutil
import textwrap
from pathlib import Path
from typing import Any

import pytest

from pdrbench.evaluation import evaluate

TOY = """
    import numpy as np
    from pdrbench import Estimate


    class Toy:
        def reset(self, briefing, rng):
            print("hello")
            self.rng, self.building, self.start = rng, briefing.building, briefing.start

        def step(self, observation):
            polygon, xy_m = self.building.sample_uniform(self.rng, 40, self.start.level)
            self.shown = {"particles_xy_m": xy_m, "particles_polygon": polygon, "num_particles": np.array(4000)}
            return Estimate(xy_m[0], self.start.level, converged=False)

        def debug(self):
            return self.shown
"""


@pytest.fixture(scope="module")
def stored(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with `toy.py`, its results on one walk with two seeds, and one of a localizer that shows nothing."""
    folder = tmp_path_factory.mktemp("stored")
    (folder / "toy.py").write_text(textwrap.dedent(TOY))
    for name, spec, seeds in (("toy", f"{folder / 'toy.py'}:Toy", 2), ("stay", "stay", 1)):
        evaluate(spec, "CampusStride-v1", split="val", walks=1, seeds=seeds, isolation="none", out=folder / name)
    return folder


def walk_of(page: Path) -> dict[str, Any]:
    return json.loads(re.findall(r'id="walk">(.*?)</script>', page.read_text(), re.DOTALL)[0])


def test_a_page_of_a_stored_walk(command: Any, stored: Path, tmp_path: Path) -> None:
    out = tmp_path / "walk.html"
    outcome = command("replay", stored / "toy", "--out", out, "--from", 10, "--to", 20.0, "--every", 10, "--json")
    assert outcome.code == 0 and outcome.json == {"file": str(out), "frames": 6, "seconds": 12.0}
    walk = walk_of(out)
    assert walk["frames"]["t_s"] == [10, 12, 14, 16, 18, 20]
    assert walk["frames"]["particles"] == [4000] * 6 and walk["cloud"]["first"] == list(range(0, 241, 40))
    assert len(walk["reference"]) > 10 and walk["frames"]["error_m"][0] > 0
    assert [file.name for file in tmp_path.iterdir()] == ["walk.html"]


def test_a_folder_of_many_walks_asks_for_one(command: Any, stored: Path, tmp_path: Path) -> None:
    (tmp_path / "results").mkdir()
    for folder in ("toy", "stay"):
        for file in (stored / folder).glob("*.result"):
            shutil.copy(file, tmp_path / "results")
    outcome = command("replay", tmp_path, "--out", tmp_path / "walk.html")
    assert outcome.code == 1 and "holds 3 stored walks; name one of them" in outcome.err
    assert outcome.err.count(".result") == 3 and "Traceback" not in outcome.err
    empty = command("replay", stored, "--out", tmp_path / "walk.html")
    assert empty.code == 1 and "holds 0 stored walks" in empty.err


def test_changed_code_is_an_error_unless_it_is_allowed(
    command: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("toy.py").write_text(textwrap.dedent(TOY))
    evaluate("toy.py:Toy", "CampusStride-v1", split="val", walks=1, isolation="none", out="toy")
    Path("toy.py").write_text(textwrap.dedent(TOY).replace("xy_m[0]", "xy_m[1]"))
    arguments = ("replay", "toy", "--out", "walk.html", "--to", 4)
    refused = command(*arguments)
    assert refused.code == 1 and "not the stored ones from 0 s on" in refused.err and "localizer" in refused.err
    assert not Path("walk.html").exists()
    shown = command(*arguments, "--loose", "--json")
    assert shown.code == 0 and shown.json["frames"] == 5
    assert "the present answers are shown" in shown.err
