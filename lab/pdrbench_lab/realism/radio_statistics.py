"""What is computed of the WiFi scans of survey walks, real or synthetic: per walk, and per floor of many walks."""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.distance import cdist

from pdrbench.geometry import FloatArray, IntArray
from pdrbench.radio import ScanMatcher, survey_of_readings
from pdrbench.recording import RadioMap, Recording
from pdrbench.sensors import sensor_spec

FRESH_S: Final = 2.5  # a reading younger than this comes from the last sweep (sources.md 1.9)
MAX_SENDERS: Final = 150  # identifiers that the variogram and the path loss look at (sources.md 1.9)
MIN_READINGS: Final = 25  # of an identifier whose path loss is fitted
DISTANCES_M: Final = ((0.0, 1.0), (4.0, 6.0), (11.0, 13.0), (20.0, 24.0))  # of pairs of readings
AGAIN_DBM: Final = (-60.0, -75.0, -85.0)  # strengths, +- 2.5 dB, of which the next sweep is asked
AGAIN_S: Final = 2.6  # a later scan is not the next one
SUBSETS: Final = 24  # of the walks, for each fraction of them
NEIGHBOURS: Final = 3  # by cosine, as the statistics of real surveys were taken
_GRID_M: Final = 4.0  # between the places that are tried for a sender
_MAX_PAIRS: Final = 4000


@dataclass(frozen=True, slots=True, eq=False)
class SurveyWalk:
    """One walk of a surveyor.

    Attributes:
        t_s: (W,) at the waypoints.
        xy_m: (W, 2).
        wifi: (n, 5) rows of the `wifi` stream.
    """

    t_s: FloatArray
    xy_m: FloatArray
    wifi: FloatArray

    @classmethod
    def of(cls, walk: Recording) -> SurveyWalk:
        """The waypoints and the WiFi scans of a walk."""
        return cls(walk.reference.t_s, walk.reference.xy_m, walk.streams["wifi"].rows)

    def place_m(self, t_s: FloatArray) -> FloatArray:
        """(N, 2) on the straight lines between waypoints."""
        return np.column_stack([np.interp(t_s, self.t_s, self.xy_m[:, axis]) for axis in (0, 1)])

    def scans(self) -> Iterator[FloatArray]:
        """(n, 5) rows of each scan between the first and the last waypoint."""
        rows = self.wifi[(self.wifi[:, 0] >= self.t_s[0]) & (self.wifi[:, 0] <= self.t_s[-1])]
        if len(rows):
            yield from np.split(rows, np.flatnonzero(np.diff(rows[:, 0])) + 1)


def walk_values(walks: Sequence[SurveyWalk]) -> dict[str, FloatArray]:
    """One value a walk with two scans or more; staleness and freshness over all its readings."""
    rows = [walk.wifi for walk in walks if len(np.unique(walk.wifi[:, 0])) > 1]
    return {
        "wifi_entries": np.array([len(r) / len(np.unique(r[:, 0])) for r in rows]),
        "wifi_fresh": np.array([(r[:, 4] < FRESH_S).mean() for r in rows]),
        "wifi_age_median_s": np.array([np.median(r[:, 4]) for r in rows]),
        "wifi_age_p95_s": np.array([np.percentile(r[:, 4], 95) for r in rows]),
        "wifi_period_s": np.array([np.median(np.diff(np.unique(r[:, 0]))) for r in rows]),
    }


def floor_values(walks: Sequence[SurveyWalk]) -> dict[str, float]:
    """One value for all walks of a floor, of which a dozen or more are needed for statistics of pairs and quarters."""
    rng = np.random.default_rng(0)  # for the choice of pairs and of walks left out
    return _again(walks) | _spread(rng, walks) | _matching(rng, walks)


