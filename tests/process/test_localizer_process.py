"""A localizer in its process answers as it does in ours, pays once for what it loads, and its end is recorded."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import textwrap
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import psutil
import pytest
from starting import Start, starting

from pdrbench.episode import Episode, play
from pdrbench.errors import UnsuitableError
from pdrbench.evaluation import evaluate
from pdrbench.evaluation.wording import incidents
from pdrbench.localizer import Briefing, Observation
from pdrbench.process import Budget, LocalizerExit, LocalizerTimeout
from pdrbench.process.child_process import Limits, discard
from pdrbench.process.localizer_process import LocalizerProcess, LocalizerRaised
from pdrbench.recording import Recording
from pdrbench.registry import make_localizer, make_task
from pdrbench.task import Task

ENV = "CampusStride-v1"
ODD = """
    import os, sys, threading, time, warnings
    import numpy as np
    from pdrbench.errors import RecordingWarning, UnsuitableError
    from pdrbench.localizer import Estimate

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

    class Raises(Walks):
        def reset(self, briefing, rng):
            raise LookupError("that is all")

    class Sleeps(Walks):
        def __init__(self, seconds): self.seconds = seconds
        def step(self, observation):
            time.sleep(self.seconds)
            return super().step(observation)

    class Hangs(Walks):
        def step(self, observation):
            time.sleep(60.0 * self.count)
            return super().step(observation)

    class Large(Walks):
        def reset(self, briefing, rng):
            self.block = np.ones(350 << 17)
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

    class Warns(Walks):
        def reset(self, briefing, rng):
            super().reset(briefing, rng)
            for _ in range(3):
                warnings.warn("the plan\x1b[31m is wrong", RecordingWarning)
            warnings.warn("of no account", UserWarning)

    class Compiles(Walks):
        '''Answers how often it was made in this process, and how often a walk found nothing compiled.'''
        MADE = []
        def __init__(self):
            import numba  # takes longer than all else here
            type(self).triple = getattr(self, "triple", None) or staticmethod(numba.njit(lambda x: 3.0 * x))
            self.MADE.append(1)
        def reset(self, briefing, rng):
            self.cold = not self.triple.signatures
            self.triple(2.0)
        def step(self, observation):
            return Estimate(np.array([float(len(self.MADE)), float(self.cold)]), 0)
