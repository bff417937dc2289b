"""The distance of Frank et al. 2009 on published fingerprints, and the claims about it.

UJIIndoorLoc (Torres-Sospedra et al. 2014: three buildings, four or five levels, 520 access points) was published with
the errors of a nearest neighbour. Those are reproduced exactly, first: set, split and units are read as its authors
read them. The distance of eq. (1) is then measured on the same 1111 test scans.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import numpy as np

from pdrbench.datasets import find
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.radio import UNHEARD_DBM, strength
from pdrbench.radio.matching import POWER
from pdrbench_baselines.frank2009.histograms import UNKNOWN, HistogramTable, Unknown
from pdrbench_lab.reproduce.number_text import SHARE
from pdrbench_lab.reproduce.reproduction import Claim, Experiment, Gate, median_over_seeds
from pdrbench_sim.readers.wifi_fingerprints import FingerprintSet, SurveyRows, read


def uji(seed: int) -> dict[str, Any]:
    """Errors of several distances on the test scans of UJIIndoorLoc; nothing is random.

    For each: `<name>_hit_share` of scans put on the right level of the right building, `<name>_hit_mercator_m` their
    mean error in the unit of the publication, `<name>_hit_m` on the ground, `<name>_all_m` of all scans. Names:

    * `nearest`: one neighbour, Euclidean over all access points, one that was not heard is as weak as the weakest
      reading of the training rows (-104 dBm). The authors' "positive values", RSSI less this minimum and 0 where not
      heard, have the same distances.
    * `knn`: three neighbours by cosine of powed strengths, mean place of those on the level that weighs most.
    * `scan_ignore`, `scan_penalise`: eq. (1), every training row a fingerprint of its own. What the scan heard and the
      fingerprint did not is ignored as the paper writes it, or penalised.
    * `place_ignore`, `place_penalise`: the rows at one place make a histogram, as in the paper.
    * `counted_ignore`, `counted_penalise`: and rows that did not hear what others heard there count as -100 dBm.
    """
    fingerprints = read(find("wifi_fingerprints") / "UJI1.mat")
    found = scored("nearest", fingerprints, nearest(fingerprints))
    found |= scored("knn", fingerprints, *three_nearest(fingerprints))
    for name, pooled, counted in (("scan", False, False), ("place", True, False), ("counted", True, True)):
        table = histograms(fingerprints.train, pooled=pooled, count_unheard=counted)
        for unknown in UNKNOWN:
            row = table.xy_m[matched(table, fingerprints.test, unknown), 0].astype(np.int64)
            found |= scored(f"{name}_{unknown}", fingerprints, row)
    return found


def scored(name: str, fingerprints: FingerprintSet, row: IntArray, xy_m: FloatArray | None = None) -> dict[str, float]:
    """The four numbers of one method.

    Args:
        name: Before the names of the numbers.
        fingerprints: With the test scans.
        row: (Q,) training row on whose level and in whose building each scan is put.
        xy_m: (Q, 2) where it is put; None for the place of the row.
    """
    train, test = fingerprints.train, fingerprints.test
    error_m = np.linalg.norm((train.xy_m[row] if xy_m is None else xy_m) - test.xy_m, axis=1)
    is_hit: BoolArray = (train.level[row] == test.level) & (train.building[row] == test.building)
    hit_m = float(error_m[is_hit].mean())
    return {
        f"{name}_hit_share": float(is_hit.mean()),
        f"{name}_hit_mercator_m": hit_m / fingerprints.ground_scale,
        f"{name}_hit_m": hit_m,
        f"{name}_all_m": float(error_m.mean()),
    }


def nearest(fingerprints: FingerprintSet) -> IntArray:
    """(Q,) training row with the least Euclidean distance; the first of equals."""
    from sklearn.neighbors import NearestNeighbors

    weakest_dbm = np.nanmin(fingerprints.train.rssi_dbm)
    train, test = (np.nan_to_num(part.rssi_dbm, nan=weakest_dbm) for part in (fingerprints.train, fingerprints.test))
    search = NearestNeighbors(n_neighbors=1, algorithm="brute").fit(train)
    row: IntArray = search.kneighbors(test, return_distance=False)[:, 0]
    return row


def three_nearest(fingerprints: FingerprintSet) -> tuple[IntArray, FloatArray]:
    """A training row (Q,) on the level and the place (Q, 2), by the cosine of powed strengths."""
    from sklearn.neighbors import NearestNeighbors

    train, test = (
        strength(np.nan_to_num(part.rssi_dbm, nan=UNHEARD_DBM), POWER)
        for part in (fingerprints.train, fingerprints.test)
    )
    search = NearestNeighbors(n_neighbors=3, algorithm="brute", metric="cosine").fit(train)
    distance, rows = search.kneighbors(test)
    weight = 1.0 / np.maximum(distance, 1e-9) ** 2
    floor = np.stack([fingerprints.train.building, fingerprints.train.level], axis=-1)[rows]
    is_same = (floor[:, :, None] == floor[:, None]).all(axis=-1)  # (Q, k, k)
    chosen = np.argmax((is_same * weight[:, None]).sum(axis=-1), axis=1)
    weight = weight * is_same[np.arange(len(rows)), chosen]
    xy_m = np.einsum("qk,qkd->qd", weight, fingerprints.train.xy_m[rows]) / weight.sum(axis=1, keepdims=True)
    return rows[np.arange(len(rows)), chosen], xy_m


def histograms(train: SurveyRows, *, pooled: bool, count_unheard: bool) -> HistogramTable:
    """A table whose coordinates are numbers of training rows, so that the answer is a row.

    Args:
        train: Rows to learn from.
        pooled: True where the rows at one place make a calibration point, False where each row is one.
        count_unheard: Rows at a point that lack an access point which others received there count as -100 dBm: the
            paper does not count them.
    """
    row = np.arange(len(train))
    if pooled:
        place = np.column_stack([train.xy_m, train.level, train.building])
        _, first, number = np.unique(place, axis=0, return_index=True, return_inverse=True)
        row = first[number.ravel()]
    if count_unheard:
        is_heard = np.zeros(train.rssi_dbm.shape, dtype=np.bool_)
        np.logical_or.at(is_heard, row, ~np.isnan(train.rssi_dbm))
        unheard_dbm = np.where(is_heard[row], UNHEARD_DBM, np.nan)
        train = replace(train, rssi_dbm=np.where(np.isnan(train.rssi_dbm), unheard_dbm, train.rssi_dbm))
    survey = replace(train.radio_map(), xy_m=np.column_stack([row, row]))
    return HistogramTable.from_radio_map(survey)


def histogram(table: HistogramTable, point: int, access_point: int) -> tuple[IntArray, FloatArray]:
    """What was measured at a calibration point.

    Returns:
        rssi_dbm: (k,) int, rising; empty where the access point was not received there.
        probability: (k,) of each, above 0.
    """
    column = int(np.searchsorted(table.access_point, access_point))
    low, high = table.first[column : column + 2]
    rows = low + np.flatnonzero(table.point[low:high] == point)
    if not len(rows):
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    count = table.count[table.first_bin[rows[0]] : table.first_bin[rows[0] + 1]]
    filled = np.flatnonzero(count)
    return table.lowest_dbm[rows[0]] + filled, count[filled] / count.sum()


def matched(table: HistogramTable, scans: SurveyRows, unknown: Unknown) -> IntArray:
    """(Q,) calibration point nearest to each scan; the first one where the survey knows nothing of a scan."""
    points = np.zeros(len(scans), dtype=np.int64)
    for scan, rssi_dbm in enumerate(scans.rssi_dbm):
        heard = np.flatnonzero(~np.isnan(rssi_dbm))
        if table.known(heard).any():
            points[scan] = np.argmin(table.distance(heard, rssi_dbm[heard], unknown=unknown))
    return points


UJI: Final = Experiment("uji", "pdrbench_lab.papers.frank2009.radio:uji", seeds=1, quick_seeds=1)


def _claim(id_: str, what: str, paper: str, key: str, unit: str, gate: Gate | None = None) -> Claim:
    return UJI.claim(id_, what, paper, median_over_seeds(key), gate, unit)  # of one seed: nothing is random


_SCORES: Final = (("hit_share", "building and level", SHARE), ("hit_mercator_m", "mean error", "m"))
_PUBLISHED: Final = (
    ("89.92 %", Gate(0.8992 - 5e-5, 0.8992 + 5e-5)),
    ("7.90 m", Gate(7.90 - 5e-3, 7.90 + 5e-3)),
)  # Torres-Sospedra et al. 2014

UJI_CLAIMS: Final = (
    *(
        _claim("UJI", f"UJIIndoorLoc, nearest neighbour: {what}", paper, f"nearest_{key}", unit, gate)
        for (key, what, unit), (paper, gate) in zip(_SCORES, _PUBLISHED, strict=True)
    ),
    _claim("UJI", "the same on the ground", "–", "nearest_hit_m", "m"),
    *(
        _claim("F4", f"UJIIndoorLoc, {method}: {what}", "–", f"{name}_{key}", unit)
        for name, method in (
            ("scan_ignore", "eq. (1), a scan a fingerprint"),
            ("scan_penalise", "a scan a fingerprint, unknown access points penalised"),
            ("place_ignore", "eq. (1), a histogram a place"),
            ("place_penalise", "a histogram a place, unknown access points penalised"),
            ("counted_penalise", "the same, and scans that missed one counted"),
            ("knn", "three nearest by cosine"),
        )
        for key, what, unit in _SCORES
    ),
)
