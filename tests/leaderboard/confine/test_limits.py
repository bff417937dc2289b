"""Limits that hold: memory, however it is held."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from starting import Start, starting

from pdrbench.localizer import Briefing, Observation
from pdrbench.process import LocalizerExit
from pdrbench.process.child_process import Limits
from pdrbench.process.localizer_process import LocalizerRaised

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

    class Reads(Stays):
        '''Pages that are never written: only the tables of them take memory.'''
        def step(self, observation):
            mmap.mmap(-1, 1 << 40, mmap.MAP_PRIVATE | mmap.MAP_ANONYMOUS, mmap.PROT_READ)
            return Estimate(np.zeros(2), 0)

    class Fills(Stays):
        def step(self, observation):
            held = [np.ones(32 << 17) for _ in range(40)]
            return Estimate(np.zeros(2), 0)

"""


@pytest.fixture(scope="module")
def greedy(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("greedy") / "greedy.py"
    file.write_text(textwrap.dedent(GREEDY))
    return file


@pytest.fixture
def start(greedy: Path) -> Iterator[Start]:
    with starting(greedy, "confined", slack_s=20.0) as start:
        yield start


@pytest.mark.confinement
@pytest.mark.parametrize(
    ("name", "why"),
    [("Shares", "not permitted"), ("Reads", "Cannot allocate"), ("Fills", "MemoryError|memory: |SIGKILL")],
)
def test_memory_is_limited_and_none_is_shared(start: Start, name: str, why: str) -> None:
    bomb = start(name, limits=Limits(memory_mb=500))
    bomb.reset(Briefing(None, {}, 0.2), np.random.default_rng(1))
    with pytest.raises((LocalizerExit, LocalizerRaised), match=why):
        bomb.step(Observation(0.0, {}))
    peak_mb = bomb.close()["peak_mb"]
    assert float(str(peak_mb)) < 700
