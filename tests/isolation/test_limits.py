"""Limits that hold: totals of time, memory of all processes however it is held, files of the scratch folder."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest

from pdrbench.episode import Episode
from pdrbench.errors import PdrbenchError
from pdrbench.evaluation import evaluate
from pdrbench.isolation import Budget, LocalizerExit, SuiteBudget
from pdrbench.isolation.budget import TimeAccount
from pdrbench.isolation.confine import Limits
from pdrbench.isolation.isolated import IsolatedLocalizer, LocalizerRaised, Terms
from pdrbench.isolation.memory_group import MEMORY_GROUP, MemoryGroup, enter, find_place
from pdrbench.isolation.scratch import measure
from pdrbench.isolation.usage import Usage, count_mb
from pdrbench.localizer import Briefing, Observation
from pdrbench.registry import make_task

linux_only = pytest.mark.skipif(sys.platform != "linux", reason="read from /proc")
GREEDY = """
    import mmap, os, time
    import numpy as np
    from pdrbench.localizer import Estimate

    class Stays:
        def reset(self, briefing, rng): pass
        def step(self, observation): return Estimate(np.zeros(2), 0)

    class Slow(Stays):
        '''Just under the time of each step.'''
        def __init__(self, seconds): self.seconds = seconds
        def step(self, observation):
            time.sleep(self.seconds)
            return super().step(observation)

    class Forks(Stays):
        '''Holds memory in processes of its own, which are nobody's children any more.'''
        def step(self, observation):
            for _ in range(3):
                if not os.fork():
                    if os.fork():
                        os._exit(0)
                    held = np.ones(120 << 17)
                    time.sleep(60)
                    os._exit(0)
            time.sleep(60)

    class Unmaps(Stays):
        '''Shared memory that no page of the process shows.'''
        def step(self, observation):
            self.held = []
            for _ in range(8):
                block = mmap.mmap(-1, 64 << 20)
                np.frombuffer(block, np.uint8)[::4096] = 1
                block.madvise(mmap.MADV_DONTNEED)
                self.held.append(block)
            time.sleep(60)

    class Deletes(Stays):
        '''Files that no folder lists.'''
        def step(self, observation):
            self.held = []
            for number in range(8):
                self.held.append(open(f"file-{number}", "wb"))
                self.held[-1].write(bytes(4 << 20))
                self.held[-1].flush()
                os.unlink(f"file-{number}")
            time.sleep(60)

    class ManyFiles(Stays):
        def step(self, observation):
            for number in range(400):
                os.makedirs(f"folder-{number}")
            time.sleep(60)
