"""indoorloc: weighted nearest neighbours of a scan among the fingerprints of a survey."""

from __future__ import annotations

import numpy as np

from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.radio import middle_of_survey
from pdrbench_lab.outsiders.dense_scans import DenseScans
from pdrbench_lab.outsiders.packages import outside

NEIGHBOURS = 5  # its own


class IndoorlocWknn:
    """Answers the last scan by indoorloc's `WKNNLocalizer` with its own settings: five neighbours, the nearer heavier.

    An access point that is not heard counts as -100 dBm; indoorloc leaves that to the user.
    """

    def __init__(self) -> None:
        self._package = outside("indoorloc")

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("wifi",), radio_map=True)
        assert briefing.radio_map is not None
        self._scans = scans = DenseScans(briefing.radio_map, briefing.sensors["wifi"])
        self._model = self._package.WKNNLocalizer(min(NEIGHBOURS, len(scans.level)), predict_building=False)
        self._lowest = int(scans.level.min())  # indoorloc takes a negative floor as not known
        places = [
            self._package.Location(self._package.Coordinate(x=x_m, y=y_m), floor=level - self._lowest)
            for (x_m, y_m), level in zip(scans.xy_m.tolist(), scans.level.tolist(), strict=True)
        ]
        self._model.fit([self._package.WiFiSignal(row) for row in scans.rssi_dbm], places)
        start = briefing.start or middle_of_survey(scans.xy_m, scans.level)
        self._estimate = Estimate(start.xy_m, start.level)

    def step(self, observation: Observation) -> Estimate:
        scan_dbm = self._scans.last(observation["wifi"])
        if scan_dbm is not None:  # else the last estimate is kept
            place = self._model.predict(self._package.WiFiSignal(scan_dbm)).location
            xy_m = np.array([place.coordinate.x, place.coordinate.y])
            self._estimate = Estimate(xy_m, int(place.floor) + self._lowest)
        return self._estimate
