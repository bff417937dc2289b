"""Two processes that wait for each other run on one processor while no other process needs it."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator

import pytest

from pdrbench.isolation.shared_processor import (
    MAX_DELAY_FRACTION,
    MIN_RUN_FRACTION,
    SEPARATE_S,
    SchedulerStats,
    SharedProcessor,
)

pytestmark = [
    pytest.mark.confinement,
    pytest.mark.skipif(len(getattr(os, "sched_getaffinity", lambda _: [0])(0)) < 2, reason="needs two processors"),
]
LOOK_S = 0.1


@pytest.fixture
def child() -> Iterator[int]:
    everywhere = os.sched_getaffinity(0)
    pid = os.fork()
    if not pid:
        signal.pause()
        os._exit(0)
    yield pid
    os.kill(pid, signal.SIGKILL)
    os.waitpid(pid, 0)
    os.sched_setaffinity(0, everywhere)


class Clock:
    """Scheduler statistics of the two processes."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = 0.0
        self._had = SchedulerStats(0.0, 0.0)
        monkeypatch.setattr(SharedProcessor, "_read_stats", lambda _: self._had)

    def look(self, pair: SharedProcessor, used: float, delay: float) -> None:
        """The next look, before which the two ran, and waited for their turn, for those shares of the time."""
        self.now_s += LOOK_S
        self._had = SchedulerStats(self._had.ran_s + used * LOOK_S, self._had.delayed_s + delay * LOOK_S)
        pair.check(self.now_s)


@pytest.mark.parametrize(
    ("used", "delay"), [(0.98, 0.02), (0.95, 0.5), (0.1, 0.0)], ids=["steps", "handing over", "a pause of ours"]
)
def test_two_processes_run_on_one_processor_until_they_are_separated(
    child: int, used: float, delay: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    everywhere, clock = os.sched_getaffinity(0), Clock(monkeypatch)
    pair = SharedProcessor(child)
    pair.share(clock.now_s)
    assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == os.sched_getaffinity(child)
    clock.look(pair, used, delay)
    assert len(os.sched_getaffinity(0)) == 1
    pair.separate()
    assert os.sched_getaffinity(0) == os.sched_getaffinity(child) == everywhere
    clock.look(pair, 0.5, 0.5)
    assert len(os.sched_getaffinity(0)) == 1, "what they had while they were apart says nothing"


def test_a_third_busy_process_separates_the_two_for_a_while(child: int, monkeypatch: pytest.MonkeyPatch) -> None:
    everywhere, clock = os.sched_getaffinity(0), Clock(monkeypatch)
    pair = SharedProcessor(child)
    pair.share(clock.now_s)
    clock.look(pair, MIN_RUN_FRACTION - 0.1, MAX_DELAY_FRACTION + 0.1)
    assert os.sched_getaffinity(0) == os.sched_getaffinity(child) == everywhere
    pair.share(clock.now_s)
    clock.look(pair, 1.0, 0.0)
    assert os.sched_getaffinity(0) == everywhere, "not again at once"
    clock.now_s += SEPARATE_S
    clock.look(pair, 1.0, 0.0)
    assert len(os.sched_getaffinity(0)) == 1


def test_the_system_reports_running_waiting_and_sleeping_processes(child: int) -> None:
    pair = SharedProcessor(child)
    pair.share(0.0)
    before = pair._read_stats()
    time.sleep(0.1)
    slept = pair._read_stats()
    assert slept.ran_s - before.ran_s < 0.05 and slept.delayed_s - before.delayed_s < 0.05
    third = os.fork()  # on our processor, as we are
    if not third:
        while True:
            pass
    try:
        began_s = time.monotonic()
        while time.monotonic() < began_s + 0.3:
            pass
        wanted = pair._read_stats()
        assert wanted.delayed_s - slept.delayed_s > 0.09
        assert 0.03 < wanted.ran_s - slept.ran_s < 0.21
    finally:
        os.kill(third, signal.SIGKILL)
        os.waitpid(third, 0)
        pair.separate()
