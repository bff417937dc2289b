"""Who waits for the other shares its processor while nobody else wants it."""

from __future__ import annotations

import os
import signal
import sys
import time
from collections.abc import Iterator

import pytest

from pdrbench.isolation.neighbours import APART_S, LEAST_SHARE, Neighbours

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or len(getattr(os, "sched_getaffinity", lambda _: [0])(0)) < 2,
    reason="needs a Linux with two processors",
)
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
    """Of processor time that the two have had."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now_s = self._ran_s = 0.0
        monkeypatch.setattr(Neighbours, "_running_s", lambda _: self._ran_s)

    def look(self, pair: Neighbours, share: float) -> None:
        """The next look, after which the two have had that share of a processor."""
        self.now_s += LOOK_S
        self._ran_s += share * LOOK_S
        pair.look(self.now_s)


def test_they_share_a_processor_until_they_are_parted(child: int, monkeypatch: pytest.MonkeyPatch) -> None:
    everywhere, clock = os.sched_getaffinity(0), Clock(monkeypatch)
    pair = Neighbours(child)
    pair.join(clock.now_s)
    assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == os.sched_getaffinity(child)
    clock.look(pair, 0.98)
    assert len(os.sched_getaffinity(0)) == 1
    pair.part()
    assert os.sched_getaffinity(0) == os.sched_getaffinity(child) == everywhere
    clock.look(pair, 0.5)
    assert len(os.sched_getaffinity(0)) == 1, "what they had while they were apart says nothing"


def test_a_third_who_wants_the_processor_parts_them_for_a_while(child: int, monkeypatch: pytest.MonkeyPatch) -> None:
    everywhere, clock = os.sched_getaffinity(0), Clock(monkeypatch)
    pair = Neighbours(child)
    pair.join(clock.now_s)
    clock.look(pair, LEAST_SHARE - 0.1)
    assert os.sched_getaffinity(0) == os.sched_getaffinity(child) == everywhere
    pair.join(clock.now_s)
    clock.look(pair, 1.0)
    assert os.sched_getaffinity(0) == everywhere, "not again at once"
    clock.now_s += APART_S
    clock.look(pair, 1.0)
    assert len(os.sched_getaffinity(0)) == 1


def test_processor_time_of_both_counts(child: int) -> None:
    pair = Neighbours(child)
    before_s, began_s = pair._running_s(), time.thread_time()
    while time.thread_time() < began_s + 0.05:
        pass
    assert 0.045 < pair._running_s() - before_s < 0.5
