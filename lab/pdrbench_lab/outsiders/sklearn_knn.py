"""scikit-learn: nearest neighbours of a scan among the fingerprints of a survey."""

from __future__ import annotations

import numpy as np

from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.radio import middle_of_survey
from pdrbench_lab.outsiders.dense_scans import DenseScans
from pdrbench_lab.outsiders.packages import outside

NEIGHBOURS = 3  # as RADAR


class SklearnKnn:
    """Answers the last scan by scikit-learn's k-NN: places by regression, levels by a vote, Euclidean in dBm.

    An access point that is not heard counts as -100 dBm, as in RADAR and the papers after it.
    """

    def __init__(self) -> None:
        self._neighbors = outside("sklearn.neighbors")

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("wifi",), radio_map=True)
        assert briefing.radio_map is not None
        self._scans = DenseScans(briefing.radio_map, briefing.sensors["wifi"])
        neighbours = min(NEIGHBOURS, len(self._scans.level))
        self._place = self._neighbors.KNeighborsRegressor(neighbours, algorithm="brute")
        self._place.fit(self._scans.rssi_dbm, self._scans.xy_m)
        self._level = self._neighbors.KNeighborsClassifier(neighbours, algorithm="brute")
        self._level.fit(self._scans.rssi_dbm, self._scans.level)
        start = briefing.start or middle_of_survey(self._scans.xy_m, self._scans.level)
        self._estimate = Estimate(start.xy_m, start.level)

    def step(self, observation: Observation) -> Estimate:
        scan_dbm = self._scans.last(observation["wifi"])
        if scan_dbm is not None:  # else the last estimate is kept
            xy_m, level = self._place.predict(scan_dbm[None]), self._level.predict(scan_dbm[None])
            self._estimate = Estimate(xy_m[0], int(level[0]))
        return self._estimate
