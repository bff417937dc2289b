"""A localizer behind its process answers as it does in ours, and its end is recorded."""

from __future__ import annotations

import os
import subprocess
import sys
import textwrap
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from pdrbench.episode import Episode, play
from pdrbench.errors import UnsuitableError
from pdrbench.evaluation import evaluate
from pdrbench.isolation import Budget, LocalizerExit, LocalizerTimeout, child_process
from pdrbench.isolation.child_process import IsolationError
from pdrbench.isolation.confine import Limits
from pdrbench.isolation.isolated import IsolatedLocalizer, LocalizerRaised, Terms
from pdrbench.isolation.launcher_client import discard, warm_launcher
from pdrbench.isolation.shared_processor import SchedulerStats, SharedProcessor
from pdrbench.localizer import Briefing, Observation
from pdrbench.recording import Recording
from pdrbench.registry import make_localizer, make_task
from pdrbench.task import Task

ODD = """
    import os, sys, threading, time
    import numpy as np
    from pdrbench.errors import UnsuitableError
    from pdrbench.localizer import Estimate

    VISITS = []

    class Walks:
        '''Walks along x by a draw of its own, and claims everything; every fifth answer is none.'''
        def reset(self, briefing, rng):
            self.rng, self.count, self.xy_m = rng.spawn(1)[0], 0, np.zeros(2)
        def step(self, observation):
            self.count += 1
            rows = observation["stride"]
            rows += 0.0  # an observation is the localizer's to write to
            self.xy_m = self.xy_m + [self.rng.normal(), rows[:, 1].sum()]
            wrong = {1: None, 2: Estimate(self.xy_m * np.nan, 0), 3: Estimate(np.zeros(3), 0), 4: "here",
                     5: Estimate(self.xy_m, 0.5), 6: Estimate(self.xy_m, 1), 7: Estimate(self.xy_m, 0, sigma_m=np.inf)}
            if self.count % 5 == 0:
                return wrong[self.count // 5 % 7 + 1]
            return Estimate(self.xy_m, -2, heading_rad=7.0, sigma_m=0.0, converged=np.bool_(self.count % 2))

    class Past(Walks):
        def revise(self):
            return np.array([[1.0, 2.0, 3.0, 0.0, np.nan, 0.5], [9.0, 2.5, 3.5, 1.0, 0.25, np.nan]])

    class Leaves(Walks):
        '''Tells what it finds, and leaves traces.'''
        def reset(self, briefing, rng):
            VISITS.append(1)
            print(len(VISITS), sorted(os.listdir()), os.environ.get("SECRET"), os.getcwd() == os.environ["HOME"])
            open("trace", "w").write("x")
            raise LookupError("that is all")

    class Sleeps(Walks):
        def __init__(self, seconds): self.seconds = seconds
        def step(self, observation):
            time.sleep(self.seconds)
            return super().step(observation)

    class Large(Walks):
        def reset(self, briefing, rng):
            self.block = np.ones(300 << 17)
            super().reset(briefing, rng)

    class Bomb(Walks):
        def step(self, observation):
            import mmap
            self.maps = []
            while True:
                block = mmap.mmap(-1, 64 << 20)
                for place in range(0, 64 << 20, 4096):
                    block[place] = 1
                self.maps.append(block)

    class Declines(Walks):
        def __init__(self): raise UnsuitableError("not \\x1b[31mthis")

    class Prints(Walks):
        def step(self, observation):
            print("x" * 300_000)
            print("the end")
            os._exit(3)

    class Compiles(Walks):
        '''Answers how many kernels of the map walk were there already.'''
        def reset(self, briefing, rng):
            import numba
            from pdrbench.filters import map_walk
            from pdrbench.filters.warm import warm_up
            mine = numba.njit(cache=True)(triple)
            assert mine(2.0) == 6.0
            warm_up()
            found = [f for f in vars(map_walk).values() if hasattr(f, "stats")]
            self.found = sum(sum(f.stats.cache_hits.values()) for f in found)
        def step(self, observation):
            return Estimate(np.array([float(self.found), 0.0]), 0)

    def triple(x):
        return 3.0 * x
"""
LIMITS = Limits()
BUDGET = Budget(pace=5.0, slack_s=10.0, start_s=60.0)
Start = Callable[..., IsolatedLocalizer]


@pytest.fixture(scope="module")
def walk() -> tuple[Task, Recording]:
    task = make_task("OfficeStride-v2")
    return task, task.load(task.split("train")[0])


@pytest.fixture(scope="module")
def odd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("odd") / "odd.py"
    file.write_text(textwrap.dedent(ODD))
    return file


