"""Limits that hold: memory of all processes however it is held, files of the scratch folder."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from pdrbench.localizer import Briefing, Observation
from pdrbench.process import Budget, LocalizerExit
from pdrbench.process.child_process import Limits
from pdrbench.process.localizer_process import LocalizerProcess, LocalizerRaised, Terms
from pdrbench_leaderboard.confine.memory_group import MemoryGroup, enter, find_place
from pdrbench_leaderboard.confine.scratch import measure
from pdrbench_leaderboard.confine.usage import Usage, count_mb

linux_only = pytest.mark.skipif(sys.platform != "linux", reason="read from /proc")
GREEDY = """
    import mmap, os, time
    import numpy as np
    from pdrbench.localizer import Estimate

    class Stays:
        def reset(self, briefing, rng): pass
        def step(self, observation): return Estimate(np.zeros(2), 0)

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

"""
BUDGET = Budget(pace=5.0, slack_s=20.0, start_s=60.0)


@pytest.fixture(scope="module")
def greedy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("greedy") / "greedy.py"
    file.write_text(textwrap.dedent(GREEDY))
    return file


Begin = Callable[..., LocalizerProcess]


@pytest.fixture
def begin(greedy: Path) -> Iterator[Begin]:
    """Starts a class of the file on a walk; its process is ended with the test."""
    started = []

    def start(name: str, limits: Limits) -> LocalizerProcess:
        terms = Terms("confined", BUDGET, 0.2, 1000, limits)
        spec = f"{greedy}:{name}"
        localizer = LocalizerProcess(spec, spec, parameters={}, terms=terms)
        started.append(localizer)
        localizer.start()
        localizer.reset(Briefing(None, {}, 0.2), np.random.default_rng(1))
        return localizer

    yield start
    for localizer in started:
        localizer.close()


@linux_only
@pytest.mark.confinement
def test_a_confined_process_gets_no_shared_memory_or_it_counts(begin: Begin) -> None:
    unmaps = begin("Unmaps", Limits(memory_mb=400))
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
