"""Where a scan was received by the fingerprints of a survey: the less it resembles the nearest, the less that says."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.spatial import KDTree

from pdrbench.geometry import FloatArray, IntArray
from pdrbench.recording import RadioMap, SensorSpec
from pdrbench_baselines.gp_wifi.scan_places import ScanLocator, ScanPlaces

MIN_ODDS: Final = 1e-3  # cosine distances nearer to 0 or 1 count as that


@dataclass(frozen=True, slots=True)
class FingerprintParams:
    """Of a survey whose places were interpolated; one of surveyed places is calibrated on itself (`ScanLocator`).

    Read off train walks of MallPhoneLost-v2 whose sessions were left out of the survey, 7 277 scans. A scan at a cosine
    distance below 0.1 from its nearest fingerprint was always on the level of that one, half of the time within 9 m; at
    0.3 it was there in 57 %, and 20 m away in the median of these. A survey asked about its own
    walks does not show this: it holds other walks of the same minutes.

    How near a place is to the survey is evidence of its own: of the scans within 3 m of one of the survey's 96 % were
    nearer than 0.35 to a fingerprint, of those beyond 25 m 17 %.

    Attributes:
        spread_m: Standard deviation per axis around the place of a fingerprint that is equal to the scan.
        spread_by_distance_m: By which it grows with the distance of the nearest fingerprint.
        astray: Fraction of scans that say nothing of the place, of those far from all fingerprints.
        astray_distance: Distance at which half of that fraction is reached.
        astray_width: Of the logistic curve around it.
        min_astray: That fraction, at least.
        apart_m: Distances of a place from the nearest scan of the survey, ascending.
        log_odds: Mean log-odds of the distance of the nearest fingerprint there; between them on lines.
        log_odds_sigma: Their standard deviation.
    """

    spread_m: float = 3.0
    spread_by_distance_m: float = 25.0
    astray: float = 0.6
    astray_distance: float = 0.24
    astray_width: float = 0.03
    min_astray: float = 0.005
    apart_m: tuple[float, ...] = (0.0, 3.0, 8.0, 15.0, 25.0, 40.0, 60.0)
    log_odds: tuple[float, ...] = (-2.17, -1.87, -1.32, -0.62, 0.23, 0.73, 0.85)
    log_odds_sigma: float = 1.2

    def log_nearness(self, nearest: float, expected: FloatArray) -> FloatArray:
        """(N,) log-likelihood of the distance of the nearest fingerprint where log-odds (N,) are expected."""
        nearest = min(max(nearest, MIN_ODDS), 1.0 - MIN_ODDS)
        off: FloatArray = (math.log(nearest / (1.0 - nearest)) - expected) / self.log_odds_sigma
        return -0.5 * off**2

    def honest(self, places: ScanPlaces) -> ScanPlaces:
        """The same places with the spread and the doubt that the distance of the nearest fingerprint calls for."""
        over = (places.nearest - self.astray_distance) / self.astray_width
        astray = self.astray / (1.0 + float(np.exp(-over)))
        spread_m = self.spread_m + self.spread_by_distance_m * places.nearest
        return replace(places, spread_m=spread_m, astray=max(astray, self.min_astray))


class FingerprintEvidence:
    """Log-densities of scans on a lattice.

    Args:
        radio_map: With one scan or more.
        wifi: What the columns of a row are.
        params: See `FingerprintParams`.
        xy_m: (N, 2) the lattice.
        level: (N,) int.
    """

    def __init__(
        self, radio_map: RadioMap, wifi: SensorSpec, params: FingerprintParams, xy_m: FloatArray, level: IntArray
    ) -> None:
        self._locator, self._params = ScanLocator(radio_map, wifi), params
        self._is_surveyed, self._xy_m, self._level = radio_map.surveyed, xy_m, level
        apart_m = np.full(len(xy_m), params.apart_m[-1])
        for one in np.unique(radio_map.level).tolist():
            here = level == one
            apart_m[here] = KDTree(radio_map.xy_m[radio_map.level == one]).query(xy_m[here])[0]
        self._expected = np.interp(apart_m, params.apart_m, params.log_odds)

    def begin(self) -> None:
        """Begins another walk."""
        self._locator.forget()

    def update(self, rows: FloatArray, places: slice = slice(None)) -> Iterator[FloatArray]:
        """(n,) logarithm of the density of each scan among the next rows at places of the lattice; the highest is 0."""
        for found in self._locator.update(rows):
            taken = found if self._is_surveyed else self._params.honest(found)
            density = np.log(taken.density_per_m2(self._xy_m[places], self._level[places]))
            if not self._is_surveyed:
                density += self._params.log_nearness(found.nearest, self._expected[places])
            yield density - density.max()
