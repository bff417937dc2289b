"""The guard around calls into a localizer."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Iterator

import pytest

from pdrbench.evaluation.deadlines import Deadlines, LocalizerTimeout


@contextlib.contextmanager
def guarded(step_s: float, walk_s: float) -> Iterator[Deadlines]:
    deadlines = Deadlines(step_s, walk_s)
    deadlines.start()
    try:
        yield deadlines
    finally:
        deadlines.stop()


def set_up(deadlines: Deadlines) -> None:
    for call in ("construction", "reset"):
        with deadlines(call):
            pass


def test_a_call_in_time_passes() -> None:
    with guarded(1.0, 1.0) as deadlines:
        set_up(deadlines)
        with deadlines("step"):
            time.sleep(0.01)


def test_reset_may_take_longer_than_a_step() -> None:
    with guarded(0.05, 1.0) as deadlines:
        for call in ("construction", "reset"):
            with deadlines(call):
                time.sleep(0.1)
        with pytest.raises(LocalizerTimeout, match="step 1"), deadlines("step"):
            time.sleep(1.0)


def test_the_walk_has_a_deadline_of_its_own() -> None:
    with guarded(0.2, 0.25) as deadlines:
        set_up(deadlines)
        with deadlines("step"):
            time.sleep(0.15)
        began_s = time.monotonic()
        with pytest.raises(LocalizerTimeout, match="step 2"), deadlines("step"):
            time.sleep(1.0)
        assert time.monotonic() - began_s < 0.18, "0.1 s were left"


def test_revising_may_take_what_is_left_of_the_walk() -> None:
    with guarded(0.05, 0.3) as deadlines:
        set_up(deadlines)
        with deadlines("revise"):
            time.sleep(0.1)
        began_s = time.monotonic()
        with pytest.raises(LocalizerTimeout, match="revise took longer"), deadlines("revise"):
            time.sleep(1.0)
        assert time.monotonic() - began_s < 0.28, "0.2 s were left"


def test_an_error_of_the_localizer_passes_through() -> None:
    with guarded(1.0, 1.0) as deadlines, pytest.raises(ZeroDivisionError), deadlines("step"):
        raise ZeroDivisionError


def test_no_alarm_is_left_behind() -> None:
    before = signal.getsignal(signal.SIGALRM)
    with guarded(0.05, 0.05) as deadlines:
        set_up(deadlines)
        with deadlines("step"):
            pass
        time.sleep(0.1)
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)
    assert signal.getsignal(signal.SIGALRM) is before


def test_lateness_is_noticed_outside_the_main_thread() -> None:
    caught: list[BaseException] = []

    def work() -> None:
        with guarded(0.05, 1.0) as deadlines:
            set_up(deadlines)
            try:
                with deadlines("step"):
                    time.sleep(0.1)
            except LocalizerTimeout as error:
                caught.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert len(caught) == 1


def test_deadlines_are_positive() -> None:
    with pytest.raises(ValueError, match="positive"):
        Deadlines(0.0, 1.0)
