"""Sweeps with good and bad localizers."""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
import threading
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError, ResultError, UnknownNameError
from pdrbench.evaluation import Results, evaluate, load_results, pool, retrace, score, store
from pdrbench.evaluation.randomness import generator, new_nonce, secret_nonce
from pdrbench.process import Budget
from pdrbench.registry import PluginError, make_task
from pdrbench.result import COMPLETE, Result

Spec = Callable[[str], str]
ENV = "Corridor-v0"
STEPS = 13  # observations at 0, 1, ..., 12 s
SHORT = Budget(pace=0.5, slack_s=0.0, start_s=20.0)


def by_class(results: Results) -> dict[str, Result]:
    return {result.localizer.rpartition(":")[2]: result for result in results.results}


def answers(results: Results) -> list[bytes]:
    return [result.estimates.xy_m.tobytes() + result.estimates.t_s.tobytes() for result in results.results]


def test_results_come_in_order_of_walks_localizers_and_seeds(localizer: Spec) -> None:
    good, noisy = localizer("Good"), localizer("Noisy")
    results = evaluate([good, noisy], ENV, walks=2, seeds=2, isolation="none").results
    assert [(r.walk, r.localizer, r.seed) for r in results] == [
        (walk, spec, seed) for walk in ("test-000", "test-001") for spec in (good, noisy) for seed in (0, 1)
    ]
    assert all(r.status == "complete" and len(r.estimates) == STEPS and r.split == "test" for r in results)


def test_a_localizer_with_one_seed_is_compared_with_all_seeds_of_another(localizer: Spec) -> None:
    good, noisy = localizer("Good"), localizer("Noisy")
    one, five = (evaluate(name, ENV, walks=3, isolation="none", seeds=n) for name, n in ((good, 1), (noisy, 5)))
    assert answers(evaluate(good, ENV, walks=3, isolation="none")) == answers(one), "one seed, where none is named"
    results = Results((*one.results, *five.results))
    assert f"{noisy} on {ENV}: 5 seeds" in results.table()
    (ranking,) = results.rankings.values()
    assert {of.name: of.walks for of in ranking.standings} == {good: 3, noisy: 3}, "one seed stands for all five"


def test_estimates_are_the_same_whatever_the_number_of_processes(localizer: Spec) -> None:
    def run(**options: object) -> list[bytes]:
        return answers(evaluate(localizer("Noisy"), ENV, walks=6, seeds=2, **options))  # type: ignore[arg-type]

    here = run(isolation="none")
    assert run(jobs=1) == here
    assert run(jobs=2) == here
    assert run(jobs=2, isolation="none") == here, "each of them evaluates"
    assert len(set(here)) == 12, "every walk and seed has randomness of its own"


def test_randomness_depends_on_seed_environment_and_walk_only() -> None:
    stride, phone = (make_task(name) for name in ("CampusStride-v1", "CampusPhone-v1"))
    first = generator(0, stride, "w").random(4)
    assert (generator(0, stride, "w").random(4) == first).all()
    nonce = new_nonce()
    others = ((1, stride, "w"), (0, phone, "w"), (0, stride, "v"), (0, stride, "w", nonce), (0, stride, "w", "0" * 32))
    for other in others:
        assert not (generator(*other).random(4) == first).any()
    assert (generator(*others[-1]).random(4) == generator(*others[-1]).random(4)).all()


def test_a_generator_names_neither_seed_nor_walk_and_its_children_are_the_same_each_time() -> None:
    task, nonce = make_task("CampusStride-v1"), "9" * 32
    seeds = generator(7, task, "w", nonce).bit_generator.seed_seq
    assert isinstance(seeds, np.random.SeedSequence)
    assert not seeds.spawn_key
    assert int(seeds.entropy) > 1 << 128, "a digest, in which no seed stands"
    first, second = (
        [child.random() for child in generator(7, task, "w", nonce).spawn(3)],
        [child.random() for child in generator(7, task, "w", nonce).spawn(3)],
    )
    assert first == second
    assert len({*first, *(child.random() for child in generator(8, task, "w", nonce).spawn(3))}) == 6