"""
ENV = "OfficeStride-v2"
BUDGET = Budget(pace=5.0, slack_s=20.0, start_s=60.0)


@pytest.fixture(scope="module")
def greedy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("greedy") / "greedy.py"
    file.write_text(textwrap.dedent(GREEDY))
    return file


Begin = Callable[..., IsolatedLocalizer]


@pytest.fixture
def begin(greedy: Path) -> Iterator[Begin]:
    """Starts a class of the file on a walk; its process is ended with the test."""
    started = []

    def start(
        name: str,
        limits: Limits,
        isolation: Literal["auto", "process"],
        budget: Budget = BUDGET,
        **parameters: object,
    ) -> IsolatedLocalizer:
        terms = Terms(isolation, budget, 0.2, 1000, limits)
        spec = f"{greedy}:{name}"
        localizer = IsolatedLocalizer(spec, spec, parameters=parameters, terms=terms)
        started.append(localizer)
        localizer.start()
        localizer.reset(Briefing(None, {}, 0.2), np.random.default_rng(1))
        return localizer

    yield start
    for localizer in started:
        localizer.close()


def test_all_calls_of_a_walk_have_one_total() -> None:
    account = TimeAccount(Budget(pace=1.0, slack_s=10.0, start_s=50.0, walk_s=20.0), 1.0)
    left = []
    for call, taken_s in (("construction", 5.0), ("reset", 1.0), ("step", 4.0), ("step", 7.0), ("revise", 2.0)):
        left.append(account.allowed_s(call))
        account.spend(call, taken_s)
    assert left == [20.0, 15.0, 14.0, 10.0, 3.0]
    assert account.spent_s == 19.0
    assert "20 s for all calls of a walk together" in account.rule("revise")
    account.spend("revise", 5.0)
    assert account.allowed_s("revise") == 0.0


def test_a_localizer_just_under_the_time_of_each_step_ends_with_the_walk(greedy: Path) -> None:
    """0.3 s of the 60 s that each step has; its answers count, and what it took and was limited by is recorded."""
    task = make_task(ENV)
    spec = f"{greedy}:Slow"
    results = evaluate(spec, ENV, split="val", seeds=1, walks=1, budget=Budget(walk_s=2.5), parameters={"seconds": 0.3})
    (result,) = results.results
    episode = Episode(task.load(task.split("val")[0]), task)
    assert result.status == "failed"
    assert "2.5 s for all calls of a walk together" in result.failure
    assert 1 <= len(result.estimates) < len(episode)
    provenance: Any = result.provenance
    assert provenance["missed"] == len(episode) - len(result.estimates)
    assert 2.0 < provenance["wall_s"] < 10.0
    isolation = provenance["isolation"]
    assert (MEMORY_GROUP in isolation["held"]) != bool({MEMORY_GROUP, "confinement"} & set(isolation["missing"]))


def test_the_time_of_a_suite_adds_up_over_processes_and_runs(tmp_path: Path) -> None:
    budget = SuiteBudget(tmp_path / "time", limit_s=10.0)
    assert budget.left_s("a.py:A") == 10.0
    budget.spend("a.py:A", "first walk", 4.0)
    budget.spend("b.py:B", "first walk", 9.0)
    budget.spend("a.py:A", "second walk", 5.0)
    assert SuiteBudget(tmp_path / "time", limit_s=10.0).left_s("a.py:A") == 1.0, "another process reads the same"
    budget.spend("a.py:A", "first walk", 4.5)
    assert budget.left_s("a.py:A") == 0.5, "a walk that is played anew counts once"
    budget.spend("a.py:A", "third walk", 99.0)
    assert (budget.left_s("a.py:A"), budget.left_s("b.py:B")) == (0.0, 1.0)


def test_walks_after_the_end_of_a_suites_budget_fail_without_being_played(greedy: Path, tmp_path: Path) -> None:
    limited = SuiteBudget(tmp_path, limit_s=1e-3)
    specs = [f"{greedy}:Stays", "stay-v0"]
    results = evaluate(specs, ENV, split="val", seeds=1, walks=2, suite_budget=limited).results
    for spec in specs:
        statuses = sorted(result.status for result in results if result.localizer == spec)
        assert statuses == ["complete", "failed"], "each has a budget of its own"
    for result in results:
        if result.status == "failed":
            assert "had spent its budget before this walk: 0.001 s" in result.failure
            assert not len(result.estimates)


@linux_only
@pytest.mark.confinement
def test_memory_of_processes_that_left_their_parent_is_added_up(begin: Begin) -> None:
    forks = begin("Forks", Limits(memory_mb=300), "process")
    with pytest.raises(LocalizerExit, match=r"process was ended: memory: it uses \d+ MB; the limit is 300 MB"):
        forks.step(Observation(0.0, {}))


@linux_only
@pytest.mark.confinement
def test_shared_memory_counts_when_no_page_of_it_is_mapped(begin: Begin) -> None:
    unmaps = begin("Unmaps", Limits(memory_mb=400), "process")
    with pytest.raises(LocalizerExit, match="process was ended: memory: "):
        unmaps.step(Observation(0.0, {}))


@linux_only
@pytest.mark.confinement
def test_a_confined_process_gets_no_shared_memory_or_it_counts(begin: Begin) -> None:
    unmaps = begin("Unmaps", Limits(memory_mb=400), "auto")
    with pytest.raises((LocalizerExit, LocalizerRaised), match=r"process was ended: memory: |not permitted"):
        unmaps.step(Observation(0.0, {}))


HOLDER = """
import mmap, os, sys, time
block = mmap.mmap(-1, 100 << 20)
for place in range(0, 100 << 20, 4096):
    block[place] = 1
if not os.fork():
    sum(block[place] for place in range(0, 100 << 20, 4096))
    time.sleep(60)
