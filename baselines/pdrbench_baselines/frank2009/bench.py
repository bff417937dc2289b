"""Matching a scan with histograms, beside scikit-learn's brute force on a dense table of their means."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.bench.timing import Prepared, Timing, median_s
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.radio import UNHEARD_DBM
from pdrbench.recording import RadioMap
from pdrbench_baselines.frank2009.histograms import HistogramTable
from pdrbench_baselines.frank2009.warm import warm_up

if TYPE_CHECKING:
    from sklearn.neighbors import NearestNeighbors

NUM_ACCESS_POINTS: Final = 500
NUM_HEARD: Final = 40  # at a place, in a building with that many
NUM_SCANS: Final = 60  # at a calibration point; claim F3
SPREAD_DB: Final = 4.0  # of the readings at a point
METRICS: Final = ("manhattan", "euclidean")


def run(quick: bool, tell: Callable[[str], None]) -> list[Timing]:
    """All rows; `tell` receives what comes next."""
    tell("compiling")
    warm_up()
    rounds, queries = (3, 10) if quick else (9, 30)
    rows = []
    for name, num_points, num_heard in (("sparse", 10_000, NUM_HEARD), ("dense", 1_000, NUM_ACCESS_POINTS)):
        points = num_points // 10 if quick else num_points
        tell(f"{name}: {points:,} fingerprints, {num_heard} of {NUM_ACCESS_POINTS} access points heard")
        rows += _rows(name, draw(np.random.default_rng(1), points, num_heard, queries), rounds)
    return rows


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A survey, and scans at some of its points.

    Attributes:
        survey: `NUM_SCANS` scans a point.
        means_dbm: (P, A), `UNHEARD_DBM` where an access point is not heard.
        heard: (Q, K) int, access points of each scan.
        rssi_dbm: (Q, K).
    """

    survey: RadioMap
    means_dbm: FloatArray
    heard: IntArray
    rssi_dbm: FloatArray

    def dense_scans(self) -> FloatArray:
        """(Q, A) the scans as scikit-learn takes them."""
        scans = np.full((len(self.heard), NUM_ACCESS_POINTS), UNHEARD_DBM)
        np.put_along_axis(scans, self.heard, self.rssi_dbm, axis=1)
        return scans


def draw(rng: np.random.Generator, num_points: int, num_heard: int, num_queries: int) -> Case:
    """Any access points at any point, whole decibels as cards report them."""
    heard = np.argsort(rng.random((num_points, NUM_ACCESS_POINTS)), axis=1)[:, :num_heard]
    mean_dbm = rng.uniform(-90.0, -45.0, heard.shape)
    rssi_dbm = np.repeat(mean_dbm, NUM_SCANS, axis=0)
    rssi_dbm += SPREAD_DB * rng.standard_normal(rssi_dbm.shape)
    np.rint(rssi_dbm, out=rssi_dbm)
    scans = np.arange(num_points * NUM_SCANS)
    survey = RadioMap(
        xy_m=np.column_stack([scans // NUM_SCANS, np.zeros(len(scans))]),
        level=np.zeros_like(scans),
        walk=np.zeros_like(scans),
        first=np.append(scans, len(scans)) * num_heard,
        access_point=np.repeat(heard, NUM_SCANS, axis=0).ravel(),
        rssi_dbm=rssi_dbm.ravel(),
        age_s=np.zeros(rssi_dbm.size),
        surveyed=True,
    )
    means_dbm = np.full((num_points, NUM_ACCESS_POINTS), UNHEARD_DBM)
    np.put_along_axis(means_dbm, heard, rssi_dbm.reshape(num_points, NUM_SCANS, num_heard).mean(axis=1), axis=1)
    at = rng.integers(num_points, size=num_queries)
    return Case(survey, means_dbm, heard[at], np.rint(rng.normal(mean_dbm[at], SPREAD_DB)))


def by_histograms(table: HistogramTable, case: Case) -> IntArray:
    """(Q,) nearest calibration points, scan by scan."""
    scans = zip(case.heard, case.rssi_dbm, strict=True)
    return np.array([np.argmin(table.distance(heard, rssi_dbm)) for heard, rssi_dbm in scans])


def by_brute_force(search: NearestNeighbors, scans: FloatArray) -> IntArray:
    """(Q,) nearest rows, scan by scan."""
    return np.array([search.kneighbors(scan[None], return_distance=False)[0, 0] for scan in scans])


def _rows(name: str, case: Case, rounds: int) -> list[Timing]:
    """One query against each metric, one thread each, and what building the table takes."""
    from sklearn.neighbors import NearestNeighbors
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    scans = case.dense_scans()
    num_points, num_columns = case.means_dbm.shape
    searches = {
        metric: NearestNeighbors(n_neighbors=1, algorithm="brute", metric=metric).fit(case.means_dbm)
        for metric in METRICS
    }
    began_s = time.perf_counter()
    table = HistogramTable.from_radio_map(case.survey)
    build_s = time.perf_counter() - began_s
    things: dict[str, Prepared] = {"histograms": lambda: lambda: by_histograms(table, case)}
    for metric, search in searches.items():
        things[metric] = lambda search=search: lambda: by_brute_force(search, scans)  # type: ignore[misc]
    with threadpool_limits(1):
        taken_us = {thing: s / len(scans) * 1e6 for thing, s in median_s(things, rounds).items()}
    against = f"scikit-learn, brute force on {num_points:,} x {num_columns} means"
    ours_us, readings = taken_us["histograms"], len(case.survey.rssi_dbm)
    return [
        *(
            Timing(f"{name}_{metric}", ours_us, "us/query", f"{against}, {metric}", taken_us[metric] / ours_us)
            for metric in METRICS
        ),
        Timing(f"{name}_build", readings / build_s / 1e6, "M readings/s"),
        Timing(f"{name}_memory", table.nbytes / readings, "B/reading"),
    ]
