"""Every walk of a stranger's localizer is alone: nothing of an earlier one is found, and nothing is left behind."""

from __future__ import annotations

import textwrap
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from starting import Start, starting

from pdrbench.evaluation import evaluate
from pdrbench.localizer import Briefing, Observation
from pdrbench.process import LocalizerExit
from pdrbench.process.child_process import LaunchError, Limits
from pdrbench.process.localizer_process import LocalizerProcess, LocalizerRaised
from pdrbench_leaderboard.confine.confine import FileLimits
from pdrbench_leaderboard.confine.launcher_client import Launcher, discard, warm_launcher

pytestmark = pytest.mark.confinement
ENV = "CampusStride-v1"
STRANGER = """
    import os
    import numba
    import numpy as np
    from pdrbench.localizer import Estimate

    VISITS = []

    class Stays:
        def reset(self, briefing, rng): pass
        def step(self, observation): return Estimate(np.zeros(2), -2)

    @numba.njit
    def triple(x):
        return 3.0 * x

    class Compiles(Stays):
        '''Answers how often it has compiled in this process, and how often it found what was compiled before.'''
        def revise(self):
            triple(2.0)
            misses, hits = (sum(count.values()) for count in (triple.stats.cache_misses, triple.stats.cache_hits))
            return np.array([[0.0, float(misses), float(hits), 0.0]])

    class Leaves(Stays):
        '''Reports what it finds, and leaves traces.'''
        def reset(self, briefing, rng):
            VISITS.append(1)
            print(len(VISITS), sorted(os.listdir()), os.environ.get("SECRET"), os.getcwd() == os.environ["HOME"])
            open("trace", "w").write("x")
            raise LookupError("that is all")
"""


@pytest.fixture(scope="module")
def stranger(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("stranger") / "stranger.py"
    file.write_text(textwrap.dedent(STRANGER))
    return file


@pytest.fixture
def start(stranger: Path) -> Iterator[Start]:
    with starting(stranger, "confined") as start:
        yield start


def brief(localizer: LocalizerProcess) -> None:
    localizer.reset(Briefing(None, {}, 0.2), np.random.default_rng(5))


def launcher() -> Launcher:
    return warm_launcher(Limits(), FileLimits())


def test_a_registered_localizer_answers_the_same_confined() -> None:
    found = [
        evaluate("dead_reckoning", ENV, split="val", walks=1, isolation=kind, seeds=1).results[0]
        for kind in ("none", "confined")
    ]
    assert [result.status for result in found] == ["complete"] * 2, found[1].failure
    assert found[0].estimates.xy_m.tobytes() == found[1].estimates.xy_m.tobytes()


def test_a_localizer_compiles_in_a_rehearsal_and_in_none_of_its_walks(stranger: Path) -> None:
    results = evaluate(f"{stranger}:Compiles", "Toy-v1", split="test", walks=3, isolation="confined", seeds=1).results
    online = [result for result in results if result.division == "online"]
    assert [result.status for result in online] == ["complete"] * 3, online[0].failure
    assert [result.revised.xy_m[0].tolist() for result in online if result.revised] == [[0.0, 1.0]] * 3


def test_every_walk_begins_in_a_fresh_interpreter_and_an_empty_folder(
    start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SECRET", "b3f1")
    for _ in range(2):
        localizer = start("Leaves")
        with pytest.raises(LocalizerRaised, match="LookupError: that is all"):
            brief(localizer)
        assert localizer.failure.startswith("1 [] None True"), localizer.failure
        localizer.close()


def test_a_launcher_that_is_gone_is_reported_and_replaced(start: Start) -> None:
    localizer = start("Stays")
    brief(localizer)
    launcher()._process.kill()
    with pytest.raises((LaunchError, LocalizerExit)):
        for _ in range(1000):
            localizer.step(Observation(0.0, {}))
            time.sleep(0.01)
    facts: Any = localizer.close()
    assert facts["peak_mb"] > 20
    assert facts["child"].keys() == {"cpu_s", "memory_mb", "measured"}, "seen from outside: what measures it is gone"
    again = start("Stays")
    brief(again)
    assert again.step(Observation(0.0, {})).level == -2


def test_a_launcher_leaves_no_folder_whether_it_is_ended_or_orphaned(start: Start) -> None:
    start("Stays").close()
    folders = [Path(launcher()._scratch), Path(launcher()._compiled)]
    assert all(folder.is_dir() for folder in folders)
    discard()
    assert not any(folder.exists() for folder in folders)
    start("Stays").close()
    orphan = launcher()
    folders = [Path(orphan._scratch), Path(orphan._compiled)]
    orphan._control.close()  # as the kernel does for a process that was killed
    orphan._process.wait(20)
    assert not any(folder.exists() for folder in folders)
    discard()
