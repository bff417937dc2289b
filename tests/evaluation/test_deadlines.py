"""The guard around calls into a localizer that runs in this process."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Iterator

import pytest

from pdrbench.evaluation.deadlines import Deadlines
from pdrbench.isolation import Budget, LocalizerExit, LocalizerTimeout

PERIOD_S = 1.0


@contextlib.contextmanager
def guarded(pace: float, slack_s: float, start_s: float) -> Iterator[Deadlines]:
    """The guard of a localizer that has been made and has answered once."""
    deadlines = Deadlines(Budget(pace, slack_s, start_s), PERIOD_S)
    deadlines.start()
    try:
        for call in ("construction", "reset", "step"):
            with deadlines(call):
                pass
        yield deadlines
    finally:
        deadlines.stop()


def test_a_step_may_use_the_unused_time_of_others() -> None:
    with guarded(0.1, 0.2, 1.0) as deadlines:
        with deadlines("step"):
            time.sleep(0.2)
        with pytest.raises(LocalizerTimeout, match=r"timeout: step 3 took longer than the 0\.\d+ s"), deadlines("step"):
            time.sleep(1.0)


def test_revise_has_a_budget_of_its_own() -> None:
    with guarded(0.05, 0.0, 0.3) as deadlines:
        with deadlines("revise"):
            time.sleep(0.1)
        with pytest.raises(LocalizerTimeout, match="revise took longer"), deadlines("revise"):
            time.sleep(1.0)


def test_an_error_comes_through_and_an_exit_does_not() -> None:
    with guarded(1.0, 0.0, 1.0) as deadlines:
        with pytest.raises(ZeroDivisionError), deadlines("step"):
            raise ZeroDivisionError
        with pytest.raises(LocalizerExit, match="raised SystemExit: 3"), deadlines("step"):
            raise SystemExit(3)
        with pytest.raises(KeyboardInterrupt), deadlines("step"):
            raise KeyboardInterrupt


def test_no_alarm_fires_between_calls_or_afterwards() -> None:
    before = signal.getsignal(signal.SIGALRM)
    with guarded(0.05, 0.0, 0.05) as deadlines:
        with deadlines("step"):
            pass
        time.sleep(0.1)
    assert signal.getsignal(signal.SIGALRM) is before
    assert signal.getitimer(signal.ITIMER_REAL) == (0.0, 0.0)


def test_off_the_main_thread_lateness_is_checked_afterwards() -> None:
    caught = []

    def late() -> None:
        with guarded(0.05, 0.0, 1.0) as deadlines:
            try:
                with deadlines("step"):
                    time.sleep(0.1)
            except LocalizerTimeout as error:
                caught.append(error)

    thread = threading.Thread(target=late)
    thread.start()
    thread.join()
    assert len(caught) == 1