def test_a_nonce_changes_what_is_drawn_and_repeats_it(localizer: Spec, tmp_path: Path) -> None:
    def run(nonce: str, isolation: str = "none") -> Results:
        return evaluate(
            localizer("Noisy"), ENV, walks=1, nonce=nonce, out=tmp_path / isolation, isolation=isolation, seeds=1
        )  # type: ignore[arg-type]

    nonce = new_nonce()
    fixed, drawn = run(""), run(nonce)
    assert "nonce" not in fixed.results[0].provenance
    assert drawn.results[0].provenance["nonce"] == nonce
    assert answers(fixed) != answers(drawn)
    assert answers(run(nonce, "process")) == answers(drawn), "the same in another process"
    assert [frame.estimate for frame in retrace(drawn.results[0])], "it can be played again from what it says"
    with pytest.warns(UserWarning, match="1 results"):
        assert len(load_results(tmp_path / "none")) == 1, "results of two nonces are not averaged"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"nonce": "1234"}, "32 digits"),
        ({"nonce": "G" * 32}, "32 digits"),
        ({"nonce": "0" * 32 + "\n"}, "32 digits"),
        ({"nonce": "0" * 32, "secret": "s" * 64, "split": "heldout"}, "follows from its secret"),
    ],
)
def test_nonces_that_are_none_are_errors(localizer: Spec, options: dict[str, str], message: str) -> None:
    with pytest.raises(PdrbenchError, match=message):
        evaluate(localizer("Noisy"), ENV, **options)  # type: ignore[arg-type]


def test_held_out_walks_have_a_nonce_that_no_result_tells(localizer: Spec) -> None:
    first, second = (
        evaluate(
            localizer("Noisy"),
            "CampusStride-v1",
            walks=1,
            split="heldout",
            secret=secret * 64,
            isolation="none",
            seeds=1,
        ).results[0]
        for secret in "ab"
    )
    nonce = secret_nonce("a" * 64)
    assert nonce != secret_nonce("b" * 64)
    assert nonce not in repr(first.provenance)
    assert "nonce" not in first.provenance
    assert first.estimates.columns.tobytes() != second.estimates.columns.tobytes()


def test_the_global_generator_is_left_alone(localizer: Spec) -> None:
    before = np.random.get_state()[1].copy()  # noqa: NPY002
    evaluate(localizer("Noisy"), ENV, walks=1, isolation="none", seeds=1)
    assert (np.random.get_state()[1] == before).all()  # noqa: NPY002


def test_localizers_that_answer_badly_or_raise_give_results_that_say_so(localizer: Spec) -> None:
    names = (
        *("NotFinite", "WrongShape", "WrongType", "RaisesInConstruction", "RaisesInReset"),
        *("RaisesInStep", "RunsOutOfMemory", "Exits", "Interrupts", "Unsuitable", "Good"),
    )
    found = by_class(evaluate([localizer(name) for name in names], ENV, walks=1, seeds=1))
    missing = {name: dict(found[name].missing) for name in ("NotFinite", "WrongShape", "WrongType")}
    assert missing == {"NotFinite": {"nan": 1}, "WrongShape": {"shape": 1}, "WrongType": {"type": 1}}
    assert all(found[name].status == "complete" for name in (*missing, "Good"))
    for name, answered, reason in (
        ("RaisesInConstruction", 0, "RuntimeError: no weights"),
        ("RaisesInReset", 0, "RuntimeError: reset went wrong"),
        ("RaisesInStep", 4, "ZeroDivisionError: step went wrong"),
        ("RunsOutOfMemory", 4, "MemoryError"),
        ("Exits", 4, "raised SystemExit: 3"),
        ("Interrupts", 4, "raised KeyboardInterrupt"),
    ):
        assert found[name].status == "failed", name
        assert reason in found[name].failure, name
        assert len(found[name].estimates) == answered, "what was answered before is kept"
        assert np.isfinite(found[name].step_s).all(), name
    assert (found["Unsuitable"].status, found["Unsuitable"].failure) == ("unsuitable", "needs an altimeter")


def test_a_failed_walk_scores_as_one_that_stopped_answering(localizer: Spec) -> None:
    results = evaluate(
        [localizer("Good"), localizer("RaisesInStep"), localizer("RaisesInReset")], ENV, walks=1, seeds=1
    )
    good, stopped, silent = (scored.scores["mean_m"] for scored in results.scored)
    assert good < 1e-9 < stopped < silent


