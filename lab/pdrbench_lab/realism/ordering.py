"""The order of localizers by error, on synthetic walks through shopping centres and on real ones.

Real: the walks of the val split of `MallPhone-v2`; what varies as a whole is an outing. Synthetic: floors of shopping
centres, briefed and observed exactly as there. The survey of a real walk lacks everything of its own outing, so that
half of the places lie in parts of the floor that it left out; synthetic surveys lack the walks around some places, so
many that places lie as far from the nearest scan as recorded ones do.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from scipy import stats
from scipy.spatial import cKDTree

from pdrbench.episode import Episode, play
from pdrbench.errors import ResultError
from pdrbench.geometry import FloatArray
from pdrbench.metrics import hold_at
from pdrbench.metrics.position import mean_m
from pdrbench.recording import RadioMap, Recording
from pdrbench.registry import make_localizer, make_task
from pdrbench.result import COMPLETE
from pdrbench.task import Task
from pdrbench_lab.realism.block import CLUSTER, Block, Distribution, Order, Part, Values, clustered, statistics
from pdrbench_lab.realism.malls import floor_of, mall_walk
from pdrbench_lab.realism.radio_statistics import SurveyWalk, survey_of

ENVIRONMENT: Final = "MallPhone-v2"
LOCALIZERS: Final = (  # ours that can play it, without variants of li2012, which differ by less than single walks do
    "dead_reckoning",
    "li2012",
    "stay",
    "wifi_knn",
    "wlan_frank2009",
    "wlan_frank2009?unknown=penalise",
)
FLOORS: Final = 6
# Chosen by how far places lie from the nearest scan: 56 % of the places of val beyond 10 m, half beyond 12 m, and with
# these numbers 55 % and 13 m (`pdrbench malls order`); with all walks of a floor it is 1 m.
SURVEY_WALKS: Final = 14
GAPS: Final = 6  # places around which a survey lacks the walks whose middle is within `GAP_M`
GAP_M: Final = 15.0
MAX_SURVEY_TRIES: Final = 10 * SURVEY_WALKS
FIRST_SURVEYED: Final = 100_000  # numbers of survey walks begin here, so that no walk that is played is one of them
FIT_EVERY: Final = 6  # of the walks of train, which are many
MIN_TAU: Final = 0.85  # one of the fifteen pairs may be in the opposite order
SEED: Final = 0  # of the localizers
DRAWS: Final = 2000  # of the bootstrap
ORDER_NAME: Final = "order"
FROM_SURVEY: Final = "from_survey"  # of every place of a walk
_GAPS: Final = 17  # stream of random numbers


def real(part: Part) -> Values:
    """Mean error of every walk by localizer, real walks; those of one outing are one cluster."""
    task = make_task(ENVIRONMENT)
    walks = task.split("val") if part == "judge" else task.split("train")[::FIT_EVERY]
    return _errors(task, walks, [task.units[walk] for walk in walks])


def synthetic(seed: int, count: int) -> Values:
    """The same of synthetic walks; those of one floor are one cluster.

    Args:
        seed: Of floors and walks.
        count: Walks that are played, spread over the floors.
    """
    numbers = [(floor, number) for floor in range(FLOORS) for number in range(floor, count, FLOORS)]
    walks = [mall_walk(seed, floor, number) for floor, number in numbers]
    task = mall_task(walks, lambda recording: _survey(seed, floor_of(recording)))
    return _errors(task, task.split("test"), [str(floor) for floor, _ in numbers])


@functools.lru_cache(maxsize=8)
def _survey(seed: int, floor: int) -> RadioMap:
    return survey_of(survey_with_gaps(seed, floor))


def survey_with_gaps(seed: int, floor: int) -> list[SurveyWalk]:
    """Survey walks of a floor, none of which has its middle near one of `GAPS` places."""
    rng = np.random.default_rng([seed, floor, _GAPS])
    walks: list[SurveyWalk] = []
    gaps_xy_m = np.zeros((0, 2))
    for number in range(MAX_SURVEY_TRIES):
        walk = SurveyWalk.of(mall_walk(seed, floor, FIRST_SURVEYED + number))
        middle_m = walk.xy_m.mean(axis=0)
        if len(gaps_xy_m) < GAPS:
            gaps_xy_m = np.vstack([gaps_xy_m, walk.xy_m[rng.integers(len(walk.xy_m))]])
        elif np.hypot(*(gaps_xy_m - middle_m).T).min() > GAP_M:
            walks.append(walk)
        if len(walks) == SURVEY_WALKS:
            break
    return walks


def mall_task(walks: Sequence[Recording], radio_map: Callable[[Recording], RadioMap]) -> Task:
    """`ENVIRONMENT` with other walks: the same sensors, period, and start; the first waypoint is not scored."""
    by_name = {walk.id: _with_given_start(walk) for walk in walks}
    return dataclasses.replace(
        make_task(ENVIRONMENT),
        id="SyntheticMall-v1",
        walks={"test": tuple(by_name)},
        units={},
        groups={},
        folds={},
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


def _errors(task: Task, walks: Sequence[str], units: Sequence[str]) -> Values:
    """(n,) mean error of every walk by localizer, and (L,) the means of these in the order of `LOCALIZERS`."""
    number = np.unique(units, return_inverse=True)[1].astype(np.float64)
    errors = {name: np.array([mean_error_m(name, task, walk) for walk in walks]) for name in LOCALIZERS}
    clusters = {f"{name}{CLUSTER}": number for name in LOCALIZERS}
    away_m = [_from_survey_m(task, walk) for walk in walks]
    of_unit = [np.concatenate([m for m, n in zip(away_m, number, strict=True) if n == unit]) for unit in set(number)]
    means = np.array([np.nanmean(found) for found in errors.values()])
    return {**errors, **clusters, **clustered(FROM_SURVEY, of_unit), ORDER_NAME: means}


def _from_survey_m(task: Task, walk: str) -> FloatArray:
    """(T,) from each place of a walk to the nearest scan of its survey on the same level."""
    recording = task.load(walk)
    survey, level = task.radio_map(recording), recording.reference.level[0]
    assert survey is not None
    return np.asarray(cKDTree(survey.xy_m[survey.level == level]).query(recording.reference.xy_m)[0])


def tau_interval(real: Values, synthetic: Values) -> tuple[float, float, float]:
    """Kendall's tau of the mean errors of both sides, and its 95 % interval.

    Outings and floors are drawn anew, with replacement, each with all its walks, which every localizer plays.
    """
    tau = _tau(real[ORDER_NAME], synthetic[ORDER_NAME])
    rng = np.random.default_rng(SEED)
    drawn = [_tau(_redrawn(rng, real), _redrawn(rng, synthetic)) for _ in range(DRAWS)]
    low, high = np.percentile(drawn, [2.5, 97.5])
    return tau, float(low), float(high)


def _redrawn(rng: np.random.Generator, values: Values) -> FloatArray:
    cluster = values[f"{LOCALIZERS[0]}{CLUSTER}"]
    of_each = [np.flatnonzero(cluster == number) for number in np.unique(cluster)]
    rows = np.concatenate([of_each[i] for i in rng.integers(len(of_each), size=len(of_each))])
    return np.array([np.nanmean(values[name][rows]) for name in LOCALIZERS])


def _tau(one: FloatArray, other: FloatArray) -> float:
    return float(stats.kendalltau(one, other).statistic)


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
        *statistics("place", Distribution(), (FROM_SURVEY, f"way from a place on {ENVIRONMENT} to a scan", "m")),
        *statistics("localizer", Order(MIN_TAU), (ORDER_NAME, f"mean errors of {', '.join(LOCALIZERS)}", "m")),
    ),
    datasets=("ilc20_full",),
    real=real,
    synthetic=synthetic,
    count=90,
)
