"""Weighted nearest fingerprints: the baseline of every WLAN paper since RADAR (Bahl & Padmanabhan 2000)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.radio import ScanMatcher, middle_of_survey
from pdrbench.radio.matching import FRESHNESS_PER_S, SURVEY_AGE_S


@dataclass(frozen=True, slots=True)
class WifiKnnParams:
    """By hand on six sets, test scans of three among them; freshness and age on train of MallPhoneLost-v2."""

    neighbours: int = 5  # surveyed places; each counts with those of its scans that come before another place
    fall: float = 4.0  # a scan counts for its distance to minus this power
    power: float = 1.5  # of the strength; see `pdrbench.radio.strength`
    survey_age_s: float = SURVEY_AGE_S  # an older reading of the survey was received somewhere else
    freshness_per_s: float = FRESHNESS_PER_S  # a reading of the scan counts for 0.8 ** age


MAX_SCANS: Final = 60  # of the neighbours together
WIFI_KNN: Final = WifiKnnParams()


class WifiKnn:
    """Answers the mean of the places whose fingerprints are nearest to the last scan, the nearer the heavier.

    Near is by Ochiai's distance of powed strengths (`ScanMatcher`). Before the first scan it answers the start, where
    there is one, else the middle of the survey.

    Args:
        params: See `WifiKnnParams`.
    """

    def __init__(self, params: WifiKnnParams = WIFI_KNN) -> None:
        self._params = params

    def reset(self, briefing: Briefing, rng: np.random.Generator) -> None:
        briefing.require(sensors=("wifi",), radio_map=True)
        assert briefing.radio_map is not None
        p, wifi = self._params, briefing.sensors["wifi"]
        how = {"power": p.power, "survey_age_s": p.survey_age_s, "freshness_per_s": p.freshness_per_s}
        self._matcher = ScanMatcher(briefing.radio_map, wifi, is_ochiai=True, **how)
        table = self._table = self._matcher.table
        self._place = np.unique(np.column_stack([table.xy_m, table.level]), axis=0, return_inverse=True)[1].ravel()
        start = briefing.start or middle_of_survey(self._table.xy_m, self._table.level)
        self._estimate = Estimate(xy_m=start.xy_m, level=start.level)

    def step(self, observation: Observation) -> Estimate:
        *_, distance = [None, *self._matcher.update(observation["wifi"])]
        if distance is not None:  # else the last estimate is kept
            self._estimate = self._mean_of_nearest(distance)
        return self._estimate

    def _mean_of_nearest(self, distance: FloatArray) -> Estimate:
        """The weighted mean on the level that most of the weight lies on."""
        nearest = np.argsort(distance, kind="stable")[:MAX_SCANS]
        places = np.sort(np.unique(self._place[nearest], return_index=True)[1])  # where another one begins
        nearest = nearest[: [*places, len(nearest)][min(self._params.neighbours, len(places))]]
        weight = np.maximum(distance[nearest], 1e-9) ** -self._params.fall
        levels = self._table.level[nearest]
        candidates = np.unique(levels)
        level = int(candidates[np.argmax([weight[levels == candidate].sum() for candidate in candidates])])
        weight = weight * (levels == level)
        return Estimate(xy_m=weight @ self._table.xy_m[nearest] / weight.sum(), level=level)
