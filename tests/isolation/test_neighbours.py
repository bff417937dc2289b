"""Who waits for the other shares its processor while nobody else wants it."""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Iterator

import pytest

from pdrbench.isolation.neighbours import APART_S, LONG_STEP_S, LOOK_S, Neighbours

pytestmark = pytest.mark.skipif(
    sys.platform != "linux" or len(getattr(os, "sched_getaffinity", lambda _: [0])(0)) < 2,
    reason="needs a Linux with two processors",
)


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


def neighbours(child: int, monkeypatch: pytest.MonkeyPatch, waited_s: list[float]) -> Neighbours:
    """With a clock of the time that the two have waited for their processor."""
    monkeypatch.setattr(Neighbours, "_waiting_s", lambda self: waited_s[0])
    pair = Neighbours(child)
    pair._looked_s = 0.0
    return pair


def play(pair: Neighbours, begins_s: float, step_s: float) -> float:
    """Answers until one look has been had."""
    now_s = begins_s
    while now_s < begins_s + 1.1 * LOOK_S:
        now_s += step_s
        pair.answered(now_s)
    return now_s


def test_short_steps_bring_them_together_and_the_end_sets_them_free(
    child: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    everywhere = os.sched_getaffinity(0)
    pair = neighbours(child, monkeypatch, [0.0])
    play(pair, 0.0, 1e-3)
    assert len(os.sched_getaffinity(0)) == 1
    assert os.sched_getaffinity(0) == os.sched_getaffinity(child)
    pair.part()
    assert os.sched_getaffinity(0) == os.sched_getaffinity(child) == everywhere


def test_long_steps_leave_them_where_the_system_puts_them(child: int, monkeypatch: pytest.MonkeyPatch) -> None:
    everywhere = os.sched_getaffinity(0)
    pair = neighbours(child, monkeypatch, [0.0])
    play(pair, 0.0, 2 * LONG_STEP_S)
    assert os.sched_getaffinity(0) == os.sched_getaffinity(child) == everywhere


def test_a_crowded_processor_parts_them_for_a_while(child: int, monkeypatch: pytest.MonkeyPatch) -> None:
    waited_s = [0.0]
    everywhere = os.sched_getaffinity(0)
    pair = neighbours(child, monkeypatch, waited_s)
    now_s = play(pair, 0.0, 1e-3)
    waited_s[0] = 0.06
    now_s = play(pair, now_s, 1e-3)
    assert os.sched_getaffinity(0) == os.sched_getaffinity(child) == everywhere
    now_s = play(pair, now_s, 1e-3)
    assert os.sched_getaffinity(0) == everywhere, "not again at once"
    play(pair, now_s + APART_S, 1e-3)
    assert len(os.sched_getaffinity(0)) == 1