print("ready", flush=True)
input()
"""


@linux_only
@pytest.mark.confinement
def test_pages_that_two_processes_share_count_once() -> None:
    with subprocess.Popen([sys.executable, "-c", HOLDER], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as holder:
        assert holder.stdout is not None
        holder.stdout.readline()
        children = Path(f"/proc/{holder.pid}/task/{holder.pid}/children").read_text().split()
        both = [holder.pid, *map(int, children)]
        assert len(both) == 2
        try:
            assert 100 < count_mb(both) < 150
            usage = Usage(both[1])
            seen = usage.read(50.0)
            assert seen is not None and seen[0] > 100.0
            usage.close()
        finally:
            os.kill(both[1], 9)
            holder.kill()


@linux_only
@pytest.mark.parametrize("name", ["Deletes", "ManyFiles"])
@pytest.mark.confinement
def test_files_are_counted_where_no_file_system_limits_them(begin: Begin, name: str) -> None:
    localizer = begin(name, Limits(scratch_mb=20, scratch_files=300), "process")
    with pytest.raises(LocalizerExit, match=r"process was ended: scratch: it has \d+ files of \d+ MB"):
        localizer.step(Observation(0.0, {}))


@pytest.fixture
def idle() -> Iterator[int]:
    """A process that holds no file; this one may hold deleted ones of pytest and of other tests."""
    nothing = subprocess.DEVNULL
    with subprocess.Popen(["sleep", "60"], stdin=nothing, stdout=nothing, stderr=nothing) as process:
        yield process.pid
        process.kill()


def test_what_cannot_be_measured_counts_as_too_much(tmp_path: Path, idle: int) -> None:
    (tmp_path / "file").write_bytes(bytes(100_000))
    size, files = measure(str(tmp_path), idle, 10)
    assert (100_000 <= size < 200_000, files) == (True, 1)
    here = os.open(tmp_path, os.O_RDONLY)
    for _ in range(30):  # deeper than a path can be long
        os.mkdir("d" * 200, dir_fd=here)
        here, above = os.open("d" * 200, os.O_RDONLY, dir_fd=here), here
        os.close(above)
    os.close(here)
    assert measure(str(tmp_path), idle, 1000)[0] == float("inf")
    assert measure(str(tmp_path), idle, 5)[1] == 6, "counting ends"


def tree(root: Path, mounted: str = "/") -> tuple[Path, Path]:
    """A tree of groups as a desktop has it, its list of mounts and the group of this process, as plain files."""
    own = root / "user.slice/app.slice/shell.scope"
    own.mkdir(parents=True)
    for folder in (root, *own.relative_to(root).parents, own):
        place = root / folder
        (place / "cgroup.controllers").write_text("cpu memory pids\n")
        (place / "cgroup.procs").write_text("")
        (place / "cgroup.subtree_control").write_text("memory pids\n" if place.name != own.name else "\n")
    mounts = root.parent / "mountinfo"
    mounts.write_text(f"25 1 0:22 / /sys rw - sysfs sysfs rw\n30 25 0:26 {mounted} {root} rw - cgroup2 cgroup2 rw\n")
    group = root.parent / "cgroup"
    group.write_text("1:name=systemd:/other\n0::/user.slice/app.slice/shell.scope\n")
    return mounts, group


@pytest.mark.confinement
def test_the_nearest_part_of_the_tree_that_is_ours_holds_the_groups(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = tmp_path / "groups"
    mounts, own = tree(root)
    place = find_place(mounts, own)
    assert place == root / "user.slice/app.slice", "a group with processes holds none"
    make = Path.mkdir

    def make_as_the_kernel_does(folder: Path) -> None:
        make(folder)
        (folder / "cgroup.procs").touch()

    monkeypatch.setattr(Path, "mkdir", make_as_the_kernel_does)
    monkeypatch.setattr(Path, "rmdir", shutil.rmtree)
    group = MemoryGroup(700, place)
    (folder,) = (path for path in place.iterdir() if path.name.startswith("pdrbench-"))
    assert (folder / "memory.max").read_text() == str(700 << 20)
    assert (folder / "memory.oom.group").read_text() == "1"
    assert not group.has_exceeded
    (folder / "memory.events").write_text("low 0\noom 1\noom_kill 2\n")
    assert group.has_exceeded
    enter(group.entrance)
    assert (folder / "cgroup.procs").read_text() == "0", "the one that writes"
    group.close()
    group.close()
    assert not folder.exists()


def test_where_no_group_can_be_made_the_reason_is_given(tmp_path: Path) -> None:
    root = tmp_path / "groups"
    mounts, own = tree(root)
    for path in root.rglob("cgroup.subtree_control"):
        path.write_text("")
    with pytest.raises(OSError, match="no part of the tree of control groups is left to this user"):
        find_place(mounts, own)
    (root / "user.slice/app.slice/shell.scope/cgroup.controllers").write_text("cpu\n")
    with pytest.raises(OSError, match="do not count memory here"):
        find_place(mounts, own)
    mounts.write_text("25 1 0:22 / /sys rw - sysfs sysfs rw\n")
    with pytest.raises(OSError, match="no control groups of version 2"):
        find_place(mounts, own)


def test_totals_are_positive_and_finite() -> None:
    with pytest.raises(PdrbenchError, match="positive and finite"):
        Budget(walk_s=0.0)