def _again(walks: Sequence[SurveyWalk]) -> dict[str, float]:
    """Fractions of readings of one sweep, by strength, that the next one repeats."""
    pairs = []
    for walk in walks:
        scans = [rows[rows[:, 4] < FRESH_S] for rows in walk.scans()]
        for rows, later in itertools.pairwise(scans):
            if len(rows) and len(later) and later[0, 0] - rows[0, 0] < AGAIN_S:
                pairs.append(np.column_stack([rows[:, 2], np.isin(rows[:, 1], later[:, 1])]))
    rssi_dbm, is_again = np.vstack(pairs).T
    return {
        f"wifi_again_{-centre:.0f}": float(is_again[np.abs(rssi_dbm - centre) < 2.5].mean()) for centre in AGAIN_DBM
    }


# The variogram and the path loss.


def _spread(rng: np.random.Generator, walks: Sequence[SurveyWalk]) -> dict[str, float]:
    """Variogram between walks, and path loss, of the identifiers that were received in most walks."""
    rssi_dbm, xy_m, walk = _fresh_readings(walks)
    exponent, sigma_db = _path_loss(rssi_dbm, xy_m)
    values = {"wifi_exponent": float(np.median(exponent)), "wifi_sigma_db": float(np.median(sigma_db))}
    one, other = np.triu_indices(len(walk), 1)
    one, other = (index[walk[one] != walk[other]] for index in (one, other))
    distance_m = np.hypot(*(xy_m[one] - xy_m[other]).T)
    for low_m, high_m in DISTANCES_M:
        pair = np.flatnonzero((distance_m >= low_m) & (distance_m < high_m))
        if len(pair) > _MAX_PAIRS:
            pair = rng.choice(pair, _MAX_PAIRS, replace=False)
        difference_db = rssi_dbm[one[pair]] - rssi_dbm[other[pair]]
        name = f"wifi_variogram_{(low_m + high_m) / 2:.0f}m"
        values[name] = float(np.sqrt(np.nanmean(difference_db**2) / 2)) if len(pair) else float("nan")
    return values


def _fresh_readings(walks: Sequence[SurveyWalk]) -> tuple[FloatArray, FloatArray, IntArray]:
    """Scan by scan what came from its own sweep.

    Returns:
        rssi_dbm: (S, A) NaN where nothing was received; identifiers received in most walks.
        xy_m: (S, 2) in the middle of the sweep.
        walk: (S,) int.
    """
    scans = [(number, rows[rows[:, 4] < FRESH_S]) for number, walk in enumerate(walks) for rows in walk.scans()]
    scans = [(number, rows) for number, rows in scans if len(rows)]
    senders, column = np.unique(np.concatenate([rows[:, 1] for _, rows in scans]), return_inverse=True)
    scan = np.repeat(np.arange(len(scans)), [len(rows) for _, rows in scans])
    walk = np.array([number for number, _ in scans])
    pairs = np.unique(np.column_stack([column, walk[scan]]), axis=0)
    by_count = np.argsort(-np.bincount(pairs[:, 0], minlength=len(senders)), kind="stable")
    rssi_dbm = np.full((len(scans), len(senders)), np.nan)
    rssi_dbm[scan, column] = np.concatenate([rows[:, 2] for _, rows in scans])
    xy_m = np.vstack([walks[n].place_m(np.array([np.mean(rows[:, 0] - rows[:, 4])])) for n, rows in scans])
    return rssi_dbm[:, by_count[:MAX_SENDERS]], xy_m, walk


