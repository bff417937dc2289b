"""Matching a scan with a survey, beside scikit-learn's brute force on a dense table of it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np

from pdrbench.geometry import FloatArray, IntArray
from pdrbench.radio import UNHEARD_DBM, ScanMatcher, strength
from pdrbench.radio.matching import POWER
from pdrbench.recording import RadioMap
from pdrbench.sensors import sensor_spec
from pdrbench_baselines.frank2009.histograms import HistogramTable
from pdrbench_baselines.frank2009.warm import warm_up
from pdrbench_lab.speed.timing import Prepared, Timing, median_s

if TYPE_CHECKING:
    from sklearn.neighbors import NearestNeighbors

NUM_ACCESS_POINTS: Final = 500
NUM_HEARD: Final = 40  # at a place, in a building with that many
NUM_SPARSE: Final = 30  # by a scan of a survey with one scan a place
NUM_SCANS: Final = 60  # at a calibration point; claim F3
SPREAD_DB: Final = 4.0  # of the readings at a point
METRICS: Final = ("manhattan", "euclidean")


def run(quick: bool, tell: Callable[[str], None]) -> list[Timing]:
    """All rows; `tell` receives what comes next."""
    tell("compiling")
    warm_up()
    rounds, queries = (3, 10) if quick else (9, 30)
    points = 1_000 if quick else 10_000
    tell(f"fingerprints: {points:,}, {NUM_SPARSE} of {NUM_ACCESS_POINTS} access points heard, one scan a place")
    rows = _fingerprint_rows(draw(np.random.default_rng(1), points, NUM_SPARSE, 10 * queries, 1), rounds)
    for name, num_points, num_heard in (("sparse", 10_000, NUM_HEARD), ("dense", 1_000, NUM_ACCESS_POINTS)):
        points = num_points // 10 if quick else num_points
        tell(f"{name}: {points:,} fingerprints, {num_heard} of {NUM_ACCESS_POINTS} access points heard")
        rows += _rows(name, draw(np.random.default_rng(1), points, num_heard, queries), rounds)
    return rows


@dataclass(frozen=True, slots=True, eq=False)
class Case:
    """A survey, and scans at some of its points.

    Attributes:
        survey: As many scans at every point.
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


def draw(
    rng: np.random.Generator, num_points: int, num_heard: int, num_queries: int, num_scans: int = NUM_SCANS
) -> Case:
    """Any access points at any point, whole decibels as cards report them."""
    heard = np.argsort(rng.random((num_points, NUM_ACCESS_POINTS)), axis=1)[:, :num_heard]
    mean_dbm = rng.uniform(-90.0, -45.0, heard.shape)
    rssi_dbm = np.repeat(mean_dbm, num_scans, axis=0)
    rssi_dbm += SPREAD_DB * rng.standard_normal(rssi_dbm.shape)
    np.rint(rssi_dbm, out=rssi_dbm)
    scans = np.arange(num_points * num_scans)
    survey = RadioMap(
        xy_m=np.column_stack([scans // num_scans, np.zeros(len(scans))]),
        level=np.zeros_like(scans),
        walk=np.zeros_like(scans),
        first=np.append(scans, len(scans)) * num_heard,
        access_point=np.repeat(heard, num_scans, axis=0).ravel(),
        rssi_dbm=rssi_dbm.ravel(),
        age_s=np.zeros(rssi_dbm.size),
        surveyed=True,
    )
    means_dbm = np.full((num_points, NUM_ACCESS_POINTS), UNHEARD_DBM)
    np.put_along_axis(means_dbm, heard, rssi_dbm.reshape(num_points, num_scans, num_heard).mean(axis=1), axis=1)
    at = rng.integers(num_points, size=num_queries)
    return Case(survey, means_dbm, heard[at], np.rint(rng.normal(mean_dbm[at], SPREAD_DB)))


def by_histograms(table: HistogramTable, case: Case) -> IntArray:
    """(Q,) nearest calibration points, scan by scan."""
    scans = zip(case.heard, case.rssi_dbm, strict=True)
    return np.array([np.argmin(table.distance(heard, rssi_dbm)) for heard, rssi_dbm in scans])


def by_brute_force(search: NearestNeighbors, scans: FloatArray) -> IntArray:
    """(Q,) nearest rows, scan by scan."""
    return np.array([search.kneighbors(scan[None], return_distance=False)[0, 0] for scan in scans])


def by_cosine(matcher: ScanMatcher, case: Case) -> IntArray:
    """(Q,) nearest fingerprints, scan by scan."""
    scans = np.stack([case.heard, case.rssi_dbm, np.zeros(case.heard.shape)], axis=-1)
    distances = (matcher.distance(scan) for scan in scans)
    return np.array([np.argmin(distance) for distance in distances if distance is not None])


def directions(rows: FloatArray) -> FloatArray:
    """Rows of length one: the nearest by their distance is the nearest by the cosine."""
    unit: FloatArray = rows / np.linalg.norm(rows, axis=1, keepdims=True)
    return unit


def _fingerprint_rows(case: Case, rounds: int) -> list[Timing]:
    """One query against each fingerprint by the cosine and by histograms, one thread each."""
    from sklearn.neighbors import NearestNeighbors
    from threadpoolctl import threadpool_limits  # type: ignore[import-untyped]

    matcher, table = ScanMatcher(case.survey, sensor_spec("wifi")), HistogramTable.from_radio_map(case.survey)
    few = case.dense_scans()[: len(case.heard) // 10]
    dense, strengths = matcher.fingerprints, strength(few, POWER)
    one_by_one = {
        "cosine": (lambda: by_cosine(matcher, case), dense, strengths),
        "euclidean": (lambda: by_cosine(matcher, case), directions(dense), directions(strengths)),  # the same nearest
        "manhattan": (lambda: by_histograms(table, case), case.means_dbm, few),
    }
    rows = []
    with threadpool_limits(1):
        for metric, (ours, fingerprints, scans) in one_by_one.items():
            search = NearestNeighbors(n_neighbors=1, algorithm="brute", metric=metric).fit(fingerprints)
            things: dict[str, Prepared] = {
                "ours": lambda ours=ours: ours,  # type: ignore[misc]
                "theirs": lambda search=search, scans=scans: lambda: by_brute_force(search, scans),  # type: ignore[misc]
            }
            taken_s = median_s(things, rounds, time.process_time)
            ours_us, theirs_us = taken_s["ours"] / len(case.heard) * 1e6, taken_s["theirs"] / len(few) * 1e6
            against = "scikit-learn, brute force on {:,} x {} readings".format(*fingerprints.shape)
            rows.append(
                Timing(f"fingerprints_{metric}", ours_us, "us/query", f"{against}, {metric}", theirs_us / ours_us)
            )
    return [*rows, Timing("fingerprints_memory", matcher.nbytes / len(case.survey.rssi_dbm), "B/reading")]


def _rows(name: str, case: Case, rounds: int) -> list[Timing]:
    """One query against each metric, one thread each, and what building the table takes."""
    from sklearn.neighbors import NearestNeighbors
    from threadpoolctl import threadpool_limits

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
