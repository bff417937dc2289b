"""`pdrbench compare` and `run`: choice, printed and written output, with a stub of the evaluation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdrbench import evaluation, report
from pdrbench.evaluation.wording import footnotes
from pdrbench.registry import environments, localizers
from pdrbench.result import Result
from pdrbench.trajectory import Estimates

NONE = Estimates(t_s=[], xy_m=np.zeros((0, 2)), level=[], heading_rad=[], sigma_m=[], converged=[])
SCORE = {"value": 2.5, "unit": "m", "low": float("nan"), "high": float("nan"), "n": 1}


@dataclass(frozen=True)
class FakeResults:
    """One complete walk per localizer and environment."""

    results: tuple[Result, ...]

    def rows(self) -> list[dict[str, Any]]:
        about = {"division": "online", "of": 1, "rank": [1, 1], "units": 1, "unit_kind": "building", "note": ""}
        return [
            {"env": r.env, "localizer": r.localizer, "split": r.split, "walks": 1}
            | about
            | {"metrics": {"mean_m": SCORE}}
            for r in self.results
        ]

    def notes(self, columns: tuple[str, ...] | None = None) -> list[str]:
        return footnotes(self.rows(), self.results)

    def against(self, localizer: str) -> FakeResults:
        assert localizer in {result.localizer for result in self.results}
        return self

    def methods(self, columns: tuple[str, ...] | None = None) -> str:
        return "We replayed\n@misc{pdrbench}"

    def to_latex(self, columns: tuple[str, ...] | None = None) -> str:
        return "\\begin{tabular}" + ",".join(columns or ())


@dataclass
class Asked:
    """The arguments of evaluate, and which localizers decline every environment."""

    arguments: dict[str, Any]
    declining: dict[str, str]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Asked:
    """Replaces evaluation and report; works in an empty folder without recorded data."""
    state = Asked({}, {})

    def evaluate(localizers: Any, envs: Any, **options: Any) -> FakeResults:
        print("noise on standard output")
        places = [envs] if isinstance(envs, str) else envs
        by_env = localizers if isinstance(localizers, dict) else {place: [localizers] for place in places}
        state.arguments = {"localizers": by_env, "envs": places, **options}
        results = []
        for env in places:
            for name in by_env[env]:
                results.append(Result(env, options["split"] or "test", "w0", name, 0, NONE, []))
        return FakeResults(tuple(results))

    def write_report(results: FakeResults, folder: Path, columns: tuple[str, ...] | None) -> list[Path]:
        (folder / "table.md").write_text("table")
        return [folder / "table.md"]

    def declining(names: Any, env: str, split: str) -> dict[str, str]:
        return {name: why for name, why in state.declining.items() if name in names}

    monkeypatch.setattr("pdrbench.evaluation.suitability.declining", declining)
    monkeypatch.setitem(evaluation.__dict__, "evaluate", evaluate)
    monkeypatch.setitem(report.__dict__, "write_report", write_report)
    monkeypatch.delenv("PDRBENCH_DATA", raising=False)
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    return state


NEEDS = {
    "FootDual-v1": "foot_dual/",
    "FootLoops-v1": "foot_loops/",
    "FootShort-v1": "pdrbench data fetch foot_short",
    "FootVicon-v1": "foot_vicon/",
    "FootWalks-v1": "foot_stride_gcp/",
    "MallPhone-v2": "pdrbench data fetch ilc20_full",
    "MallPhoneLost-v2": "pdrbench data fetch ilc20_full",
    "MallPhoneMagnetic-v1": "pdrbench data fetch ilc20_full",
    "MallPhoneMagneticLost-v1": "pdrbench data fetch ilc20_full",
    "PhoneSteps-v1": "phone_steps/",
    "RetailPhone-v1": "pdrbench data add kaggle_iln",
    "RetailPhoneLost-v1": "pdrbench data add kaggle_iln",
    "IpinPhone-v1": "ipin2023_track3/",
    "WifiFingerprints-v1": "wifi_fingerprints/",
}
RECORDED = {name: remedy for name, remedy in NEEDS.items() if name in environments()}
"""What cannot be played here by what says how to get its data; some of it where the laboratory is installed only."""


def test_without_names_every_available_set_is_compared_and_the_rest_is_listed(asked: Asked, command: Any) -> None:
    outcome = command("compare", "--all")
    assert outcome.code == 0
    assert asked.arguments["envs"] == tuple(name for name in environments() if name not in RECORDED)
    chosen = [name for name in localizers() if name not in ("oracle",)]
    assert asked.arguments["localizers"] == dict.fromkeys(asked.arguments["envs"], chosen)
    for name, remedy in RECORDED.items():
        (line,) = [line for line in outcome.err.splitlines() if line.startswith(f"left out: {name}: ")]
        assert remedy in line
    assert "left out: oracle: it is given the reference, which the 'test' split withholds" in outcome.err


def test_the_oracle_runs_where_the_truth_is_public(asked: Asked, command: Any) -> None:
    assert command("compare", "--split", "train").code == 0
    assert "oracle" in asked.arguments["localizers"]["CampusStride-v1"]


def test_options_reach_the_evaluation(asked: Asked, command: Any, tmp_path: Path) -> None:
    arguments = (
        f"--env CampusStride-v1 --localizer stay --localizer dead_reckoning --split val --seeds 2 --walks 3 "
        f"--nonce {'7' * 32}"
    )
    assert command("compare", *arguments.split(), "--jobs", 2, "--out", tmp_path / "o").code == 0
    assert asked.arguments == {
        "localizers": {"CampusStride-v1": ["stay", "dead_reckoning"]},
        "envs": ("CampusStride-v1",),
        "split": "val",
        "seeds": 2,
        "walks": 3,
        "jobs": 2,
        "out": tmp_path / "o/results",
        "progress": True,
        "isolation": "process",
        "nonce": "7" * 32,
    }


def test_what_does_not_suit_is_not_run_and_counted_in_a_line(asked: Asked, command: Any) -> None:
    asked.declining["wifi_knn"] = "needs a radio map"
    outcome = command("compare", "--env", "CampusStride-v1")
    assert "wifi_knn" not in asked.arguments["localizers"]["CampusStride-v1"]
    (line,) = [line for line in outcome.err.splitlines() if line.startswith("left out: ")]
    count = len(localizers()) - len(asked.arguments["localizers"]["CampusStride-v1"])
    assert line.startswith(f"left out: {count} localizers that do not suit CampusStride-v1") and "--all" in line
    outcome = command("compare", "--env", "CampusStride-v1", "--all")
    assert "left out: wifi_knn on CampusStride-v1: needs a radio map" in outcome.err
    outcome = command("compare", "--env", "CampusStride-v1", "--localizer", "wifi_knn")
    assert outcome.code == 1 and "wifi_knn on CampusStride-v1: needs a radio map" in outcome.err


def test_json_is_the_rows_and_nothing_else(asked: Asked, command: Any) -> None:
    outcome = command("compare", "--env", "pdrbench/CampusStride-v1", "--localizer", "stay", "--json")
    assert outcome.json == {
        "rows": [
            {
                "env": "CampusStride-v1",
                "localizer": "stay",
                "division": "online",
                "split": "test",
                "walks": 1,
                "of": 1,
                "rank": [1, 1],
                "units": 1,
                "unit_kind": "building",
                "note": "",
                "metrics": {"mean_m": {"value": 2.5, "unit": "m", "low": None, "high": None, "n": 1}},
            }
        ]
    }
    assert "noise on standard output" in outcome.err and "noise" not in outcome.out


def test_files_are_named(asked: Asked, command: Any, tmp_path: Path) -> None:
    outcome = command("compare", "--env", "CampusStride-v1", "--latex", "t.tex", "--html", "t.html")
    assert "wrote 3 files:" in outcome.err
    assert "CampusStride-v1, test split, 1 walk;" in (tmp_path / "t.html").read_text()
    assert "pdrbench-results/table.md" in outcome.err and (tmp_path / "pdrbench-results/table.md").exists()
    assert (tmp_path / "t.tex").read_text() == "\\begin{tabular}"


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--latex", "absent/t.tex"), "cannot write absent/t.tex: No such file or directory; choose another place"),
        (("--html", "file/t.html"), "cannot write file/t.html: Not a directory; choose another place"),
        (("--out", "file/o"), "cannot make the folder file/o: Not a directory; choose another place"),
        (("--env", "MallPhone-v2"), "the dataset 'ilc20_full' is not available"),
        (("--env", "CampusStride-v1", "--split", "tset"), "did you mean 'test'?"),
        (("--split", "nosuch"), "no environment with data has walks in a 'nosuch' split"),
    ],
)
def test_impossible_runs_are_errors_before_any_walk(
    arguments: tuple[str, ...], message: str, asked: Asked, command: Any, tmp_path: Path
) -> None:
    (tmp_path / "file").write_text("")
    outcome = command("compare", *arguments)
    assert outcome.code == 1 and message in outcome.err and not asked.arguments


def test_a_folder_that_takes_no_files_is_an_error_before_any_walk(
    asked: Asked, command: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**_: Any) -> None:
        raise PermissionError(13, "Permission denied")

    (tmp_path / "o").mkdir()
    monkeypatch.setattr("pdrbench.cli.options.tempfile.TemporaryFile", refuse)  # root may write everywhere
    outcome = command("compare", "--out", tmp_path / "o")
    assert outcome.code == 1 and not asked.arguments
    assert f"cannot write into the folder {tmp_path / 'o'}: Permission denied; choose another place" in outcome.err


def test_columns_that_are_asked_for_are_shown(asked: Asked, command: Any, tmp_path: Path) -> None:
    start = ("compare", "--env", "CampusStride-v1", "--latex", "t.tex")
    outcome = command(*start, "--columns", "mean_m,p95_m")
    assert "mean_m" in outcome.out and (tmp_path / "t.tex").read_text() == "\\begin{tabular}mean_m,p95_m"
    assert command(*start, "--all-columns").code == 0 and "pooled_p75" in (tmp_path / "t.tex").read_text()
    assert "did you mean 'mean_m'" in command(*start, "--columns", "meen_m").err
    assert "leave one out" in command(*start, "--columns", "mean_m", "--all-columns").err


def test_one_is_compared_with_another_and_settings_come_from_a_file(asked: Asked, command: Any, tmp_path: Path) -> None:
    (tmp_path / "tuned.toml").write_text('localizer = "li2012"\n[settings]\nmap = false\n')
    start = ("compare", "--env", "CampusPhone-v1", "--settings", "tuned.toml", "--against", "dead_reckoning")
    outcome = command(*start, "--methods")
    assert outcome.code == 0 and outcome.out.endswith("We replayed\n@misc{pdrbench}\n")
    assert asked.arguments["localizers"]["CampusPhone-v1"] == ["li2012", "li2012?map=false", "dead_reckoning"]
    assert command(*start, "--methods", "--json").json["methods"].startswith("We replayed")
    outcome = command("compare", "--env", "CampusPhone-v1", "--against", "li2012?map=false")
    assert outcome.code == 1 and "li2012?map=false is not played here" in outcome.err
    assert command("run", "li2012", "CampusPhone-v1", "--settings", "tuned.toml").code == 0
    assert asked.arguments["localizers"] == {"CampusPhone-v1": ["li2012?map=false"]}
    assert "its settings are of li2012, not of stay" in command("run", "stay", *start[2:5]).err


def test_run_prints_one_row(asked: Asked, command: Any, tmp_path: Path) -> None:
    outcome = command("run", "stay", "CampusStride-v1", "--out", "o", "--json")
    assert [row["localizer"] for row in outcome.json["rows"]] == ["stay"]
    assert asked.arguments["out"] == Path("o") and "pdrbench plot o" in outcome.err
    assert "stay" in command("run", "stay", "CampusStride-v1").out
    assert asked.arguments["out"] is None
