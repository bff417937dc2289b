"""Localizers of a file in processes of their own, which end with the test."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from pathlib import Path

from pdrbench.process import Budget
from pdrbench.process.child_process import Limits
from pdrbench.process.launch import Isolation
from pdrbench.process.localizer_process import LocalizerProcess, Terms

Start = Callable[..., LocalizerProcess]


@contextlib.contextmanager
def starting(file: Path, isolation: Isolation, slack_s: float = 10.0) -> Iterator[Start]:
    """What starts a class of a file, with a budget, limits and parameters."""
    usual, no_limits = Budget(pace=5.0, slack_s=slack_s, start_s=60.0), Limits()

    def start(name: str, budget: Budget = usual, limits: Limits = no_limits, **parameters: object) -> LocalizerProcess:
        terms, spec = Terms(isolation, budget, 0.2, 1000, limits), f"{file}:{name}"
        localizer = LocalizerProcess(spec, spec, parameters=parameters, terms=terms)
        ending.callback(localizer.close)
        localizer.start()
        return localizer

    with contextlib.ExitStack() as ending:
        yield start
