"""Figures that are written twice, or that a constant gives, are the same in both places."""

from __future__ import annotations

import importlib
import json
import math
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from pdrbench.registry import environments, make_task
from pdrbench.sensors.stride import measured

ROOT = Path(__file__).resolve().parents[2]
PAPERS = {"woodman2008": 35, "frank2009": 25, "koeping2012": 30, "li2012": 60, "foot_ins": 50}  # least rows of a page

pytestmark = pytest.mark.skipif(not (ROOT / "docs").is_dir(), reason="documentation is not part of a wheel")


@pytest.fixture(scope="module")
def figures() -> Iterator[ModuleType]:
    """`docs/figures.py`, which writes what these tests hold it to."""
    sys.path.insert(0, str(ROOT))
    try:
        yield importlib.import_module("docs.figures")
    finally:
        sys.path.remove(str(ROOT))


@pytest.mark.parametrize("name", PAPERS)
def test_the_table_of_a_page_has_the_claims_of_today(name: str, figures: ModuleType) -> None:
    from pdrbench_lab.reproduce.reproduce import load_reproduction

    reproduction, _ = load_reproduction(name)
    rows = figures.claims_of(name)
    assert len(rows) >= PAPERS[name]
    assert [row[:3] for row in rows] == [[claim.id, claim.what, claim.paper] for claim in reproduction.claims]
    for row, claim in zip(rows, reproduction.claims, strict=True):
        assert (row[6] == "shown") == (claim.gate is None), row
        if claim.gate is not None and name != "li2012":  # where sample sizes may make gates wider
            assert row[5] == claim.gate.text(claim.unit), row