@pytest.fixture
def start(odd: Path) -> Iterator[Start]:
    """Starts a class of the file; its process is ended with the test."""
    started = []

    def begin(
        name: str,
        budget: Budget = BUDGET,
        limits: Limits = LIMITS,
        isolation: Literal["auto", "process"] = "auto",
        **parameters: object,
    ) -> IsolatedLocalizer:
        terms = Terms(isolation, budget, 0.2, 1000, limits)
        localizer = IsolatedLocalizer(f"{odd}:{name}", f"{odd}:{name}", parameters=parameters, terms=terms)
        started.append(localizer)
        localizer.start()
        return localizer

    yield begin
    for localizer in started:
        localizer.close()


def brief(localizer: IsolatedLocalizer, walk: tuple[Task, Recording]) -> Briefing:
    task, recording = walk
    briefing = task.brief(recording)
    localizer.reset(briefing, np.random.default_rng(5))
    return briefing


def observation(now_s: float = 0.0) -> Observation:
    return Observation(now_s, {"stride": np.array([[now_s, 0.5, 0.0, 0.0]])})


@pytest.mark.parametrize("name", ["Walks", "Past"])
def test_estimates_fields_and_missing_answers_are_the_same_as_in_this_process(
    name: str, odd: Path, start: Start, walk: tuple[Task, Recording]
) -> None:
    task, recording = walk
    here = play(make_localizer(f"{odd}:{name}"), Episode(recording, task), np.random.default_rng(5), name=name, seed=0)
    apart = play(start(name), Episode(recording, task), np.random.default_rng(5), name=name, seed=0)
    assert (apart.status, apart.division, dict(apart.missing)) == (here.status, here.division, dict(here.missing))
    assert len(here.missing) >= (5 if name == "Walks" else 0)
    for column in ("t_s", "xy_m", "level", "heading_rad", "sigma_m", "converged"):
        assert getattr(apart.estimates, column).tobytes() == getattr(here.estimates, column).tobytes(), column


@pytest.mark.parametrize(
    ("name", "env"),
    [
        ("dead_reckoning-v0", "OfficeStride-v2"),
        pytest.param("woodman2008-v0", "OfficeStride-v2", marks=pytest.mark.long),
        pytest.param("frank2009-v0", "WlanHallway-v1", marks=pytest.mark.long),
        pytest.param("foot_ins_smooth-v0", "OfficeFoot-v2", marks=pytest.mark.long),
    ],
)
def test_registered_localizers_answer_the_same_in_every_isolation(name: str, env: str) -> None:
    found = [evaluate(name, env, split="val", walks=1, isolation=kind, seeds=1).results[0] for kind in ("none", "auto")]
    assert [result.status for result in found] == [found[0].status] * 2
    assert found[0].estimates.xy_m.tobytes() == found[1].estimates.xy_m.tobytes()
    assert found[0].estimates.sigma_m.tobytes() == found[1].estimates.sigma_m.tobytes()


