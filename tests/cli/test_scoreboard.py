"""Tables and footnotes from rows and results."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdrbench.cli import scoreboard
from pdrbench.evaluation.wording import ALL_COLUMNS, COLUMNS, footnotes, incidents, score_tables, stacked
from pdrbench.report import comparison_page
from pdrbench.result import Result
from pdrbench.trajectory import Estimates

NONE = Estimates(t_s=[], xy_m=np.zeros((0, 2)), level=[], heading_rad=[], sigma_m=[], converged=[])


def result(localizer: str, walk: str = "w0", **fields: Any) -> Result:
    return Result("E-v0", "test", walk, localizer, 0, NONE, step_s=[], **fields)


def row(localizer: str, **values: float) -> dict[str, Any]:
    metrics = {n: {"value": v, "unit": "m", "low": v - 1, "high": v + 1, "n": 6} for n, v in values.items()}
    return {
        "env": "E-v0",
        "localizer": localizer,
        "division": "online",
        "split": "test",
        "walks": 6,
        "of": 6,
        "rank": [1, 2],
        "smallest_ratio": 1.25,
        "units": 6,
        "unit_kind": "building",
        "note": "",
        "metrics": metrics,
    }


def test_a_table_is_ranked_and_shows_intervals(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [
        row("far", mean_m=20.5, p75_geometric_m=30.25),
        {**row("none", n=0.0), "rank": None},
        row("near", mean_m=2.0, p75_geometric_m=3.0),
    ]
    scoreboard.print_scores(rows)
    out = capsys.readouterr().out
    assert "E-v0, test split, 6 walks; 95 % intervals by the spread of 6 buildings" in out
    assert out.index("near") < out.index("far") < out.index("none")
    assert "20.50" in out and "19.50–21.50" in out and "–" in out


def test_ranks_are_shown_where_two_are_compared() -> None:
    best, other = row("a", p75_geometric_m=1.0, ratio_to_best=1.0), row("b", p75_geometric_m=2.0, ratio_to_best=2.0)
    ((_, names, _),) = score_tables([best], stacked)
    assert not {"rank", "ratio_to_best"} & set(names)
    ((_, names, cells),) = score_tables([other, best], stacked)
    assert names == ["localizer", "rank", "ratio_to_best", "p75_geometric_m"]
    assert [line[:2] for line in cells] == [["a", "1–2"], ["b", "1–2"]]
    assert "E-v0: 6 walks tell neighbours apart whose ratio is 1.25 or more" in footnotes([best, other], [])[0]


def test_of_equal_scores_the_one_with_all_walks_is_first_and_what_is_missing_stands_beside_the_name() -> None:
    rows = [{**row("picky", p75_geometric_m=2.0), "walks": 1}, row("stay", p75_geometric_m=2.0 + 1e-12)]
    ((_, _, cells),) = score_tables(rows, stacked)
    assert [line[0] for line in cells] == ["stay", "picky (1 of 6)"]
    assert any(line.startswith("(n of N)") for line in footnotes(rows, []))


def test_columns_that_do_not_apply_are_not_shown(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [row("a", mean_m=2.0, energy_score_m=1.5, first_within_5m_s=9.0), row("b", mean_m=3.0)]
    assert score_tables(rows, stacked, ALL_COLUMNS)[0][1][-1] == "energy_score_m", "no place is sought"
    never = {"value": None, "unit": "s", "low": 12.0, "high": None, "n": 6}
    lost = [{**one, "start": "unknown"} for one in rows]
    lost[1]["metrics"]["first_within_5m_s"] = never
    scoreboard.print_scores(lost, ALL_COLUMNS)
    out = capsys.readouterr().out
    assert "first" in out and "never" in out and "12.00–never" in out
    assert "coverage_95" not in out
    assert score_tables(rows, stacked, ["rmse_m"])[0][1] == ["localizer", "rmse_m"], "asked for by name"


def test_a_localizer_that_declines_every_walk_stands_in_a_footnote_only(capsys: pytest.CaptureFixture[str]) -> None:
    declined = [result("lost", w, status="unsuitable", failure="needs a radio map") for w in ("w0", "w1")]
    results = [*declined, result("near")]
    scoreboard.print_scores([{**row("lost"), "walks": 0, "metrics": {}}, row("near", mean_m=1.0)])
    out = capsys.readouterr().out
    assert "near" in out and "lost" not in out
    assert incidents(results) == ["lost on E-v0: not applicable: needs a radio map"]
    assert scoreboard.is_declined(declined) and not scoreboard.is_declined(results)


def test_failures_and_missing_answers_are_counted() -> None:
    trace = 'Traceback (most recent call last):\n  File "x.py"\nValueError: no step\n'
    results = [
        result("a-v0", "w0", missing={"nan": 2}),
        result("a-v0", "w1", status="failed", failure=trace, missing={"nan": 1, "type": 4}),
        result("b-v0", "w0"),
    ]
    assert incidents(results) == [
        "a-v0 on E-v0: failed on 1 of 2 walks, scored with what was answered before; first on walk w1: "
        "ValueError: no step",
        "a-v0 on E-v0: answers that count as missing: 3 × nan, 4 × type",
    ]
    assert scoreboard.failures(results) == [], "one walk of two"
    assert scoreboard.failures(results[1:2]) == ["failed: a-v0 on 1 of 1 walks of E-v0"]
    assert scoreboard.failures(results, strict=True) == ["failed: a-v0 on 1 of 2 walks of E-v0"]


def test_what_was_revised_stands_below_and_is_marked(capsys: pytest.CaptureFixture[str]) -> None:
    rows = [
        {**row("smooth", p75_geometric_m=1.0), "division": "offline"},
        row("smooth", p75_geometric_m=3.0),
        row("near", p75_geometric_m=2.0),
    ]
    revised = [result("smooth", walk, division="offline", revise_s=s) for walk, s in (("w0", 0.1), ("w1", 0.3))]
    scoreboard.print_scores(rows)
    out = capsys.readouterr().out
    assert out.index("near") < out.index("smooth") < out.index("smooth (offline)") and "near (" not in out
    assert incidents([*revised, result("near")]) == [
        "smooth on E-v0: offline: answers were revised when the walk was over, in 0.2 s a walk"
    ]


def test_strata_are_lines_below_and_names_are_printed_as_they_are(capsys: pytest.CaptureFixture[str]) -> None:
    value = {"value": 3.25, "unit": "m", "low": 2.0, "high": 5.0, "n": 4}
    part = {"by": "group", "name": "ring", "walks": 4, "places": 40, "metrics": {"p75_geometric_m": value}}
    scoreboard.print_scores([{**row("near", mean_m=2.0), "strata": [part]}])
    assert "ring: 4 walks, p75_geometric_m" in (out := capsys.readouterr().out) and "3.25" in out
    scoreboard.print_scores([row("my[red].py:Mine?x=1", mean_m=1.0)])
    assert "my[red].py:Mine?x=1" in capsys.readouterr().out


def test_a_page_holds_everything_and_asks_for_nothing(tmp_path: Path) -> None:
    (tmp_path / "cdf.png").write_bytes(b"\x89PNG")
    tables = score_tables([row("<b>", mean_m=2.0)], stacked)
    text = comparison_page(tables, ["a < b"], [tmp_path / "cdf.png"])
    assert "&lt;b&gt;" in text and "a &lt; b" in text and "<b>" not in text
    assert "2.00\n1.00–3.00" in text and "E-v0, test split, 6 walks" in text
    assert "data:image/png;base64,iVBORw==" in text
    assert not re.search(r"https?://|<script|<link", text)


@pytest.mark.parametrize(("width", "left_out"), [(160, []), (100, ["realtime_factor"]), (60, ["p95_m", "outside_pct"])])
def test_a_narrow_terminal_gets_fewer_columns_and_whole_numbers(
    width: int, left_out: list[str], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    names = [*COLUMNS[4:6], "pooled_p75_level_penalised_m", "p95_m", "level_hit_rate", "outside_pct", "realtime_factor"]
    one = row("dead_reckoning", **dict.fromkeys(names, 12.345))
    scoreboard.print_scores([one], names)
    captured = capsys.readouterr()
    shown = captured.out.count("11.34–13.34") + captured.out.count("11.35–13.35")
    assert shown >= 2 and "dead_reckoning" in captured.out and "_geometric_m" in captured.out
    assert all(len(line.rstrip()) <= width for line in captured.out.splitlines())
    assert (shown == len(names)) == (not left_out)
    assert all(name in captured.err for name in left_out)
