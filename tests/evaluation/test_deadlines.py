"""The guard around calls into a localizer that runs in this process."""

from __future__ import annotations

import contextlib
import signal
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest

import pdrbench.evaluation.deadlines as deadlines_module
from pdrbench.evaluation.deadlines import Alarm, Deadlines
from pdrbench.process import Budget, LocalizerExit, LocalizerTimeout

PERIOD_S = 1.0
WITHOUT_POSIX = not hasattr(deadlines_module.signal, "setitimer")


def wait_busily(seconds: float) -> None:
    """In the interpreter, where an alarm can be raised at any instruction."""
    ends_s = time.monotonic() + seconds
    while time.monotonic() < ends_s:
        pass


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


def test_a_step_may_use_the_unused_time_of_others_and_revise_has_a_budget_of_its_own() -> None:
    with guarded(0.1, 0.2, 1.0) as deadlines:
        with deadlines("step"):
            time.sleep(0.2)
        with pytest.raises(LocalizerTimeout, match=r"timeout: step 3 took longer than the 0\.\d+ s"), deadlines("step"):
            time.sleep(1.0)
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


@pytest.fixture(params=["signal", "thread"])
def clock(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Deadlines by the signal of POSIX, and as where there is none."""
    if request.param == "thread":
        monkeypatch.delattr(signal, "setitimer", raising=False)
    elif WITHOUT_POSIX:
        pytest.skip("this system has no such signal")


@pytest.mark.usefixtures("clock")
def test_no_alarm_fires_between_calls_or_afterwards() -> None:
    with guarded(0.06, 0.0, 0.06) as deadlines:
        with deadlines("step"):
            pass
        wait_busily(0.2)
    wait_busily(0.2)


@pytest.mark.usefixtures("clock")
def test_a_loop_that_catches_the_alarm_is_ended_all_the_same() -> None:
    num_caught = 0
    late = pytest.raises(LocalizerTimeout, match="timeout: step 2")
    with guarded(0.1, 0.0, 0.1) as deadlines, late, deadlines("step"):
        for _ in range(2):
            with contextlib.suppress(Alarm):
                num_caught += 1
                wait_busily(30.0)
        wait_busily(30.0)
    assert num_caught == 2


@pytest.mark.usefixtures("clock")
def test_a_call_that_ends_at_its_deadline_is_late_and_leaves_no_alarm() -> None:
    for allowed_s in np.linspace(0.045, 0.055, 5):  # about where the other thread looks at its clock
        with guarded(allowed_s, 0.0, 1.0) as deadlines, pytest.raises(LocalizerTimeout), deadlines("step"):
            time.sleep(allowed_s)
        wait_busily(0.06)


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
