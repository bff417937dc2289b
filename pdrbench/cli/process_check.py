"""Checks of a localizer in processes of its own."""

from __future__ import annotations

import contextlib
from typing import TYPE_CHECKING, Final, Literal, cast

from pdrbench.errors import PdrbenchError
from pdrbench.process.budget import Budget
from pdrbench.process.localizer_process import LocalizerProcess, Terms

if TYPE_CHECKING:
    from pdrbench.gym import Check
    from pdrbench.localizer import Localizer

BUDGET: Final = Budget(pace=1.0, slack_s=30.0, start_s=600.0)
PERIOD_S, NUM_STEPS = 1.0, 10_000  # of a walk that is not known yet, for the limits of time


def check_in_process(
    name: str, env: str | None = None, isolation: Literal["process", "confined"] = "process"
) -> list[Check]:
    """`pdrbench.gym.check_localizer` with each instance in a process of its own.

    Args:
        name: As `registry.load_localizer` takes it.
        env: Environment to check it on; the first that suits it where None.
        isolation: As `Terms` has it.
    """
    from pdrbench.evaluation.origin import localizer_target
    from pdrbench.gym import check_localizer

    target = localizer_target(name)
    terms = Terms(isolation, BUDGET, PERIOD_S, NUM_STEPS)
    broken: list[str] = []
    with contextlib.ExitStack() as last:

        def end(made: LocalizerProcess) -> None:
            made.close()
            if made.has_broken:
                broken.append(made.failure)

        def make(*, is_watched: bool = False) -> Localizer:
            last.close()  # one process at a time: no check needs the one before
            if broken:
                raise PdrbenchError(broken[0])  # one that hangs would in every check
            made = LocalizerProcess(
                name, target, parameters={}, terms=terms, is_watched=is_watched, reference_follows=True
            )
            last.callback(end, made)
            made.start()
            return cast("Localizer", made)

        return check_localizer(make, env, make_watched=lambda: make(is_watched=True))
