"""Reproductions: measured seeds are kept, however a process ends."""

from __future__ import annotations

import dataclasses
import importlib
import itertools
import json
import math
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError, ResultError, UnknownNameError
from pdrbench.evaluation.jobs import JobContext
from pdrbench.evaluation.scheduler import run_all
from pdrbench.registry import PluginError
from pdrbench_lab import REPRODUCTIONS
from pdrbench_lab.reproduce.experiments import measure, plain_numbers, plan_experiments
from pdrbench_lab.reproduce.reproduce import draw_figures, load_reproduction, reproduce
from pdrbench_lab.reproduce.reproduction import (
    Claim,
    ClaimError,
    Experiment,
    Gate,
    Reproduction,
    fraction_over_seeds,
    mean_over_seeds,
    median_over_seeds,
    pooled_percentile,
)

PLUGIN = Path(__file__).parent / "plugin"
TOY = "toy_claims:TOY"
SCRIPT = """
import sys
sys.path[:] = sys.argv[2].split(":")
from pdrbench_lab.reproduce.reproduce import reproduce
reproduce("toy_claims:TOY", sys.argv[1], jobs=2, seeds=40)
"""


@pytest.fixture(autouse=True)
def counter(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A file with a line for every call of an experiment."""
    monkeypatch.syspath_prepend(str(PLUGIN))
    path = tmp_path / "counter"
    path.touch()
    monkeypatch.setenv("TOY_COUNTER", str(path))
    return path


def calls(counter: Path) -> Counter[str]:
    return Counter(counter.read_text().splitlines())


def test_values_are_the_closed_forms_and_a_full_run_adds_to_a_quick_one(tmp_path: Path, counter: Path) -> None:
    quick = reproduce(TOY, tmp_path, quick=True, jobs=2)
    assert [row["seeds"] for row in quick.rows] == [3] * 4
    assert sum(calls(counter).values()) == 3 + 1
    found = reproduce(TOY, tmp_path, jobs=2)
    assert set(calls(counter).values()) == {1}, "nothing is measured twice"
    assert sum(calls(counter).values()) == 8 + 2
    p75, pooled, largest, fraction = found.rows
    # The errors of seed s are s + 0...8: Hazen's 75 % is s + 6.25. Medians of 8 seeds lie at 3.5, their interval at
    # the first and last (P(0 below) = 0.4 %, P(at most 1 below) = 3.5 %).
    assert (p75["ours"], p75["low"], p75["high"], p75["pass"]) == (9.75, 6.25, 13.25, True)
    assert pooled["ours"] == 7.5 and pooled["low"] < 7.5 < pooled["high"] and pooled["pass"] is True
    assert (largest["ours"], largest["pass"], largest["gate"]) == (15.0, False, "≤ 14 m")
    assert fraction["ours"] == 0.75 and fraction["pass"] is None and fraction["gate"] == ""
    stored = json.loads((tmp_path / "toy" / "claims.json").read_text())
    assert [row["ours"] for row in stored["claims"]] == [row["ours"] for row in found.rows]
    assert "| T1 | error, 75 % | 10 m | 9.75 m | 6.25 m to 13.2 m | ≤ 10 m | yes | 8 |" in found.to_markdown()


def test_seeds_are_measured_in_order(tmp_path: Path, counter: Path) -> None:
    """Experiments of a seed share its walk, which a process keeps as long as no others come between."""
    reproduce(TOY, tmp_path, jobs=1)
    assert list(calls(counter)) == [*(f"steps {seed}" for seed in range(8)), "clock 0", "clock 1"]


def test_processes_change_nothing_and_timings_run_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TOY_SLEEP_S", "0.02")
    one, two = (reproduce(TOY, tmp_path / f"{jobs}", jobs=jobs, seeds=5) for jobs in (1, 2))
    for first, second in zip(one.measured["steps"], two.measured["steps"], strict=True):
        for name in first.keys() - {"span_s"}:
            np.testing.assert_array_equal(first[name], second[name])
    assert math.isnan(two.measured["steps"][0]["never"])  # type: ignore[arg-type]
    assert np.asarray(two.measured["steps"][0]["endless"]).tolist() == [math.inf, -math.inf, 0.1]
    spans_s = [np.asarray(run["span_s"]) for run in two.measured["clock"]]
    others_s = [np.asarray(run["span_s"]) for run in two.measured["steps"]]
    ends_s = sorted(spans_s, key=lambda span: span[0])
    assert all(before[1] < after[0] for before, after in itertools.pairwise(ends_s))
    assert max(span[1] for span in others_s) < ends_s[0][0]


def test_a_seed_that_fails_is_reported_and_tried_again(
    tmp_path: Path, counter: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TOY_RAISES", "2")
    found = reproduce(TOY, tmp_path, jobs=2)
    (failure,) = found.failures
    assert (failure.experiment, failure.seed) == ("steps", 2)
    assert failure.last_line == "ZeroDivisionError: seed 2 fell over" and "toy_claims.py" in failure.why
    assert failure.path.read_text() == failure.why
    p75 = found.rows[0]
    assert (p75["ours"], p75["seeds"], p75["failed"]) == (6.25 + 4, 7, 1)  # of 0, 1, 3, 4, 5, 6, 7
    pooled = found.rows[1]
    assert Gate(7.0, 8.0).holds(pooled["ours"]) and pooled["pass"] is False, "not every seed stands behind it"
    assert found.rows[3]["pass"] is None and "| 7, 1 failed |" in found.to_markdown()
    monkeypatch.delenv("TOY_RAISES")
    again = reproduce(TOY, tmp_path, jobs=2)
    assert not again.failures and again.rows[1]["pass"] is True and not failure.path.exists()
    assert calls(counter)["steps 2"] == 2 and sum(calls(counter).values()) == 8 + 2 + 1


def test_a_process_that_ends_costs_its_seed_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TOY_DIES", "1")
    found = reproduce(TOY, tmp_path, jobs=2, seeds=3)
    (failure,) = found.failures
    assert (failure.experiment, failure.seed) == ("steps", 1) and "SIGKILL" in failure.last_line
    assert [row["seeds"] for row in found.rows] == [2] * 4
    assert len(found.measured["clock"]) == 3


@pytest.mark.parametrize("blow", [signal.SIGKILL, signal.SIGINT])
def test_a_killed_run_resumes_where_it_stopped(blow: signal.Signals, tmp_path: Path, counter: Path) -> None:
    seeds = tmp_path / "toy" / "seeds"
    run = subprocess.Popen(
        [sys.executable, "-c", SCRIPT, str(tmp_path), ":".join(sys.path)],
        env=os.environ | {"TOY_SLEEP_S": "0.05"},
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's "&" makes children ignore it
    )
    while run.poll() is None and len(list(seeds.glob("steps.*.json"))) < 3:
        time.sleep(0.005)
    run.send_signal(blow)
    assert run.wait(timeout=20) == -blow
    assert run.stderr is not None
    run.stderr.read()  # ends when no worker holds the pipe any more: orphans leave too
    kept = {path.name: path.read_bytes() for path in seeds.glob("*.json")}
    assert 3 <= len(kept) < 40
    begun = sum(calls(counter).values())
    found = reproduce(TOY, tmp_path, jobs=2)
    assert not found.failures and len(found.measured["steps"]) == 8
    assert {name: (seeds / name).read_bytes() for name in kept} == kept
    missing = 8 + 2 - sum(int(name.split(".")[1][1:]) < 8 for name in kept if name.startswith("steps"))
    assert sum(calls(counter).values()) == begun + missing
    assert {path.suffix for path in seeds.iterdir() if path.name != ".locks"} == {".json"}, "no leftovers"


def test_torn_files_are_measured_again_and_edited_sources_too(
    tmp_path: Path, counter: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = tmp_path / "site"
    place.mkdir()
    source = (PLUGIN / "toy_claims.py").read_text()
    (place / "edited_claims.py").write_text(source)
    monkeypatch.syspath_prepend(str(place))
    name = "edited_claims:MISTAKEN"
    reproduce(name, tmp_path)
    (file,) = (tmp_path / "mistaken" / "seeds").glob("*.json")
    file.write_bytes(file.read_bytes()[:100])
    with pytest.warns(UserWarning, match="torn.*computed again"):
        reproduce(name, tmp_path)
    assert calls(counter)["steps 0"] == 2
    (place / "edited_claims.py").write_text(source + "\nEDITED = True\n")
    reproduce(name, tmp_path)
    assert calls(counter)["steps 0"] == 3
    assert len(list((tmp_path / "mistaken" / "seeds").glob("*.json"))) == 2, "what other sources gave is kept"


def test_sources_that_change_meanwhile_end_the_run(tmp_path: Path) -> None:
    """The orders are for other sources than those that a new process finds."""
    (job,) = plan_experiments(
        [Experiment("steps", "toy_claims:steps", seeds=1, quick_seeds=1)], {"steps": 1}, ["toy_claims"]
    )
    job = dataclasses.replace(job, sources=dict(job.sources) | {"toy_claims": "0" * 64})
    context = JobContext(tmp_path, "run", os.getpid(), measure)
    with pytest.raises(ResultError, match="sources changed"):
        run_all([job], context, 1, is_warm=False, progress=False, what="measurements")
    assert not list(tmp_path.glob("*.json"))


def test_a_wrong_claim_does_not_hide_the_others(tmp_path: Path) -> None:
    mistake, misspelling, right = reproduce("toy_claims:MISTAKEN", tmp_path).rows
    assert math.isnan(mistake["ours"]) and mistake["pass"] is False
    assert mistake["note"] == "LookupError: a mistake in a claim"
    assert misspelling["pass"] is None and "no 'eror_m'; it returns endless, error_m" in misspelling["note"]
    assert right["ours"] == 8.0 and right["pass"] is True


def test_figures_are_drawn_once_for_the_same_numbers(
    tmp_path: Path, counter: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = reproduce(TOY, tmp_path, quick=True)
    (file,) = draw_figures(found)
    assert file == tmp_path / "toy" / "figures" / "errors.txt" and file.read_text() == "3 seeds, quick True"
    assert draw_figures(found) == [file] and calls(counter)["figures 0"] == 1
    more = reproduce(TOY, tmp_path, seeds=4)
    assert draw_figures(more) == [file] and file.read_text() == "4 seeds, quick False"
    file.unlink()
    monkeypatch.setenv("TOY_NO_FIGURES", "1")
    with pytest.raises(PluginError, match=r"figures of toy failed[\s\S]*no ink"):
        draw_figures(more)


def test_unknown_and_broken_names() -> None:
    with pytest.raises(PluginError, match=r"'lost'|nowhere"):
        load_reproduction("toy_claims:GONE")
    with pytest.raises(PluginError, match="is int, no Reproduction"):
        load_reproduction("toy_claims:NAMELESS")
    with pytest.raises(PluginError, match="ModuleNotFoundError"):
        load_reproduction("no_such_package:TOY")
    with pytest.raises(UnknownNameError, match="no reproduction named 'missing1999'"):
        load_reproduction("missing1999")
    with pytest.raises(PdrbenchError, match="seeds is a whole number"):
        reproduce(TOY, "nowhere", seeds=0)


@pytest.mark.parametrize("name", sorted(REPRODUCTIONS))
def test_registered_reproductions_load(name: str) -> None:
    found, _ = load_reproduction(name)
    assert found.claims and all(claim.id and claim.what and claim.paper for claim in found.claims)
    for experiment in found.experiments:
        module, _, measure = experiment.measure.partition(":")
        assert callable(getattr(importlib.import_module(module), measure))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Experiment("Tracking", "m:f"), "small letters"),
        (lambda: Experiment("tracking", "m.f"), "package.module:function"),
        (lambda: Experiment("tracking", "m:f", seeds=2, quick_seeds=3), "quick_seeds"),
        (lambda: Reproduction("a/b", "X", (), ()), "name is that of a folder"),
        (lambda: Gate(), "lower end, an upper end or both"),
        (lambda: Gate(2.0, 1.0), "in order"),
        (lambda: Reproduction("x", "X", (Experiment("a", "m:f"),) * 2, ()), "listed twice: a"),
        (lambda: Reproduction("x", "X", (), (Claim("W1", "p", "1", "a", fraction_over_seeds("k")),)), "experiment 'a'"),
    ],
)
def test_implausible_arguments_are_refused(make: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()  # type: ignore[operator]


def test_the_interval_of_a_median_is_made_of_order_statistics() -> None:
    """P(at most 5 of 20 below the median) = 2.1 %, at most 6: 5.8 %; so the sixth value from either end bounds it."""
    value = median_over_seeds("x")
    found = value([{"x": float(x)} for x in range(20)])
    assert (found.ours, found.low, found.high) == (9.5, 5.0, 14.0)
    few = value([{"x": float(x)} for x in range(5)])
    assert few.ours == 2.0 and math.isnan(few.low)
    censored = value([{"x": float(x)} for x in (1, 2, 3, math.inf, math.inf, math.inf, math.nan)])
    assert censored.ours == math.inf and (censored.low, censored.high) == (1.0, math.inf)
    assert median_over_seeds("x")([{"x": math.inf}] * 2).ours == math.inf


def test_fractions_are_bounded_by_the_number_of_seeds() -> None:
    always = fraction_over_seeds("found")([{"found": np.ones(1000)}] * 20)
    assert always.ours == always.high == 1.0 and always.low == pytest.approx(0.839, abs=1e-3), (
        "20 seeds, not 20 000 runs"
    )
    mixed = fraction_over_seeds("found")([{"found": float(k < 15)} for k in range(20)])
    assert mixed.ours == 0.75 and (mixed.low, mixed.high) == pytest.approx((0.531, 0.888), abs=1e-3)  # Wilson, n = 20
    same = fraction_over_seeds("found")([{"found": np.arange(100) < 75 + k % 3 - 1} for k in range(20)])
    assert mixed.low < same.low < same.ours < same.high < mixed.high, "seeds that agree say more"
    with pytest.raises(ClaimError, match="truth values"):
        fraction_over_seeds("x")([{"x": 3.0}])


def test_the_interval_of_pooled_samples_resamples_seeds(rng: np.random.Generator) -> None:
    runs = [{"error_m": np.full(1000, float(seed)), "flag": 1.0} for seed in range(10)]
    found = pooled_percentile("error_m", 0.5)(runs)
    assert found.ours == 4.5 and found.high - found.low >= 2, "10 values, however often they are repeated"
    mean = mean_over_seeds("error_m", np.mean)(runs)
    assert mean.ours == 4.5 and mean.low < 4.5 < mean.high
    with pytest.raises(ClaimError, match="say which one"):
        mean_over_seeds("error_m")(runs)
    assert pooled_percentile("error_m", 0.5)(runs) == found, "the same numbers, the same interval"


@pytest.mark.parametrize("returned", [None, {}, {"a": "text"}, {"a": np.zeros((2, 2))}, {1: 2.0}, {"a": None}])
def test_values_that_are_no_numbers_are_refused(returned: object) -> None:
    with pytest.raises(TypeError):
        plain_numbers(returned)
