"""Limits that hold: memory of all processes however it is held, files of the scratch folder."""

from __future__ import annotations

import shutil
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

GREEDY = """
    import mmap
    import numpy as np
    from pdrbench.localizer import Estimate

    class Stays:
        def reset(self, briefing, rng): pass
        def step(self, observation): return Estimate(np.zeros(2), 0)

    class Shares(Stays):
        '''Shared memory that counts as no process's private data.'''
        def step(self, observation):
            return Estimate(np.frombuffer(mmap.mmap(-1, 64 << 20), np.uint8)[:2], 0)

    class Fills(Stays):
        def step(self, observation):
            held = [np.ones(32 << 17) for _ in range(40)]
            return Estimate(np.zeros(2), 0)

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


@pytest.mark.confinement
@pytest.mark.parametrize(("name", "why"), [("Shares", "not permitted"), ("Fills", "MemoryError|memory: |SIGKILL")])
def test_memory_is_limited_and_none_is_shared(begin: Begin, name: str, why: str) -> None:
    bomb = begin(name, Limits(memory_mb=500))
    with pytest.raises((LocalizerExit, LocalizerRaised), match=why):
        bomb.step(Observation(0.0, {}))
    peak_mb = bomb.close()["peak_mb"]
    assert float(str(peak_mb)) < 700


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
