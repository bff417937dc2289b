"""Sweeps that are killed, and sweeps that share a folder."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pdrbench.evaluation import evaluate, load_results, store

WALKS = 120
SCRIPT = """
import sys
sys.path[:] = sys.argv[3].split(":")
from pdrbench.evaluation import evaluate
evaluate(sys.argv[1], "Corridor-v0", walks=int(sys.argv[4]), jobs=2, out=sys.argv[2])
"""


def start(spec: str, out: Path, counter: Path, walks: int = WALKS) -> subprocess.Popen[bytes]:
    """A sweep in a process group of its own."""
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT, spec, str(out), ":".join(sys.path), str(walks)],
        env=os.environ | {"CORRIDOR_COUNTER": str(counter)},
        start_new_session=True,
        stderr=subprocess.PIPE,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # a shell's "&" makes children ignore it
    )


def wait_for(folder: Path, count: int, sweep: subprocess.Popen[bytes]) -> None:
    """Until so many results are stored."""
    while sweep.poll() is None and len(list(folder.glob(f"*{store.SUFFIX}"))) < count:
        time.sleep(0.005)


def digests(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.glob(f"*{store.SUFFIX}")}


@pytest.mark.slow
def test_a_sweep_killed_twenty_times_loses_and_repeats_and_tears_nothing(
    localizer: Callable[[str], str], tmp_path: Path, rng: np.random.Generator
) -> None:
    """Every walk notes in one file that it was computed to its end; all that is stored is never computed again.

    Every other time the parent alone is killed; its workers store what they have in hand, or not, and end.
    """
    out, counter = tmp_path / "out", tmp_path / "counter"
    out.mkdir()
    seen: dict[str, bytes] = {}
    lost_in_flight = 0
    for kill in range(20):
        whole_group = kill % 2 == 0
        sweep = start(localizer("Slow"), out, counter)
        wait_for(out, len(seen) + int(rng.integers(1, 6)), sweep)
        time.sleep(rng.uniform(0.0, 0.03))
        assert sweep.poll() is None, "the sweep ended before it could be killed: give it more walks"
        if whole_group:
            os.killpg(sweep.pid, signal.SIGKILL)
        else:
            sweep.kill()
        sweep.wait()
        if not whole_group:
            time.sleep(1.0)  # the orphans notice
        now = digests(out)
        assert {name: now[name] for name in seen} == seen, "what is stored stays as it is, byte by byte"
        for name in now:
            store.load(out / name)
        lost_in_flight = len(counter.read_text().splitlines()) - len(now)
        assert 0 <= lost_in_flight <= 2 * 20, "at most the walk that each of two workers had in hand at a kill"
        seen = now
    last = start(localizer("Slow"), out, counter)
    assert last.wait() == 0
    assert len(digests(out)) == WALKS
    assert len(load_results(out)) == WALKS
    # A walk may be computed to its end and killed before it is stored; nothing that was stored is computed again.
    assert len(counter.read_text().splitlines()) == WALKS + lost_in_flight
    assert [path.name for path in out.iterdir() if path.suffix != store.SUFFIX] == [".locks"]
    assert {name: data for name, data in digests(out).items() if name in seen} == seen


@pytest.mark.slow
def test_two_sweeps_on_one_folder_share_the_work(localizer: Callable[[str], str], tmp_path: Path) -> None:
    out, counter = tmp_path / "out", tmp_path / "counter"
    sweeps = [start(localizer("Slow"), out, counter, walks=60) for _ in range(2)]
    assert [sweep.wait() for sweep in sweeps] == [0, 0]
    assert len(load_results(out)) == 60
    assert len(counter.read_text().splitlines()) == 60, "none computed twice"
    assert [path.name for path in out.iterdir() if path.suffix != store.SUFFIX] == [".locks"]


def test_an_interrupt_keeps_what_is_done_and_leaves_nobody_behind(
    localizer: Callable[[str], str], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    sweep = start(localizer("Slow"), out, tmp_path / "counter", walks=200)
    wait_for(out, 5, sweep)
    os.killpg(sweep.pid, signal.SIGINT)
    assert sweep.wait(timeout=20) == -signal.SIGINT
    assert sweep.stderr is not None
    assert b"KeyboardInterrupt" in sweep.stderr.read()  # ends only when no worker holds the pipe any more
    stored = load_results(out)
    assert 5 <= len(stored) < 200
    before = digests(out)
    evaluate(localizer("Slow"), "Corridor-v0", walks=len(stored) + 2, out=out, in_process=True)
    assert before.items() <= digests(out).items()
