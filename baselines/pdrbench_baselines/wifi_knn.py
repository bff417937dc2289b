"""Weighted nearest fingerprints: the baseline of every WLAN paper since RADAR (Bahl & Padmanabhan 2000)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.radio import FingerprintTable, cosine_distance, strength
from pdrbench.trajectory import Start


@dataclass(frozen=True, slots=True)
class WifiKnnParams:
    """Chosen on the train and survey walks of MallPhoneLost-v0, each matched against all others."""

    neighbours: int = 3
    power: float = 2.5  # of the strength; see `pdrbench.radio.strength`
    survey_age_s: float = 12.0  # an older reading of the survey was heard somewhere else
    freshness_per_s: float = 0.8  # a reading of the scan counts for 0.8 ** age


class WifiKnn:
    """Answers the mean of the places whose fingerprints are nearest to the last scan, the nearer the heavier.

    Before the first scan it answers the start, where one is told, else the middle of the survey.

    Args:
        params: See `WifiKnnParams`.
    """

    def __init__(self, params: WifiKnnParams | None = None) -> None:
        self._params = params or WifiKnnParams()

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("wifi",), radio_map=True)
        assert briefing.radio_map is not None
        wifi = briefing.sensors["wifi"]
        self._columns = [wifi.index(name) for name in ("access_point", "rssi_dbm", "age_s")]
        self._scan: FloatArray = np.zeros((0, len(wifi.columns)))
        self._table = FingerprintTable.from_radio_map(briefing.radio_map, max_age_s=self._params.survey_age_s)
        self._fingerprints = strength(self._table.rssi_dbm, self._params.power)
        start = briefing.start or self._middle()
        self._estimate = Estimate(xy_m=start.xy_m, level=start.level)

    def step(self, observation: Observation) -> Estimate:
        rows = observation["wifi"]
        if len(rows):
            rows = np.concatenate([self._scan, rows])  # a long scan can arrive in parts
            self._scan = rows[rows[:, 0] == rows[-1, 0]]
            self._match(self._scan[:, self._columns])
        return self._estimate

    def _middle(self) -> Start:
        """The middle of the survey, on the level where most of it was done."""
        levels, scans = np.unique(self._table.level, return_counts=True)
        level = int(levels[np.argmax(scans)])
        return Start(xy_m=self._table.xy_m[self._table.level == level].mean(axis=0), level=level)

    def _match(self, readings: FloatArray) -> None:
        """Takes (n, 3) access point, RSSI, age; keeps the last estimate where the survey knows none of them."""
        column, known = self._table.columns(readings[:, 0])
        if not known.any():
            return
        readings, column = readings[known], column[known]
        order = np.argsort(readings[:, 1], kind="stable")  # where one stands twice, the strongest counts
        scan, weight = np.zeros(len(self._table.access_point)), np.ones(len(self._table.access_point))
        scan[column[order]] = strength(readings[order, 1], self._params.power)
        weight[column[order]] = self._params.freshness_per_s ** readings[order, 2]
        self._estimate = self._mean_of_nearest(cosine_distance(self._fingerprints, scan, weight))

    def _mean_of_nearest(self, distance: FloatArray) -> Estimate:
        """The weighted mean on the level that most of the weight lies on."""
        nearest = np.argsort(distance, kind="stable")[: self._params.neighbours]
        weight = 1.0 / np.maximum(distance[nearest], 1e-9) ** 2
        levels = self._table.level[nearest]
        candidates = np.unique(levels)
        level = int(candidates[np.argmax([weight[levels == candidate].sum() for candidate in candidates])])
        weight = weight * (levels == level)
        return Estimate(xy_m=weight @ self._table.xy_m[nearest] / weight.sum(), level=level)