def _path_loss(rssi_dbm: FloatArray, xy_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Exponent and residual of P - 10 n log10(d), d at least 1 m, with P, n and the place of the sender free.

    Returns:
        exponent: (A',) of the identifiers with enough readings.
        sigma_db: (A',).
    """
    low, high = xy_m.min(axis=0) - 10.0, xy_m.max(axis=0) + 10.0
    axes = [np.arange(a, b, _GRID_M) for a, b in zip(low, high, strict=True)]
    grid_m = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    decades = np.log10(np.maximum(cdist(grid_m, xy_m), 1.0))
    # Straight lines through the readings of every identifier, for every place of the sender.
    rssi_dbm = rssi_dbm[:, (~np.isnan(rssi_dbm)).sum(axis=0) >= MIN_READINGS]
    is_heard = (~np.isnan(rssi_dbm)).astype(np.float64)
    count = is_heard.sum(axis=0)
    y = np.where(is_heard > 0, rssi_dbm - np.nanmean(rssi_dbm, axis=0), 0.0)
    sum_x, sum_xx, sum_xy = decades @ is_heard, decades**2 @ is_heard, decades @ y
    spread = np.maximum(sum_xx - sum_x**2 / count, 1e-12)
    left = (y**2).sum(axis=0) - sum_xy**2 / spread
    left[sum_xy > 0] = np.inf  # no signal gets stronger with distance
    best, column = left.argmin(axis=0), np.arange(len(count))
    return -sum_xy[best, column] / spread[best, column] / 10, np.sqrt(left[best, column] / (count - 4))


# Matching scans, each walk against the others.


def _matching(rng: np.random.Generator, walks: Sequence[SurveyWalk]) -> dict[str, float]:
    """Mean error when each walk is located by the others, and by what factor it grows with half and a quarter."""
    survey = survey_of(walks)
    distance = _fingerprint_distances(survey, [rows for walk in walks for rows in walk.scans()])
    whole = _mean_error_m(distance, survey.walk, survey.xy_m, [np.arange(len(walks))])[0]
    values = {"wifi_knn_m": whole}
    for name, part in (("half", 2), ("quarter", 4)):
        chosen = [rng.choice(len(walks), len(walks) // part, replace=False) for _ in range(SUBSETS)]
        values[f"wifi_knn_{name}"] = float(np.mean(_mean_error_m(distance, survey.walk, survey.xy_m, chosen)) / whole)
    return values


def survey_of(walks: Sequence[SurveyWalk]) -> RadioMap:
    """Scans of walks on one floor, placed by interpolation between their waypoints, as a survey team does it."""
    found = [(number, rows) for number, walk in enumerate(walks) for rows in walk.scans()]
    xy_m = np.vstack([walks[number].place_m(rows[:1, 0]) for number, rows in found])
    readings = np.vstack([rows[:, [1, 2, 4]] for _, rows in found])
    walk, count = np.array([(number, len(rows)) for number, rows in found]).T
    return survey_of_readings(xy_m, 0, walk, count, readings, surveyed=False)


def _fingerprint_distances(survey: RadioMap, scans: Sequence[FloatArray]) -> FloatArray:
    """(S, S) from each scan to each fingerprint, by the cosine."""
    matcher = ScanMatcher(survey, sensor_spec("wifi"))
    found = [matcher.distance(rows[:, [1, 2, 4]]) for rows in scans]
    return np.stack([np.ones(len(survey)) if distance is None else distance for distance in found])


def _mean_error_m(distance: FloatArray, walk: IntArray, xy_m: FloatArray, chosen: Sequence[IntArray]) -> list[float]:
    """For each choice of walks: every scan of them is placed by the scans of the other chosen ones."""
    order = np.argsort(np.where(walk[:, None] == walk, np.inf, distance), axis=1, kind="stable")
    errors = []
    for walks in chosen:
        is_chosen = np.isin(walk, walks)
        scan = np.flatnonzero(is_chosen)
        is_other = is_chosen[order[scan]] & (walk[order[scan]] != walk[scan, None])
        rank = np.argsort(~is_other, axis=1, kind="stable")[:, :NEIGHBOURS]
        nearest = order[scan[:, None], rank]
        weight = 1.0 / np.maximum(distance[scan[:, None], nearest], 1e-9) ** 2
        found_m = (weight[..., None] * xy_m[nearest]).sum(axis=1) / weight.sum(axis=1, keepdims=True)
        errors.append(float(np.hypot(*(found_m - xy_m[scan]).T).mean()))
    return errors
