"""A localizer that is watched: what it does to observations and to the random state of its process."""

from __future__ import annotations

import random  # noqa: TID251  its state is looked at, not used
import sys
from collections.abc import Callable
from typing import Any, Final, cast

import numpy as np

from pdrbench.localizer import Briefing, Estimate, Localizer, Observation

SEED: Final = 20080921


class Watched:
    """Makes a localizer and passes calls on; spoils every observation once it has been answered.

    The random state of the process is seeded before the localizer is made, since one that seeds with a constant would
    leave no trace otherwise. That of torch is looked at from then on: building a network draws numbers for weights that
    are loaded afterwards.

    Attributes:
        changed: Rows that the localizer has changed: sensor and time.
    """

    def __init__(self, make: Callable[[], Localizer]) -> None:
        random.seed(SEED)
        np.random.seed(SEED)  # noqa: NPY002  see above
        self._before = _random_states()
        self._inner = make()
        self._before |= _torch_state()
        self.changed: list[str] = []
        for name in ("revise", "tell"):
            if hasattr(self._inner, name):
                setattr(self, name, getattr(self._inner, name))

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        """Passed on."""
        self._inner.reset(briefing, rng)

    def step(self, observation: Observation) -> Estimate:
        """Passed on; what was kept of the observation is of no use afterwards."""
        handed_out = {name: rows.copy() for name, rows in observation.rows.items()}
        estimate = self._inner.step(observation)
        for name, rows in observation.rows.items():
            if not np.array_equal(rows, handed_out[name]):
                self.changed.append(f"{name!r} at {observation.now_s:.1f} s")
            rows[:] = -1.0
        return estimate

    def disturbed(self) -> list[str]:
        """Random states of the process that are not what they were before the localizer was made."""
        now = _random_states() | _torch_state()
        return [name for name, state in self._before.items() if state != now[name]]


def _random_states() -> dict[str, object]:
    numpy_state = cast(tuple[Any, ...], np.random.get_state())  # noqa: NPY002  looked at, not used
    return {"random": random.getstate(), "numpy.random": repr(numpy_state[1].tobytes()) + repr(numpy_state[2:])}


def _torch_state() -> dict[str, object]:
    if "torch" not in sys.modules:
        return {}
    return {"torch": sys.modules["torch"].get_rng_state().numpy().tobytes()}