def test_every_walk_begins_in_a_fresh_interpreter_and_an_empty_folder(
    start: Start, walk: tuple[Task, Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SECRET", "b3f1")
    for _ in range(2):
        localizer = start("Leaves")
        with pytest.raises(LocalizerRaised, match="LookupError: that is all"):
            brief(localizer, walk)
        assert localizer.failure.startswith("1 [] None True"), localizer.failure
        localizer.close()


@pytest.mark.confinement
def test_a_localizer_that_is_too_slow_on_the_whole_ends_when_the_slack_is_used_up(
    start: Start, walk: tuple[Task, Recording]
) -> None:
    """0.15 s a step at a pace of 0.1 s takes 0.05 s of the slack of 0.5 s: ten steps, fewer on a busy machine."""
    localizer = start("Sleeps", Budget(pace=0.5, slack_s=0.5, start_s=60.0), seconds=0.15)
    brief(localizer, walk)
    localizer.step(observation())
    steps = 0
    with pytest.raises(LocalizerTimeout, match=r"^timeout: step \d+ took longer than the 0\.1\d* s it had"):
        while steps < 20:
            localizer.step(observation())
            steps += 1
    assert 3 <= steps <= 10
    assert "in step" in localizer.failure, "the traceback says where it was"


def test_peak_memory_is_reported_and_too_much_ends_the_localizer(start: Start, walk: tuple[Task, Recording]) -> None:
    large = start("Large")
    brief(large, walk)
    assert 350 < float(str(large.close()["peak_mb"])) < 800
    bomb = start("Bomb", limits=Limits(memory_mb=700), isolation="process")  # the other gives it no shared memory
    brief(bomb, walk)
    with pytest.raises(LocalizerExit, match=r"process was ended: memory: it uses \d+ MB"):
        bomb.step(observation())
    assert "memory: it uses" in bomb.failure


def test_declining_is_no_failure_and_its_message_is_plain(start: Start) -> None:
    with pytest.raises(UnsuitableError, match=r"^not \?\[31mthis$"):
        start("Declines")


def test_the_end_of_what_it_printed_is_part_of_its_failure(start: Start, walk: tuple[Task, Recording]) -> None:
    localizer = start("Prints")
    brief(localizer, walk)
    with pytest.raises(LocalizerExit, match=r"exit code \(3\)"):
        localizer.step(observation())
    assert "the end\nthe localizer's process ended with exit code (3)" in localizer.failure
    assert len(localizer.failure) < 20_000


@pytest.mark.long
def test_what_a_localizer_imports_is_compiled_before_its_first_walk_and_what_it_compiles_is_not_kept(
    odd: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The cache is empty at first; kernels of the toolbox come from it in each walk, and it holds nothing of theirs."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    script = (
        "import sys; sys.path[:] = sys.argv[2].split(':')\n"
        "from pdrbench.evaluation import evaluate\n"
        "results = evaluate(sys.argv[1], 'OfficeStride-v2', split='val', walks=2, seeds=1).results\n"
        "print(*(r.status for r in results), *(int(r.estimates.xy_m[0, 0]) for r in results))\n"
    )
    command = [sys.executable, "-c", script, f"{odd}:Compiles", ":".join(sys.path)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert run.stdout.split()[:2] == ["complete", "complete"], run.stderr
    first, second = (int(word) for word in run.stdout.split()[2:])
    assert first == second > 0, "kernels of the toolbox that were found compiled"
    assert not list(tmp_path.glob("odd*"))


@pytest.mark.confinement
def test_a_launcher_that_is_gone_is_reported_and_replaced(start: Start, walk: tuple[Task, Recording]) -> None:
    localizer = start("Walks")
    brief(localizer, walk)
    warm_launcher(True, Limits())._process.kill()
    with pytest.raises((IsolationError, LocalizerExit)):
        for _ in range(1000):
            localizer.step(observation())
            time.sleep(0.01)
    facts: Any = localizer.close()
    assert facts["peak_mb"] > 20
    assert facts["child"].keys() == {"cpu_s", "memory_mb", "measured"}, "seen from outside: what measures it is gone"
    again = start("Walks")
    brief(again, walk)
    assert again.step(observation()).level == -2


@pytest.mark.confinement
def test_a_warm_launcher_starts_a_walk_quickly_and_leaves_nothing_behind(start: Start) -> None:
    """50 ms on an idle machine (`pdrbench bench isolation`); the bound is for a busy one."""
    start("Walks").close()
    began_s = time.monotonic()
    for _ in range(5):
        start("Walks").close()
    assert time.monotonic() - began_s < 5.0
    scratch = Path(warm_launcher(True, Limits())._scratch)
    assert scratch.is_dir()
    discard()
    assert not scratch.exists()


@pytest.mark.confinement
def test_an_orphaned_launcher_removes_its_folder(start: Start) -> None:
    start("Walks").close()
    launcher = warm_launcher(True, Limits())
    scratch = Path(launcher._scratch)
    launcher._control.close()  # as the kernel does for a process that was killed
    launcher._process.wait(20)
    assert not scratch.exists()
    discard()


@pytest.mark.skipif(sys.platform != "linux", reason="processors are chosen on Linux only")
@pytest.mark.confinement
def test_a_localizer_runs_on_our_processor_from_the_first_step_to_the_end_of_the_walk(
    start: Start, walk: tuple[Task, Recording]
) -> None:
    everywhere = os.sched_getaffinity(0)
    localizer = start("Walks")
    assert os.sched_getaffinity(0) == everywhere, "what takes long may take any processor"
    brief(localizer, walk)
    assert localizer._child is not None
    ours, its = os.sched_getaffinity(0), os.sched_getaffinity(localizer._child._pid)
    localizer.close()
    assert ours == its and len(ours) == 1
    assert os.sched_getaffinity(0) == everywhere


@pytest.mark.skipif(sys.platform != "linux", reason="processors are chosen on Linux only")
@pytest.mark.confinement
def test_a_pause_of_the_evaluator_is_no_long_step_of_the_localizer(
    start: Start, walk: tuple[Task, Recording], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(child_process, "LONG_STEP_S", 0.1)
    monkeypatch.setattr(SharedProcessor, "_read_stats", lambda _: SchedulerStats(0.0, 0.0))
    localizer = start("Walks")
    brief(localizer, walk)
    localizer.step(observation())
    time.sleep(0.3)
    localizer.step(observation(0.2))
    assert len(os.sched_getaffinity(0)) == 1