"""


@pytest.fixture(scope="module")
def walk() -> tuple[Task, Recording]:
    task = make_task(ENV)
    return task, task.load(task.split("train")[0])


@pytest.fixture(scope="module")
def odd(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("odd") / "odd.py"
    file.write_text(textwrap.dedent(ODD))
    return file


@pytest.fixture
def start(odd: Path) -> Iterator[Start]:
    with starting(odd, "process") as start:
        yield start


def brief(localizer: LocalizerProcess, walk: tuple[Task, Recording]) -> Briefing:
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


def test_a_localizer_is_made_and_compiled_once_for_all_its_walks(odd: Path) -> None:
    results = evaluate(f"{odd}:Compiles", ENV, split="val", walks=3, seeds=1).results
    assert [result.status for result in results] == ["complete"] * 3, results[0].failure
    answers = sorted(tuple(result.estimates.xy_m[0].tolist()) for result in results)
    assert answers == [(1.0, 0.0), (1.0, 0.0), (1.0, 1.0)], "made once, compiled once"


def test_the_process_stays_where_a_localizer_raises_and_ends_where_it_hangs(
    start: Start, walk: tuple[Task, Recording]
) -> None:
    pids = []
    for name in ("Raises", "Walks"):
        localizer = start(name)
        pids.append(pid_of(localizer))
        if name == "Raises":
            with pytest.raises(LocalizerRaised, match="LookupError: that is all"):
                brief(localizer, walk)
        localizer.close()
    assert pids[0] == pids[1]
    hangs = start("Hangs", Budget(pace=0.1, slack_s=0.0, start_s=10.0))
    brief(hangs, walk)
    hangs.step(observation())
    with pytest.raises(LocalizerTimeout):
        hangs.step(observation())
    if hasattr(signal, "SIGVTALRM"):
        assert "in step" in hangs.failure, "the traceback says where it was"
    assert pid_of(hangs) == pids[0]
    hangs.close()
    assert not psutil.pid_exists(pids[0])
    assert pid_of(start("Walks")) not in pids


OWNER = """
import sys; sys.path[:] = sys.argv[2].split(":")
import numpy as np
from pdrbench.localizer import Briefing, Observation
from pdrbench.process.budget import Budget
from pdrbench.process.localizer_process import LocalizerProcess, Terms
terms = Terms("process", Budget(), 1.0, 9)
made = LocalizerProcess(sys.argv[1], sys.argv[1], parameters={"seconds": 60.0}, terms=terms)
made.start()
made.reset(Briefing(None, {}, 1.0), np.random.default_rng(1))
print(made._child._process.pid, flush=True)
made.step(Observation(0.0, {}))
"""


@pytest.mark.skipif(os.name != "posix", reason="kills with a signal")
def test_the_process_ends_with_the_one_that_has_started_it(odd: Path) -> None:
    command = [sys.executable, "-c", OWNER, f"{odd}:Sleeps", ":".join(sys.path)]
    with subprocess.Popen(command, stdout=subprocess.PIPE) as owner:
        assert owner.stdout is not None
        child = psutil.Process(int(owner.stdout.readline()))
        owner.send_signal(signal.SIGKILL)
    assert not psutil.wait_procs([child], timeout=20)[1]


def test_processes_that_wait_end_when_they_are_not_wanted_any_more(start: Start) -> None:
    localizer = start("Walks")
    localizer.close()
    assert psutil.pid_exists(pid_of(localizer))
    discard()
    assert not psutil.pid_exists(pid_of(localizer))


def pid_of(localizer: LocalizerProcess) -> int:
    pid: int = localizer._child._process.pid  # type: ignore[union-attr]
    return pid


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


def test_peak_memory_is_reported_and_too_much_ends_the_localizer(start: Start, walk: tuple[Task, Recording]) -> None:
    large = start("Large")
    brief(large, walk)
    time.sleep(0.3)  # it is looked at ten times a second
    assert 350 < float(str(large.close()["peak_mb"])) < 900
    bomb = start("Bomb", limits=Limits(memory_mb=700))
    brief(bomb, walk)
    with pytest.raises(LocalizerExit, match=r"process was ended: memory: it uses \d+ MB"):
        bomb.step(observation())
    assert "memory: it uses" in bomb.failure


def test_declining_is_no_failure_and_its_message_is_plain(start: Start) -> None:
    with pytest.raises(UnsuitableError, match=r"^not \?\[31mthis$"):
        start("Declines")


def test_what_a_localizer_warns_of_stands_in_every_result(odd: Path) -> None:
    results = evaluate(f"{odd}:Warns", ENV, split="val", walks=2)
    assert [result.notes for result in results] == [("the plan?[31m is wrong",)] * 2
    assert any("on 2 of 2 walks: the plan?[31m is wrong" in line for line in incidents(results))


def test_the_end_of_what_it_printed_is_part_of_its_failure(start: Start, walk: tuple[Task, Recording]) -> None:
    localizer = start("Prints")
    brief(localizer, walk)
    with pytest.raises(LocalizerExit, match=r"exit code \(3\)"):
        localizer.step(observation())
    assert "the end\nthe localizer's process ended with exit code (3)" in localizer.failure
    assert len(localizer.failure) < 20_000


def test_a_localizer_just_under_the_time_of_each_step_ends_with_the_walk(odd: Path) -> None:
    """0.3 s of the 60 s that each step has; its answers count, and what it took and was limited by is recorded."""
    task = make_task(ENV)
    spec = f"{odd}:Sleeps"
    results = evaluate(spec, ENV, split="val", seeds=1, walks=1, budget=Budget(walk_s=2.5), parameters={"seconds": 0.3})
    (result,) = results.results
    episode = Episode(task.load(task.split("val")[0]), task)
    assert result.status == "failed"
    assert "2.5 s for all calls of a walk together" in result.failure
    assert 1 <= len(result.estimates) < len(episode)
    provenance = result.provenance
    assert provenance["missed"] == len(episode) - len(result.estimates)
    assert 2.0 < float(str(provenance["wall_s"])) < 10.0