def test_hanging_localizers_are_ended(localizer: Spec) -> None:
    """In Python, in `reset`, catching everything, and in compiled code that holds the interpreter's lock."""
    names = ("HangsInPython", "HangsInReset", "SwallowsTheAlarm", "NeverGivesUp", "HangsInC", "Good")
    budget = Budget(pace=0.5, slack_s=0.0, start_s=5.0)
    found = by_class(evaluate([localizer(n) for n in names], ENV, walks=1, budget=budget, seeds=1, jobs=3))
    assert [found[name].status for name in names] == ["failed"] * 5 + ["complete"]
    assert "timeout: reset took longer than the" in found["HangsInReset"].failure.splitlines()[-1]
    for name in names[2:5]:
        assert "timeout: step 5 took longer than the 0.5 s" in found[name].failure.splitlines()[-1], name
        assert sys.platform == "win32" or "in misbehave" in found[name].failure, "the traceback says where it hung"
        assert len(found[name].estimates) == 4, "what was answered before is kept"
        assert found[name].provenance["missed"] == STEPS - 4


@pytest.mark.skipif(os.name != "posix", reason="kills with a signal")
def test_a_walk_over_which_a_worker_ended_is_not_shown_again(localizer: Spec, tmp_path: Path) -> None:
    """Whoever ended the worker: in a second pass a localizer would know its future."""
    mark = tmp_path / "mark"
    names = [localizer("KillsTheWorkerOnce"), localizer("Good")]
    options: dict[str, Any] = {"walks": 1, "seeds": 1, "isolation": "process", "out": tmp_path / "out"}
    (result,) = evaluate(names[:1], ENV, parameters={"path": str(mark)}, **options).results
    assert (result.status, mark.read_text()) == ("failed", "x"), "one pass"
    assert "not played again" in result.failure
    (honest,) = evaluate(names[1:], ENV, **options).results
    assert honest.status == "complete", "a new worker"


