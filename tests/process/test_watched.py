"""Which random states a localizer disturbs: that of torch counts once its network has been built."""

from __future__ import annotations

import random  # noqa: TID251  its state is what is looked at
import sys
from collections.abc import Callable, Iterator
from types import SimpleNamespace

import numpy as np
import pytest

from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.process.watched import Watched


@pytest.fixture
def torch(monkeypatch: pytest.MonkeyPatch) -> Iterator[np.ndarray[tuple[int], np.dtype[np.uint8]]]:
    """The state of a library that stands for torch; those of this process are put back."""
    state = np.zeros(4, np.uint8)
    library = SimpleNamespace(get_rng_state=lambda: SimpleNamespace(numpy=lambda: state))
    monkeypatch.setitem(sys.modules, "torch", library)  # type: ignore[arg-type]
    saved = random.getstate(), np.random.get_state()  # noqa: NPY002
    yield state
    random.setstate(saved[0])
    np.random.set_state(saved[1])  # noqa: NPY002


class Localizer:
    def __init__(self, at_first: Callable[[], object], later: Callable[[], object]) -> None:
        self._later = later
        at_first()

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        pass

    def step(self, observation: Observation) -> Estimate:
        self._later()
        return Estimate(np.zeros(2), 0)


def nothing() -> None:
    pass


def disturbed(at_first: Callable[[], object] = nothing, later: Callable[[], object] = nothing) -> list[str]:
    watched = Watched(lambda: Localizer(at_first, later))
    watched.step(Observation(0.0, {}))
    return watched.disturbed()


def test_a_network_may_be_built_and_not_draw_later(torch: np.ndarray[tuple[int], np.dtype[np.uint8]]) -> None:
    def draw() -> None:
        torch[:] += 1

    assert disturbed() == disturbed(at_first=draw) == []
    assert disturbed(later=draw) == ["torch"]


def test_others_are_left_alone_from_the_beginning(torch: np.ndarray[tuple[int], np.dtype[np.uint8]]) -> None:
    numpy_seed = np.random.seed
    assert disturbed(at_first=lambda: numpy_seed(0)) == disturbed(later=np.random.random) == ["numpy.random"]
    assert disturbed(at_first=lambda: random.seed(0)) == disturbed(later=random.random) == ["random"]