def test_numbers_that_stand_twice_are_the_same(figures: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    """Gates and figures of papers in README and summary are those of the pages; one that is not is named."""
    assert figures.check_numbers() == []
    assert len((ROOT / "README.md").read_bytes()) <= 7000
    monkeypatch.setattr(figures, "gates", lambda page: (0, 99))
    assert [line.split(":")[0] for line in figures.check_numbers()] == ["README.md", "docs/reproduce.md"]


def test_the_overview_of_leaderboards_has_what_their_tables_have(figures: ModuleType, tmp_path: Path) -> None:
    """The first and the next that claims anything; a leaderboard with one rank, or offline ranks only, is left out."""
    head = "| # | localizer | p75_level_penalised_m, held-out | public | gap | behind the first |\n| --: |\n"
    stays, next_one, offline = "| 1 | `stay-v0` | 1.5 (1–2)", "| 2 | `x-v1` | 2", "| o1 | `y-v0` | 1"
    rows = {
        "A-v0": f"{stays} | 9 | 9 | – |\n{next_one} | 9 | 9 | 0.5 (0–1) |\n{offline} | 9 | 9 | – |",
        "B-v0": f"{stays} | 9 | 9 | – |\n{offline} | 9 | 9 | – |\n| – | `z-v0` | – | 9 | 9 | – |",
    }
    for env, text in rows.items():
        (tmp_path / env).mkdir()
        (tmp_path / env / "TABLE.md").write_text(f"# {env}\n\n{head}{text}\n\n* A note.\n", encoding="utf-8")
    found = list(figures.overview.overview(tmp_path))[2:]
    assert found == ["| `A-v0` | 2 | `stay-v0` | 1.5 m (1–2) | `x-v1` | 0.5 (0–1) | 1.5 (1–2) |"]


def test_every_figure_has_a_command_and_stands_on_a_page(figures: ModuleType) -> None:
    drawn = [name for view in figures.VIEWS.values() for name in view.figures] + ["film_light.gif", "film_dark.gif"]
    assert sorted(drawn) == sorted(path.name for path in (ROOT / "docs" / "figures").iterdir())
    pages = [path.read_text(encoding="utf-8") for path in (ROOT / "README.md", *(ROOT / "docs").glob("*.md"))]
    shown = {name for page in pages for name in re.findall(r"figures/([\w.]+)\b", page)}
    assert set(drawn) <= shown


def test_a_view_writes_what_its_commands_made(
    figures: ModuleType, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A figure is copied, a table of claims replaces that of its page, changed lines are printed."""
    monkeypatch.setattr(figures, "DOCS", tmp_path)
    page = tmp_path / "paper.md"
    page.write_text(
        "# Paper\n\n| id | what | paper | ours | i | gate | pass |\n|---|\n| A1 | e | 1 | 2 | – | – | yes |\n\nEnd\n"
    )
    made = tmp_path / "run" / "paper" / "claims.md"
    made.parent.mkdir(parents=True)
    made.write_text("| id | what | paper | ours | i | gate | pass |\n|---|\n| A1 | e | 1 | 3 | – | – | no |\n")
    (made.parent / "fig1_error.png").write_bytes(b"drawn")
    view = figures.View("a paper", figures={"fig1.png": "paper/fig1_*.png"}, table="paper")
    files = figures.made_by(view, "paper", tmp_path / "run")
    assert files[tmp_path / "figures" / "fig1.png"] == b"drawn"
    assert files[page].decode().endswith("| A1 | e | 1 | 3 | – | – | no |\n\nEnd\n")
    assert "was 2, yes" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="0 files"):
        figures.made_by(figures.View("none", figures={"fig1.png": "nothing"}), "none", tmp_path)


def test_notebooks_are_compared_by_words_and_numbers(figures: ModuleType) -> None:
    assert not figures.differs("mean 1.000 m in 4 walks", "mean 1.001  m in 4 walks")
    assert figures.differs("mean 1.0 m", "mean 1.1 m")
    assert figures.differs("mean 1.0 m", "median 1.0 m")
    assert figures.differs("1 2", "1")


@pytest.mark.parametrize("path", sorted((ROOT / "docs" / "notebooks").glob("*.ipynb")), ids=lambda path: path.stem)
def test_notebooks_are_stored_as_they_ran(path: Path, figures: ModuleType) -> None:
    """Every cell in order, without an error, and each is a view that CI runs."""
    cells = [cell for cell in json.loads(path.read_text(encoding="utf-8"))["cells"] if cell["cell_type"] == "code"]
    assert [cell["execution_count"] for cell in cells] == list(range(1, len(cells) + 1))
    assert not [out for cell in cells for out in cell["outputs"] if out["output_type"] == "error"]
    assert figures.VIEWS[path.stem].check is not None


def description(name: str) -> str:
    return " ".join(make_task(name).description.split())


@pytest.mark.parametrize("name", sorted(environments()))
def test_descriptions_have_the_period_and_the_rates_of_the_task(name: str) -> None:
    task, text = make_task(name), description(name)
    stated = re.search(r"\*\*Handed out\*\* every ([\d.]+) s", text)
    assert stated is None or float(stated[1]) == task.period_s
    rates = {spec.rate_hz for spec in task.sensors if spec.name in ("accel", "gyro", "mag", "rotation")} - {None}
    together = re.search(r"magnetometer(?:,| and) (?:and )?(?:rotation vector|attitude)?[^.;]*? at (\d+) Hz", text)
    assert together is None or float(together[1]) in rates or not rates


IN_WORDS = {3: "three", 4: "four", 9: "nine"}


def test_descriptions_have_the_numbers_of_the_constants() -> None:
    from pdrbench.sensors.position import PositionErrors
    from pdrbench_envs.office_abroad import GROUPS
    from pdrbench_envs.office_signals import SWITCHED_FRACTION
    from pdrbench_lab.environments.phone_handling import DURATION_S as HANDLED_S
    from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import (
        LAP_M,
        LAPS,
        SCANS_A_POINT,
        SPACING_M,
        calibration_points_m,
    )
    from pdrbench_lab.papers.koeping2012.building_site.environment import DURATION_S
    from pdrbench_lab.papers.li2012.corridor_phone.corridor import CORRIDOR, TAP_SIGMA_M
    from pdrbench_lab.papers.woodman2008.lab_stride.environment import DURATION_S as LAB_S

    errors = measured()
    first_m, last_m = (float(PositionErrors().sigma_m(np.array(t_s))) for t_s in (0.0, DURATION_S))
    expected = {
        "OfficeStride-v2": [
            f"lengths {-100 * errors.length_bias:.1f} % short and {100 * errors.length_sigma_m:.1f} cm noisy",
            f"heights {100 * errors.height_sigma_m:.1f} cm noisy",
        ],
        "BuildingSite-v1": [
            f"{first_m:.1f} m per axis at first and {last_m:.1f} m after three minutes",
        ],
        "CorridorPhone-v1": [
            f"a lap of {CORRIDOR.lap_m:g} m",
            f"{CORRIDOR.long_m:g} m by {CORRIDOR.short_m:g} m",
            f"an error of {TAP_SIGMA_M:g} m per axis",
        ],
        "PhoneHandling-v1": [f"off by {TAP_SIGMA_M:g} m per axis", f"{IN_WORDS[HANDLED_S / 60]} minutes"],
        "OfficePhoneAbroad-v1": [f"people of {IN_WORDS[len(GROUPS)]} kinds"],
        "OfficePhone-v1": [f"in one walk out of {IN_WORDS[1 / SWITCHED_FRACTION]}"],
        "WlanHallway-v1": [
            f"four laps of {LAP_M:g} m",
            f"{SCANS_A_POINT} scans at each of {len(calibration_points_m())} points along the hallway, {SPACING_M:g} m",
        ],
        "LabStrideLost-v2": [f"for {math.floor(LAB_S[0] / 60 + 0.5)} minutes"],
    }
    assert (LAPS, DURATION_S) == (4, 180.0)
    missing = [
        (name, phrase) for name, phrases in expected.items() for phrase in phrases if phrase not in description(name)
    ]
    assert missing == []


def test_the_spread_of_step_models_is_as_told() -> None:
    """Of a + b f at 1.9 Hz with a and b even in their ranges, over its mean."""
    from pdrbench_baselines.li2012.localizer import GENERIC, Li2012Params, narrow

    def spread_pct(delta_a: float, delta_b: float) -> float:
        return 100.0 * math.hypot(delta_a * 1.9, delta_b) / math.sqrt(3.0) / GENERIC.length_m(1.9)

    text = " ".join(str(narrow.__doc__).split())
    filter_params = Li2012Params().filter
    wide, half = spread_pct(filter_params.delta_a, filter_params.delta_b), spread_pct(0.05, 0.075)
    assert f"spread the length of a step by {10 * round(wide / 10)} %" in text
    assert f"spread it by {round(half)} %" in text


def test_descriptions_have_the_numbers_of_the_recordings(data_root: Path) -> None:
    task = make_task("FootWalks-v1")
    if not (data_root / "foot_stride_gcp").exists():
        pytest.skip("foot_stride_gcp is not under PDRBENCH_DATA")
    lengths_m = [np.hypot(*np.diff(task.load(walk).reference.xy_m, axis=0).T).sum() for walk in task.walks["test"]]
    assert f"Walks and runs of {min(lengths_m):.0f} to {max(lengths_m):.0f} m" in description(task.id)


def test_the_pace_of_people_is_that_of_their_laws() -> None:
    from pdrbench_lab.papers.frank2009.wlan_hallway.hallway import HALLWAY_PEOPLE
    from pdrbench_sim.people.person import PersonParams, draw_person

    class Mean:
        """Draws the mean of every law."""

        def standard_normal(self) -> float:
            return 0.0

    page = " ".join((ROOT / "docs" / "frank2009.md").read_text(encoding="utf-8").split())
    slow_mps, usual_mps = (draw_person(Mean(), people).speed_mps for people in (HALLWAY_PEOPLE, PersonParams()))  # type: ignore[arg-type]
    assert f"prefer {slow_mps:.2f} m/s in the mean, the people of [Sources](sources.md) {usual_mps:.2f} m/s" in page


def test_the_malls_are_counted() -> None:
    import csv
    from importlib.resources import files

    text = (files("pdrbench_envs.malls") / "walks.csv").read_text(encoding="utf-8")
    walks = list(csv.DictReader(text.splitlines()))
    durations_s = [float(walk["duration_s"]) for walk in walks]
    assert f"Walks last from {min(durations_s):.0f} s to" in description("MallPhone-v2")
    assert round(max(durations_s) / 60) == 2  # "two minutes"
