"""Sweeps that are killed, and sweeps that share a folder."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil

from pdrbench.evaluation import evaluate, load_results, store

WORKERS = 2
FOUND_WITHIN_S = 10.0
PARTIAL = ("worker", "child")  # where these end, the sweep goes on
VICTIMS = ("worker", "child", "group")
SCRIPT = """
import sys
sys.path[:] = sys.argv[3].split(":")
from pdrbench.evaluation import evaluate, pool
evaluate(sys.argv[1], "Corridor-v0", walks=int(sys.argv[4]), jobs=int(sys.argv[5]), out=sys.argv[2], seeds=1)
pool.discard()
"""


def start(spec: str, out: Path, loads: Path, walks: int, jobs: int = WORKERS) -> subprocess.Popen[bytes]:
    """A sweep in a process group of its own; every walk that a worker begins is noted in `loads`.

    It ends its workers at last, and has its temporary files beside its results.
    """
    return subprocess.Popen(
        [sys.executable, "-c", SCRIPT, spec, str(out), ":".join(sys.path), str(walks), str(jobs)],
        env=os.environ | {"CORRIDOR_LOADS": str(loads), "TMPDIR": str(out.parent)},
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


def begun(loads: Path) -> list[str]:
    return [line.split()[0] for line in loads.read_text().splitlines()] if loads.exists() else []


def answers(folder: Path) -> dict[str, bytes]:
    return {result.walk: result.estimates.xy_m.tobytes() for result in load_results(folder).results}


class Victims:
    """The processes of a sweep by role, seen from outside."""

    def __init__(self, sweep: subprocess.Popen[bytes]) -> None:
        self._sweep = sweep

    def kill(self, victim: str, rng: np.random.Generator) -> bool:
        """Kills one process of that kind; False where there was none."""
        if victim == "group":
            os.killpg(self._sweep.pid, signal.SIGKILL)
            return True
        until_s = time.monotonic() + FOUND_WITHIN_S  # one that was just killed is being replaced
        while not (found := [process for process in self._descendants() if self._kind(process) == victim]):
            if time.monotonic() > until_s:
                return False
            time.sleep(0.02)
        try:
            found[int(rng.integers(len(found)))].kill()
        except psutil.NoSuchProcess:
            return False
        return True

    def _descendants(self) -> Iterator[psutil.Process]:
        try:
            yield from psutil.Process(self._sweep.pid).children(recursive=True)
        except psutil.NoSuchProcess:
            return

    def _kind(self, process: psutil.Process) -> str:
        """Of the processes that localizers are in, and of those that start them; "" of others."""
        try:
            command = " ".join(process.cmdline())
            if "pdrbench.process" in command:
                return "child"
            return "worker" if "loky" in command and "resource_tracker" not in command else ""
        except psutil.NoSuchProcess:
            return ""


def test_a_killed_sweep_loses_repeats_and_tears_no_result(
    localizer: Callable[[str], str], tmp_path: Path, rng: np.random.Generator, orphans: Any
) -> None:
    """`kill -9` of a worker, a child, or the evaluator and all of them, at random moments.

    A worker notes every walk that it begins. A walk that is stored when a process is killed is never begun again. Where
    the sweep goes on, the walk at hand has failed, with the answers given so far: it is not shown twice.
    """
    out, loads, reference = tmp_path / "out", tmp_path / "loads", tmp_path / "reference"
    out.mkdir()
    kills = len(VICTIMS)
    walks = 12 + 4 * kills
    seen: dict[str, bytes] = {}
    killed = []
    num_partial = 0
    with orphans() as adopted:
        sweep = start(localizer("Slow"), out, loads, walks)
        for number in range(kills):
            victim = VICTIMS[number % len(VICTIMS)]
            wait_for(out, len(seen) + int(rng.integers(1, 4)), sweep)
            time.sleep(rng.uniform(0.0, 0.1))
            assert sweep.poll() is None, f"ended after {killed}: {sweep.stderr.read()[-2000:]!r}"  # type: ignore[union-attr]
            seen_walks = {store.load(out / name).walk for name in digests(out)}
            num_begun = len(begun(loads))
            killed += [victim] if Victims(sweep).kill(victim, rng) else []
            if victim == "group":
                sweep.wait()
                assert adopted.left() == [], f"processes that outlive the {victim}"
                assert {name: digests(out)[name] for name in seen} == seen, "what is stored stays as it is"
                sweep = start(localizer("Slow"), out, loads, walks)
            else:
                wait_for(out, len(seen) + 1, sweep)
            again = set(begun(loads)[num_begun:]) & seen_walks
            assert not again, f"{again} were stored when the {victim} was killed, and are computed again"
            seen = digests(out)
            spoilt = [stored.failure for stored in map(store.load, map(out.joinpath, seen)) if stored.failure]
            assert len(spoilt) <= WORKERS * (num_partial := num_partial + (victim in PARTIAL)), f"{victim}: {spoilt}"
            assert all("not played again" in why or "SIGKILL" in why for why in spoilt), spoilt
        assert sweep.wait() == 0
        assert adopted.left() == []
    assert len(killed) >= 0.8 * kills, f"only {killed}: some victims were not running"
    assert len(digests(out)) == walks, "nothing is lost"
    assert len(begun(loads)) <= walks + WORKERS * kills, "at most what two workers had in hand is computed again"
    assert [path.name for path in out.iterdir() if path.suffix != store.SUFFIX] == [".locks"]
    evaluate(localizer("Good"), "Corridor-v0", walks=walks, out=reference, isolation="none", seeds=1)
    whole = answers(reference)
    for walk, given in answers(out).items():
        assert whole[walk].startswith(given), "the same bytes as of an undisturbed sweep, as far as it got"
    assert sum(given == whole[walk] for walk, given in answers(out).items()) >= walks - WORKERS * num_partial


def test_two_sweeps_on_one_folder_divide_the_work(localizer: Callable[[str], str], tmp_path: Path) -> None:
    out, loads = tmp_path / "out", tmp_path / "loads"
    sweeps = [start(localizer("Slow"), out, loads, walks=12, jobs=1) for _ in range(2)]
    assert [sweep.wait() for sweep in sweeps] == [0, 0]
    assert len(load_results(out)) == 12
    assert len(begun(loads)) == 12, "none computed twice"
    assert [path.name for path in out.iterdir() if path.suffix != store.SUFFIX] == [".locks"]
    assert [path.name for path in tmp_path.iterdir() if not path.is_file()] == ["out"], "workers leave no folder"


def test_an_interrupt_keeps_what_is_done_and_leaves_no_process_behind(
    localizer: Callable[[str], str], tmp_path: Path, orphans: Any
) -> None:
    out, loads = tmp_path / "out", tmp_path / "loads"
    with orphans() as adopted:
        sweep = start(localizer("Slow"), out, loads, walks=200)
        wait_for(out, 5, sweep)
        os.killpg(sweep.pid, signal.SIGINT)
        assert sweep.wait(timeout=20) == -signal.SIGINT
        assert sweep.stderr is not None
        assert b"KeyboardInterrupt" in sweep.stderr.read()  # ends only when no worker holds the pipe any more
        assert adopted.left() == []
    stored = load_results(out)
    assert 5 <= len(stored) < 200
    before = digests(out)
    evaluate(localizer("Slow"), "Corridor-v0", walks=len(stored) + 2, out=out, seeds=1)
    assert before.items() <= digests(out).items()
