"""Summaries of results."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from installed import importable
from scipy import stats

from pdrbench.errors import PdrbenchError, ResultError
from pdrbench.evaluation import Results, evaluate, load_results, score, scoring, store
from pdrbench.evaluation.wording import in_a_line
from pdrbench.metrics import METRICS, POOLED
from pdrbench.registry import make_task
from pdrbench.result import Result

Spec = Callable[[str], str]


@pytest.fixture(scope="module")
def results(localizer: Spec, plugin_root: Path) -> Results:
    """Six walks, two seeds, three localizers, one of which declines; played and scored once, tests change copies."""
    specs = [localizer(name) for name in ("Noisy", "Worse", "Oracle")]
    with importable(plugin_root):
        found = evaluate(specs, "Corridor-v0", walks=6, seeds=2, isolation="none")
        assert found.scored
    return found


def test_one_row_for_each_localizer_in_the_agreed_shape(results: Results, localizer: Spec) -> None:
    rows = results.rows()
    assert [row["localizer"] for row in rows] == [localizer(name) for name in ("Noisy", "Worse", "Oracle")]
    for row in rows[:2]:
        assert {"env", "localizer", "division", "split", "walks", "of", "rank", "metrics"} <= set(row)
        assert (row["env"], row["split"], row["walks"], row["failed"], row["unsuitable"]) == (
            *("Corridor-v0", "test"),
            *(6, 0, 0),
        )
        ranking = {"p75_geometric_m", "ratio_to_best", "p_holm"}
        assert set(row["metrics"]) - ranking == set(METRICS) | set(POOLED)
        assert all(set(entry) == {"value", "unit", "low", "high", "n"} for entry in row["metrics"].values())
    assert rows[2]["metrics"] == {}
    assert rows[2]["unsuitable"] == 12


def test_values_average_over_seeds_first_and_intervals_are_over_walks(results: Results) -> None:
    entry = results.rows()[0]["metrics"]["mean_m"]
    frame = results.walks()
    by_walk = frame[frame.localizer == frame.localizer[0]].groupby("walk")["mean_m"].mean()
    assert entry["value"] == pytest.approx(by_walk.mean())
    ratio = math.exp(stats.t.ppf(0.975, 5) * by_walk.std(ddof=1) / math.sqrt(6) / by_walk.mean())
    assert (entry["low"], entry["high"]) == pytest.approx((by_walk.mean() / ratio, by_walk.mean() * ratio))
    assert (entry["n"], entry["unit"]) == (6, "m")
    assert "95 % intervals by the spread of 6 walks" in results.table()


def test_pooled_values_are_over_positions(results: Results) -> None:
    metrics = results.rows()[0]["metrics"]
    errors_m = np.concatenate(
        [s.errors_m for r, s in zip(results.results, results.scored, strict=True) if len(s.errors_m)][:1]
    )
    assert len(errors_m) == 12
    assert metrics["pooled_n"]["value"] == 6 * 2 * 12
    # every walk has as many positions, so here both means agree
    for end in ("value", "low", "high"):
        assert metrics["pooled_mean_m"][end] == pytest.approx(metrics["mean_m"][end])


def test_json_has_null_for_values_that_do_not_apply(results: Results, tmp_path: Path) -> None:
    text = results.to_json(tmp_path / "rows.json")
    assert (tmp_path / "rows.json").read_text() == text
    rows = json.loads(text, parse_constant=lambda name: pytest.fail(f"{name} is not JSON"))["rows"]
    assert rows == results.rows()
    assert rows[0]["metrics"]["ve95_m"]["value"] is None, "the reference has no z"
    assert rows[0]["metrics"]["ve95_m"]["n"] == 0


def test_the_frame_of_walks_has_every_metric_and_nan_for_the_declined(results: Results) -> None:
    frame = results.walks()
    assert len(frame) == 36
    assert set(METRICS) <= set(frame.columns)
    declined = frame[frame.status == "unsuitable"]
    assert len(declined) == 12
    assert declined[list(METRICS)].isna().all().all()


def test_tables_hold_the_same_numbers(results: Results, localizer: Spec, tmp_path: Path) -> None:
    value = results.rows()[1]["metrics"]["mean_m"]
    cell = f"{value['value']:.2f} [{value['low']:.2f}, {value['high']:.2f}]"
    for text in (results.table(), results.to_markdown(), results.to_latex()):
        assert (cell if "tabular" not in text else f"& {value['value']:.2f} &") in text
        assert f"{localizer('Oracle')} on Corridor-v0: not applicable: " in text
    assert r"% Corridor-v0, test split" in results.to_latex()
    for text in (results.to_markdown(), results.to_latex()):
        assert text.index(localizer("Noisy")) < text.index(localizer("Worse")), "best first"
    assert "localizer & rank & ratio & p75 (m) & mean (m) & lost" in results.to_latex()
    assert r"localizer & p95\_m & mean (m)" in results.to_latex(["p95_m", "mean_m"])
    assert "| localizer | p95_m |" in results.to_markdown(["p95_m"])
    lines = results.to_csv(tmp_path / "t.csv").splitlines()
    assert lines[0] == "env,localizer,division,split,walks,stratum,metric,value,unit,low,high,n"
    assert (tmp_path / "t.csv").read_text().splitlines() == lines
    assert len(lines) == 1 + 2 * (len(METRICS) + len(POOLED) + 3), "and what ranks them"


def test_markdown_lines_have_as_many_cells_as_the_header(results: Results) -> None:
    table = [line for line in results.to_markdown().splitlines() if line.startswith("|")]
    assert len(table) == 4, "no row for a localizer that declined every walk"
    assert len({line.count("|") for line in table}) == 1


def test_ranks_are_by_ratios_on_the_same_walks(results: Results, localizer: Spec) -> None:
    noisy, worse, oracle = (localizer(name) for name in ("Noisy", "Worse", "Oracle"))
    rows = {row["localizer"]: row for row in results.rows()}
    walks = results.walks().assign(log=lambda frame: np.log(frame["p75_level_penalised_m"]))
    by_walk = walks.pivot(index=["walk", "seed"], columns="localizer", values="log").groupby("walk").mean()
    for name in (noisy, worse):
        value = rows[name]["metrics"]["p75_geometric_m"]
        assert value["value"] == pytest.approx(np.exp(by_walk[name].mean()))
        assert value["low"] < value["value"] < value["high"] and value["n"] == 6
    ratio = rows[worse]["metrics"]["ratio_to_best"]
    assert ratio["value"] == pytest.approx(np.exp((by_walk[worse] - by_walk[noisy]).mean()))
    assert 1 < ratio["low"] < ratio["value"] < ratio["high"]
    assert rows[worse]["metrics"]["p_holm"]["value"] == pytest.approx(2 / 2**6), "all six differences have one sign"
    assert rows[noisy]["metrics"]["ratio_to_best"]["value"] == 1.0
    assert rows[noisy]["metrics"]["p_holm"]["value"] is None and rows[noisy]["smallest_ratio"] > 1
    assert (rows[noisy]["rank"], rows[worse]["rank"], rows[oracle]["rank"]) == ([1, 1], [2, 2], None)
    assert (rows[oracle]["walks"], rows[oracle]["of"]) == (0, 6)


def test_walks_that_are_missing_are_ranked_with_the_worst_answer(results: Results, localizer: Spec) -> None:
    noisy, worse = localizer("Noisy"), localizer("Worse")
    declined = {f"test-{number:03d}" for number in (1, 2, 3, 4, 5)}
    picky = tuple(
        replace(r, status="unsuitable" if r.walk != "test-001" else "failed", failure="not this one")
        if r.localizer == noisy and r.walk in declined
        else r
        for r in results.results
        if r.localizer in (noisy, worse)
    )
    anew = Results(picky)
    rows = {row["localizer"]: row for row in anew.rows()}
    assert (rows[noisy]["walks"], rows[noisy]["of"], rows[noisy]["metrics"]["mean_m"]["n"]) == (1, 6, 2)
    assert rows[worse]["metrics"]["ratio_to_best"]["value"] == 1.0, "the best has played every walk"
    assert f"{noisy} (1 of 6)" in anew.table() and "missing walks are ranked with the worst answer" in anew.table()
    logs = anew.walks().assign(log=lambda frame: np.log(frame["p75_level_penalised_m"]))
    log = logs.groupby(["localizer", "walk"])["log"].mean()
    expected = (log[noisy, "test-000"] + log[worse].drop("test-000").sum()) / 6
    assert rows[noisy]["metrics"]["p75_geometric_m"]["value"] == pytest.approx(math.exp(expected))


def test_walks_are_the_units_where_there_is_one_person(
    results: Results, localizer: Spec, monkeypatch: pytest.MonkeyPatch
) -> None:
    anew = Results(results.results)
    anew.__dict__["scored"] = tuple(replace(scored, unit="one") for scored in results.scored)
    row = anew.rows()[0]
    assert row["units"] == 1 and row["metrics"]["mean_m"]["low"] == results.rows()[0]["metrics"]["mean_m"]["low"]
    assert "95 % intervals by the spread of 6 walks of one walk" in anew.table(), "here a unit is a walk"


def test_what_chance_explains_has_the_same_rank(localizer: Spec) -> None:
    few = evaluate([localizer("Noisy"), localizer("Worse")], "Corridor-v0", walks=4, isolation="none", seeds=1)
    assert [row["rank"] for row in few.rows()] == [[1, 2], [1, 2]], "four walks give no p-value below 0.125"


def scored_anew(results: Results, name: str, values: list[float]) -> Results:
    """The same results, one metric of each replaced."""
    anew = Results(results.results)
    scored = [
        replace(one, scores={**one.scores, name: value}) for one, value in zip(results.scored, values, strict=True)
    ]
    anew.__dict__["scored"] = tuple(scored)  # where the cached property keeps it
    return anew


def test_missing_convergence_is_neither_left_out_nor_averaged(localizer: Spec) -> None:
    results = evaluate(localizer("SaysNothing"), "CorridorLost-v0", walks=6, isolation="none", seeds=1)
    never = math.inf
    often = scored_anew(results, "convergence_s", [5.0, never, 7.0, never, never, never])
    entry = often.rows()[0]["metrics"]["convergence_s"]
    assert (entry["value"], entry["high"], entry["n"]) == (None, None, 6)
    assert json.loads(often.to_json())["rows"] == often.rows()
    assert "never" in often.table(["convergence_s"]) and "never" in often.to_markdown(["convergence_s"])
    frame = often.to_frame().set_index("metric")
    assert frame["value"]["convergence_s"] == frame["high"]["convergence_s"] == never
    seldom = scored_anew(results, "convergence_s", [5.0, never, 7.0, 9.0, 8.0, math.nan])
    entry = seldom.rows()[0]["metrics"]["convergence_s"]
    assert (entry["value"], entry["n"]) == (8.0, 5)


def test_strata_are_groups_of_walks_and_places_by_their_distance_to_a_scan(
    results: Results, localizer: Spec, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = make_task("Corridor-v0")
    groups = {walk: ("seen floor" if number < 4 else "unseen floor",) for number, walk in enumerate(task.walks["test"])}
    grouped = replace(task, groups=groups)
    monkeypatch.setattr("pdrbench.evaluation.rows.make_task", lambda *_: grouped)
    anew = Results(results.results)
    scan_m = np.array([0.0, 2.9, 3.0, 9.0, 10.0, math.inf, *[math.nan] * 6])  # of the twelve places of each walk
    anew.__dict__["scored"] = tuple(replace(s, scan_m=scan_m[: len(s.errors_m)]) for s in results.scored)
    row, _, declined = anew.rows()
    strata = {of["name"]: of for of in row["strata"]}
    assert {name: (of["by"], of["walks"], of["places"]) for name, of in strata.items()} == {
        "seen floor": ("group", 4, 48),
        "unseen floor": ("group", 2, 24),
        **dict.fromkeys(("scan 0–3 m", "scan 3–10 m", "scan > 10 m"), ("radio", 6, 12)),
    }
    frame = results.walks()
    is_seen = frame["walk"].map(lambda walk: groups[walk][0]).eq("seen floor")
    here = frame[(frame.localizer == row["localizer"]) & is_seen]
    found = strata["seen floor"]["metrics"]["p75_level_penalised_m"]
    assert found["value"] == pytest.approx(here.groupby("walk")["p75_level_penalised_m"].mean().mean())
    assert found["low"] < found["value"] < found["high"]
    log = np.log(here["p75_level_penalised_m"]).groupby(here["walk"]).mean()
    geometric = strata["seen floor"]["metrics"]["p75_geometric_m"]
    assert geometric["value"] == pytest.approx(math.exp(log.mean())) and geometric["low"] < geometric["value"]
    assert strata["unseen floor"]["metrics"]["mean_m"]["low"] is None, "two units are too few"
    errors_m = [
        s.errors_m for r, s in zip(results.results, results.scored, strict=True) if r.localizer == row["localizer"]
    ]
    between = strata["scan 3–10 m"]["metrics"]["pooled_mean_m"]["value"]
    assert between == pytest.approx(np.mean([of[2:4] for of in errors_m]))
    assert {of["declined"] for of in row["strata"]} == {0} and declined["strata"] == []
    for text in (anew.table(), anew.to_markdown()):
        assert "seen floor: 4 walks, p75_geometric_m" in text and "scan 0–3 m: 6 walks, mean_m" in text
    assert ",unseen floor,mean_m," in anew.to_csv()


def test_score_looks_the_truth_up(results: Results) -> None:
    scored = score(results.results[0])
    assert set(scored) == set(METRICS)
    assert scored["mean_m"] == pytest.approx(results.walks()["mean_m"][0])
    assert score(results.results[-1]) == {}, "a declined walk has no scores"


def test_score_refuses_a_result_of_other_data(results: Results) -> None:
    def changed(**fields: object) -> Result:
        plain = {name: getattr(results.results[0], name) for name in Result.__slots__}
        return Result(**(plain | fields))  # type: ignore[arg-type]

    with pytest.raises(ResultError, match="expected a Result, got NoneType"):
        score(None)  # type: ignore[arg-type]
    with pytest.raises(ResultError, match="not comparable"):
        score(changed(provenance={"files_sha256": "0" * 64}))
    with pytest.raises(ResultError, match="of the test split"):
        score(changed(split="train"))
    assert score(changed(provenance={})) == score(results.results[0]), "a plain loop of env.step has no provenance"


def test_a_localizer_without_estimates_is_scored_from_the_start_or_the_centre(localizer: Spec) -> None:
    results = evaluate(localizer("SaysNothing"), ["Corridor-v0", "CorridorLost-v0"], walks=1, isolation="none", seeds=1)
    reference = load_reference()
    known, lost = (scored.scores["mean_m"] for scored in results.scored)
    assert known == pytest.approx(np.hypot(*reference.T).mean())
    centre = results.scored[1].errors_m
    assert lost == pytest.approx(centre.mean())
    assert lost > known
    assert "the start is not known" in results.table()


def load_reference() -> np.ndarray:
    from pdrbench.registry import make_task

    return make_task("Corridor-v0").load("test-000").reference.xy_m


def test_scores_are_the_same_in_processes(localizer: Spec, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(scoring, "SPREAD_S", 0.0)
    results = evaluate(localizer("Noisy"), "Corridor-v0", walks=3, jobs=2, seeds=1)
    alone = Results(results.results, jobs=1)
    assert results.walks().equals(alone.walks())


def test_scores_are_taken_from_the_folder_where_nothing_has_changed(
    localizer: Spec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    specs = [localizer(name) for name in ("Noisy", "Worse", "Oracle")]
    results = evaluate(specs, "Corridor-v0", walks=2, seeds=2, out=tmp_path, isolation="none")
    assert results.kept == tmp_path / "scores"
    expected = results.walks()
    assert expected.equals(Results(results.results).walks())
    walks: list[int] = []
    plain = scoring._score_walk
    monkeypatch.setattr(scoring, "_score_walk", lambda new, task: (walks.append(len(new)), plain(new, task))[1])
    assert expected.equals(Results(results.results, kept=results.kept).walks())
    assert not walks
    # other answers are scored, and only they
    one, *others = results.results
    moved = replace(one.estimates, xy_m=one.estimates.xy_m + np.array([3.0, 4.0]))
    again = Results((replace(one, estimates=moved), *others), kept=results.kept)
    assert again.scored[0].scores["mean_m"] == score(again.results[0])["mean_m"] != results.scored[0].scores["mean_m"]
    assert walks == [1, 1]  # once here and once by `score`
    # what other code computed, and a file that is torn, is computed anew
    monkeypatch.setattr(scoring, "code_sha256", lambda env: "other code")
    assert expected.equals(Results(results.results, kept=results.kept).walks())
    assert walks[2:] == [6, 6]
    for file in (tmp_path / "scores").iterdir():
        file.write_bytes(file.read_bytes()[:100])
    assert expected.equals(Results(results.results, kept=results.kept).walks())
    assert walks[4:] == [6, 6]


def test_a_folder_is_read_back(localizer: Spec, tmp_path: Path) -> None:
    results = evaluate(
        [localizer("Noisy"), localizer("Good")], "Corridor-v0", walks=3, seeds=2, out=tmp_path, isolation="none"
    )
    again = load_results(tmp_path)
    key = ["walk", "localizer", "seed"]
    one = results.walks().sort_values(key, ignore_index=True)
    other = again.walks().sort_values(key, ignore_index=True)
    assert one.equals(other)
    file = next(tmp_path.glob(f"*{store.SUFFIX}"))
    assert len(load_results(file)) == 1


def test_results_of_older_versions_are_left_out(localizer: Spec, tmp_path: Path) -> None:
    for noise_m in (0.5, 0.0):
        evaluate(
            localizer("Good"),
            "Corridor-v0",
            walks=3,
            out=tmp_path,
            isolation="none",
            parameters={"noise_m": noise_m},
            seeds=1,
        )
    with pytest.warns(UserWarning, match="3 results .* older versions"):
        results = load_results(tmp_path)
    assert {r.provenance["parameters"]["noise_m"] for r in results.results} == {0.0}  # type: ignore[index]
    assert len(results) == 3


def test_failed_walks_are_counted_and_scored_and_an_empty_folder_is_an_error(localizer: Spec, tmp_path: Path) -> None:
    results = evaluate(localizer("RaisesInStep"), "Corridor-v0", walks=5, isolation="none", seeds=1)
    row = results.rows()[0]
    assert (row["failed"], row["metrics"]["mean_m"]["n"]) == (5, 5)
    assert not math.isnan(row["metrics"]["mean_m"]["value"])
    assert "failed on 5 of 5 walks" in results.table()
    with pytest.raises(ResultError, match="no results in"):
        load_results(tmp_path)


def test_results_show_themselves_in_a_notebook(results: Results, localizer: Spec) -> None:
    assert [r.walk for r in results] == [r.walk for r in results.results] and len(list(results)) == len(results) == 36
    page = results._repr_html_()
    assert page.index(localizer("Noisy")) < page.index(localizer("Worse")) and "<h4>Corridor-v0, test split" in page
    (ax,) = results.plot_cdf().axes
    names = [text.get_text().partition(": ")[0] for text in ax.get_legend().get_texts()]
    assert names == [localizer("Noisy"), localizer("Worse")], "what declined has no errors"
    walk = results.plot_walk(-1)
    assert "walk test-005" in walk.get_suptitle() and walk._repr_png_().startswith(b"\x89PNG")
    assert localizer("Oracle") not in {text.get_text() for text in walk.legends[0].get_texts()}
    with pytest.raises(PdrbenchError, match="there are 6 walks, counted from 0; got 6"):
        results.plot_walk(6)


def test_each_localizer_against_one(results: Results, localizer: Spec) -> None:
    noisy, worse, oracle = (localizer(name) for name in ("Noisy", "Worse", "Oracle"))
    compared = results.against(worse)
    rows = {row["localizer"]: row["metrics"] for row in compared.rows()}
    ratio, of_best = rows[noisy]["ratio_against"], rows[worse]["ratio_to_best"]
    assert [ratio[k] for k in ("value", "low", "high")] == pytest.approx(
        [1 / of_best[k] for k in ("value", "high", "low")]
    )
    assert rows[noisy]["p_against"]["value"] == pytest.approx(2 / 2**6) and ratio["n"] == 6
    assert "ratio_against" not in rows[worse] and rows[oracle] == {} and "against" not in results.rows()[0]
    text = compared.table()
    assert "ratio_against" in text and "ratio_to_best" not in text and f"error over that of {worse}" in text
    assert in_a_line("ratio_against", ratio) in compared.to_latex()
    with pytest.raises(PdrbenchError, match="no localizer in these results named 'li2013'"):
        results.against("li2013")


def test_methods_say_what_was_run(results: Results, localizer: Spec) -> None:
    text = " ".join(results.against(localizer("Worse")).methods(["mean_m", "p95_m"]).split())
    version = results.results[0].provenance["versions"]["pdrbench"]  # type: ignore[index]
    for part in (
        *(
            f"pdrbench {version}",
            r"\texttt{Corridor-v0}",
            "played 6 walks of the test split in 6 walks, each with 2 seeds",
        ),
        *(
            r"\texttt{mean\_m}: Mean over walks",
            "95 \\% intervals by the spread of 6 walks",
            "comparisons with",
            "@article{holm1979",
        ),
    ):
        assert part in text, part
    assert "declined" not in text and text.count("{") == text.count("}") and "{{" not in text
