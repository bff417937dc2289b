"""The order of localizers by error, on synthetic walks through a shopping centre and on real ones.

Real: the walks of `MallPhone-v0` on levels with a radio survey; on the others a method that only matches scans answers
a wrong level, which no synthetic floor imitates. Synthetic: floors with as many survey walks as real ones, briefed and
observed exactly as in `MallPhone-v0`.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np

from pdrbench.episode import Episode, play
from pdrbench.errors import ResultError
from pdrbench.metrics import hold_at
from pdrbench.metrics.position import mean_m
from pdrbench.recording import RadioMap, Recording
from pdrbench.registry import make_localizer, make_task
from pdrbench.result import COMPLETE
from pdrbench.task import Task
from pdrbench_sim.realism.block import Block, Distribution, Order, Part, Values, statistics
from pdrbench_sim.realism.malls import floor_of, mall_walk
from pdrbench_sim.realism.radio_statistics import SurveyWalk, survey_of

ENVIRONMENT: Final = "MallPhone-v0"
LOCALIZERS: Final = (  # ours that can play it, without variants of li2012, which differ by less than single walks do
    "dead_reckoning-v0",
    "li2012-v0",
    "stay-v0",
    "wifi_knn-v0",
    "wlan_frank2009-v0",
    "wlan_frank2009_penalised-v0",
)
FIT_SITE: Final = "site1"  # its train walks are what parameters were fitted on
FLOORS: Final = 2
SURVEY_WALKS: Final = 46  # of a surveyed level of site 1
PLAYED_S: Final = 13.0  # median duration: walks that are played are those with all sensors, not the longer survey walks
FIRST_SURVEYED: Final = 100_000  # numbers of survey walks begin here, so that no walk that is played is one of them
SEED: Final = 0  # of the localizers
ORDER_NAME: Final = "order"


def real(part: Part) -> Values:
    """Mean error of every walk by localizer, real walks."""
    task = make_task(ENVIRONMENT)
    if part == "judge":
        walks = list(task.split("test"))
    else:
        walks = [walk for split in ("train", "val") for walk in task.split(split) if walk.startswith(FIT_SITE)]
    return _errors(task, [walk for walk in walks if _is_surveyed(task, walk)])


def _is_surveyed(task: Task, walk: str) -> bool:
    recording = task.load(walk)
    survey = task.radio_map(recording)
    return survey is not None and bool(np.isin(recording.reference.level[0], survey.level))


def synthetic(seed: int, count: int) -> Values:
    """The same of synthetic walks.

    Args:
        seed: Of floors and walks.
        count: Walks that are played, spread over the floors.
    """
    numbers = [(floor, number) for floor in range(FLOORS) for number in range(floor, count, FLOORS)]
    walks = [mall_walk(seed, floor, number, median_s=PLAYED_S) for floor, number in numbers]
    task = mall_task(walks, lambda recording: _survey(seed, floor_of(recording)))
    return _errors(task, task.split("test"))


@functools.lru_cache(maxsize=8)
def _survey(seed: int, floor: int) -> RadioMap:
    walks = (mall_walk(seed, floor, FIRST_SURVEYED + n) for n in range(SURVEY_WALKS))
    return survey_of([SurveyWalk.of(walk) for walk in walks])


def mall_task(walks: Sequence[Recording], radio_map: Callable[[Recording], RadioMap]) -> Task:
    """`MallPhone-v0` with other walks: the same sensors, period, and start; the first waypoint is not scored."""
    by_name = {walk.id: _with_given_start(walk) for walk in walks}
    return dataclasses.replace(
        make_task(ENVIRONMENT),
        id="SyntheticMall-v0",
        walks={"test": tuple(by_name)},
        units={},
        load=by_name.__getitem__,
        radio_map=radio_map,
        source="generated",
        dataset=None,
        note="",
    )


def _with_given_start(walk: Recording) -> Recording:
    surveyed = walk.reference.surveyed.copy()
    surveyed[0] = False
    return dataclasses.replace(walk, reference=dataclasses.replace(walk.reference, surveyed=surveyed))


def _errors(task: Task, walks: Sequence[str]) -> Values:
    """(n,) mean error of every walk by localizer, and (L,) the means of these in the order of `LOCALIZERS`."""
    errors = {name: np.array([mean_error_m(name, task, walk) for walk in walks]) for name in LOCALIZERS}
    return {**errors, ORDER_NAME: np.array([np.nanmean(found) for found in errors.values()])}


def mean_error_m(name: str, task: Task, walk: str) -> float:
    """Mean error of one localizer on one walk.

    Raises:
        ResultError: It failed or declined.
    """
    recording = task.load(walk)
    result = play(make_localizer(name), Episode(recording, task), np.random.default_rng(SEED), name=name, seed=SEED)
    if result.status != COMPLETE:
        raise ResultError(f"{name} on walk {walk!r} of {task.id}: {result.failure.strip().splitlines()[-1]}")
    held = hold_at(result.estimates, recording.reference.t_s, task.tell_start(recording))
    return mean_m(held, recording.reference)


ORDER: Final = Block(
    name="Order of localizers",
    statistics=(
        *statistics(
            "walk", Distribution(), *((name, f"mean error of {name} on {ENVIRONMENT}", "m") for name in LOCALIZERS)
        ),
        *statistics("localizer", Order(), (ORDER_NAME, f"mean errors of {', '.join(LOCALIZERS)}", "m")),
    ),
    datasets=("ilc20",),
    real=real,
    synthetic=synthetic,
    count=40,
)