def test_nothing_is_computed_twice(localizer: Spec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    counter = tmp_path / "counter"
    monkeypatch.setenv("CORRIDOR_COUNTER", str(counter))
    out = tmp_path / "out"

    def run(**options: object) -> int:
        evaluate(localizer("Slow"), ENV, out=out, **({"isolation": "none", "seeds": 1} | options))  # type: ignore[arg-type]
        return len(counter.read_text().splitlines())

    assert run(walks=3) == 3
    assert run(walks=3) == 3
    assert run(walks=5) == 5
    assert run(walks=5, seeds=2) == 10
    assert run(walks=5, parameters={"noise_m": 0.5}) == 15, "other parameters are another result"
    assert run(walks=5, budget=Budget(pace=3.0)) == 20, "another budget is another result"


def test_only_the_walks_played_are_loaded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of 203."""
    loads = tmp_path / "loads"
    monkeypatch.setenv("CORRIDOR_LOADS", str(loads))
    pool.discard()  # processes of an earlier test would not see the variable
    results = evaluate("stay", ENV, walks=2, jobs=2, out=tmp_path / "out", seeds=1)
    assert set(results.walks()["walk"]) == {"test-000", "test-001"}
    loaded = [line.split()[0] for line in loads.read_text().splitlines()]
    assert Counter(loaded) == {"test-000": 2, "test-001": 2}  # for the walk and the score
    assert evaluate("stay", ENV, walks=2, out=tmp_path / "out", seeds=1).results[0].status == COMPLETE
    other = dataclasses.replace(results.results[0], provenance={"files_sha256": "0" * 64})
    with pytest.raises(ResultError, match="files with the digest 000000000000, the present one"):
        score(other)


def test_a_localizer_whose_source_changed_is_run_again_in_new_processes(tmp_path: Path, localizer: Spec) -> None:
    file = tmp_path / "mine.py"
    original = Path(localizer("").removesuffix(":")).read_text()
    spec = f"{file}:Good"

    def mean_m(source: str) -> float:
        file.write_text(source)
        return evaluate(spec, ENV, walks=1, out=tmp_path / "out", seeds=1).scored[0].scores["mean_m"]

    assert mean_m(original) < 1e-9
    changed = original.replace("self.x_m, self.count, self.rng = 0.0", "self.x_m, self.count, self.rng = 3.0")
    assert mean_m(changed) == pytest.approx(3.0)
    assert mean_m(original) < 1e-9
    assert len(list((tmp_path / "out").glob(f"*{store.SUFFIX}"))) == 2


def test_torn_results_are_computed_again_with_a_notice(localizer: Spec, tmp_path: Path) -> None:
    before = evaluate(localizer("Noisy"), ENV, walks=3, out=tmp_path, isolation="none", seeds=1)
    victim = sorted(tmp_path.glob(f"*{store.SUFFIX}"))[1]
    victim.write_bytes(victim.read_bytes()[:-9])
    with pytest.raises(ResultError, match="torn"):
        load_results(tmp_path)
    with pytest.warns(UserWarning, match="torn.*computed again"):
        after = evaluate(localizer("Noisy"), ENV, walks=3, out=tmp_path, isolation="none", seeds=1)
    assert answers(after) == answers(before) == answers(load_results(tmp_path))


def test_a_write_that_fails_in_a_worker_is_an_error(localizer: Spec, tmp_path: Path) -> None:
    """The kernel cuts a real write short: no file may exceed 4096 bytes."""
    script = (
        "import resource, sys\n"
        "sys.path[:] = sys.argv[3].split(':')\n"
        "from pdrbench.evaluation import evaluate\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))\n"
        "evaluate(sys.argv[1], 'Corridor-v0', walks=2, out=sys.argv[2], parameters={'noise_m': 1.0}, seeds=1)\n"
    )
    big = tmp_path / "big.py"
    source = Path(localizer("").removesuffix(":")).read_text()
    big.write_text(source.replace("self.misbehave() if", "self.fail() if") + FAILING)
    run = subprocess.run(
        [sys.executable, "-c", script, f"{big}:Good", str(tmp_path / "out"), ":".join(sys.path)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert "ResultError: cannot write result" in run.stderr
    assert "File too large" in run.stderr
    assert [path.name for path in (tmp_path / "out").iterdir()] == [".locks"]


FAILING = """
def _fail(self):
    raise RuntimeError("x" * 5000)
Good.fail = _fail
"""


def test_leftovers_of_ended_processes_are_removed(localizer: Spec, tmp_path: Path) -> None:
    name = "Corridor-v0.x.test-000.s0.0123.result"
    (tmp_path / ".working-0123-1").write_text(f"{name}\n")
    (tmp_path / f".{name}.abcd.tmp").write_bytes(b"half")
    evaluate(localizer("Good"), ENV, walks=1, out=tmp_path, isolation="none", seeds=1)
    assert [path.name for path in tmp_path.glob(".*")] == [".locks"]


def test_files_of_running_processes_are_left_alone(localizer: Spec, tmp_path: Path) -> None:
    """Another process holds the claim on the only walk for a while; then the walk is computed."""
    evaluate(localizer("Good"), ENV, walks=1, out=tmp_path, isolation="none", seeds=1)
    (path,) = tmp_path.glob(f"*{store.SUFFIX}")
    path.unlink()
    half = tmp_path / f".{path.name}.abcd.tmp"
    half.write_bytes(b"half")
    script = (
        "import sys, time; sys.path[:] = sys.argv[3].split(':')\n"
        "from pathlib import Path; from pdrbench.evaluation.locks import ResultLocks\n"
        "with ResultLocks(Path(sys.argv[1]), 'other').hold(sys.argv[2]) as note:\n"
        "    print(note is not None, flush=True); sys.stdin.read()\n"
    )
    command = [sys.executable, "-c", script, str(tmp_path), path.name, ":".join(sys.path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdin is not None
        assert other.stdout is not None
        assert other.stdout.readline() == "True\n"
        waiting = threading.Thread(
            target=evaluate, args=(localizer("Good"), ENV), kwargs={"walks": 1, "out": tmp_path, "isolation": "none"}
        )
        waiting.start()
        waiting.join(0.7)
        assert waiting.is_alive()
        assert half.exists(), "it may be the other's"
        assert not path.exists()
        other.stdin.close()
        waiting.join()
    assert path.exists()
    assert not half.exists()


def test_a_localizer_that_wants_the_truth_is_declined_on_test_splits_only(localizer: Spec) -> None:
    for split in ("train", "val"):
        results = evaluate(localizer("Oracle"), ENV, split=split, seeds=1)
        assert max(scored.scores["mean_m"] for scored in results.scored) < 1e-4
    declined = evaluate(localizer("Oracle"), ENV, walks=2, seeds=1).results
    assert [r.status for r in declined] == ["unsuitable"] * 2
    assert "needs the reference" in declined[0].failure
    assert len(declined[0].estimates) == 0


def test_provenance_names_the_inputs_of_a_result(localizer: Spec) -> None:
    (result,) = evaluate(localizer("Good"), ENV, walks=1, parameters={"noise_m": 0.5}, seeds=1).results
    about = result.provenance
    assert about["parameters"] == {"noise_m": 0.5}
    assert all(len(str(about[digest])) == 64 for digest in ("localizer_sha256", "key"))
    assert about["environment"] == "corridor-plugin 1.0"
    assert set(about["versions"]) == {"pdrbench", "numpy", "python"}  # type: ignore[call-overload]
    assert set(about["machine"]) == {"cpu", "cores", "system", "architecture"}  # type: ignore[call-overload]


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"localizers": "stayy-v0"}, UnknownNameError, "no localizer named 'stayy-v0'"),
        ({"envs": "Coridor-v0"}, UnknownNameError, "did you mean 'Corridor-v0'"),
        ({"split": "tset"}, UnknownNameError, "did you mean 'test'"),
        ({"localizers": "nowhere.py:Good"}, PluginError, r"no file .*nowhere\.py"),
        ({"localizers": "no_such_module:Good"}, PluginError, "no module 'no_such_module'"),
        ({"localizers": "corridor_plugin:Nothing", "isolation": "none"}, PluginError, "Nothing"),
        ({"localizers": "corridor_plugin:Nothing", "isolation": "confined"}, PluginError, "registers environments"),
        ({"isolation": "some"}, PdrbenchError, "isolation is one of process, confined, none"),
        ({"budget": Budget(), "walks": "2"}, PdrbenchError, "walks is a whole number"),
        ({"localizers": "corridor_plugin:WALKS", "isolation": "none"}, PluginError, "not a class"),
        ({"jobs": 0}, PdrbenchError, "jobs is a whole number, at least 1"),
        ({"seeds": 1.5}, PdrbenchError, "seeds is a whole number"),
        ({"localizers": int}, PdrbenchError, "are named"),
        ({"walks": 0}, PdrbenchError, "walks is a whole number, at least 1"),
        ({"localizers": []}, PdrbenchError, "at least one localizer"),
        ({"localizers": ["a:B", "c:D"], "parameters": {"x": 1}}, PdrbenchError, "one localizer"),
        ({"parameters": {"x": {1, 2}}}, ResultError, "JSON cannot hold"),
    ],
)
def test_mistakes_of_the_user_are_errors(
    localizer: Spec, options: dict[str, object], error: type[PdrbenchError], message: str
) -> None:
    with pytest.raises(error, match=message):
        evaluate(**({"localizers": localizer("Good"), "envs": ENV, "walks": 1} | options))  # type: ignore[arg-type]


def test_progress_is_plain_lines_off_a_terminal(localizer: Spec, capsys: pytest.CaptureFixture[str]) -> None:
    evaluate([localizer("Good"), localizer("RaisesInStep")], ENV, walks=2, progress=True, isolation="none", seeds=1)
    printed = capsys.readouterr()
    assert printed.out == ""
    assert printed.err.startswith("4 walks, about ")
    assert printed.err.splitlines()[1:] == ["0/4 walks", "4/4 walks, 2 failed"]
    evaluate(localizer("Good"), ENV, walks=2, isolation="none", seeds=1)
    assert capsys.readouterr().err == ""


RUDE = """
import os
import numpy as np
from pdrbench.localizer import Estimate

class Rude:
    def reset(self, briefing, rng):
        np.seterr(all="raise")
        os.chdir("/")
    def step(self, observation):
        return Estimate(np.zeros(2), 0)
"""


def test_numeric_errors_and_folder_are_as_before_after_every_walk(tmp_path: Path) -> None:
    (tmp_path / "rude.py").write_text(RUDE)
    before = np.geterr(), Path.cwd()
    results = evaluate(
        f"{tmp_path / 'rude.py'}:Rude", "CampusStride-v1", split="val", walks=2, isolation="none", seeds=1
    )
    assert [result.status for result in results.results] == ["complete", "complete"]
    assert (np.geterr(), Path.cwd()) == before
    assert Path.cwd() != Path("/")
