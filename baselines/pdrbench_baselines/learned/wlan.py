"""Where a WLAN scan may have been received: a mixture of surveyed places, as wide as the survey itself says.

How far a scan is from the place of its nearest fingerprint differs by a factor of five between one survey and the next:
two metres where the surveyor stood in every room, ten where walks are placed by interpolation. Each survey is therefore
asked first: every scan of it is matched against those of all other walks, and the settings are taken under which the
places where these scans were received are likeliest.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray, IntArray
from pdrbench.radio import ScanMatcher, middle_of_survey
from pdrbench.recording import RadioMap, SensorSpec
from pdrbench.trajectory import Start

SOFTNESS: Final = (0.005, 0.01, 0.02, 0.04, 0.08)  # cosine distances over which a fingerprint loses 1 / e
SPREAD_M: Final = (1.5, 2.0, 3.0, 4.5, 7.0, 10.0)  # of what was received around the place of its fingerprint, per axis
ASTRAY: Final = (0.02, 0.05, 0.1, 0.2, 0.4)  # fractions of scans that say nothing of the place
MAX_ASKED: Final = 300  # scans of a survey; more say the same
MAX_PLACES: Final = 60  # of a mixture: the heaviest
NEAR: Final = 1e-3  # of the largest weight; places of less are left out


@dataclass(frozen=True, slots=True)
class ScanPlaces:
    """What one scan says.

    Attributes:
        xy_m: (K, 2) surveyed places.
        level: (K,) of them.
        weight: (K,) their sum is 1.
        spread_m: Standard deviation per axis around each.
        astray: Fraction of the scans that say nothing of the place.
        area_m2: Within which such scans are received.
        nearest: Distance of the scan from the nearest fingerprint.
    """

    xy_m: FloatArray
    level: IntArray
    weight: FloatArray
    spread_m: float
    astray: float
    area_m2: float
    nearest: float = 0.0

    @property
    def likeliest_level(self) -> int:
        """That of most weight."""
        levels, which = np.unique(self.level, return_inverse=True)
        return int(levels[np.argmax(np.bincount(which, self.weight))])

    def density_per_m2(self, xy_m: FloatArray, level: IntArray) -> FloatArray:
        """(N,) at places (N, 2) on levels (N,); nowhere 0."""
        density = np.full(len(xy_m), self.astray / self.area_m2)
        scale = (1.0 - self.astray) / (2.0 * math.pi * self.spread_m**2)
        for one in np.unique(self.level).tolist():
            here, own = np.flatnonzero(level == one), self.level == one
            away = xy_m[here, None, :] - self.xy_m[None, own, :]
            kernel = np.exp(-0.5 * np.sum(away**2, axis=2) / self.spread_m**2)
            density[here] += scale * kernel @ self.weight[own]
        return density


class ScanLocator:
    """A radio survey and how far it is to be trusted.

    Args:
        radio_map: With one scan or more.
        wifi: What the columns of a scan are.
    """

    def __init__(self, radio_map: RadioMap, wifi: SensorSpec) -> None:
        self.radio_map = radio_map
        self._matcher = ScanMatcher(radio_map, wifi)
        self._table = self._matcher.table
        self.levels = frozenset(self._table.level.tolist())
        levels = [self._table.xy_m[self._table.level == level] for level in np.unique(self._table.level)]
        # Rectangles around the survey of every level, 100 m2 at least.
        self._area_m2 = float(sum(max(float(np.prod(np.ptp(xy_m, axis=0))), 100.0) for xy_m in levels))
        self.softness, self.spread_m, self.astray = self._settings()

    def middle(self) -> Start:
        """See `middle_of_survey`."""
        return middle_of_survey(self._table.xy_m, self._table.level)

    def forget(self) -> None:
        """Begins another walk."""
        self._matcher.forget()

    def update(self, rows: FloatArray) -> Iterator[ScanPlaces]:
        """Takes the next rows and gives what each scan among them says, see `ScanMatcher.update`.

        One of which the survey knows no access point says nothing.
        """
        for distance in self._matcher.update(rows):
            if distance is not None:
                yield self._places(distance)

    def _places(self, distance: FloatArray) -> ScanPlaces:
        """Of the distances (S,) of a scan."""
        weight = np.exp(-(distance - distance.min()) / self.softness)
        kept = np.argsort(-weight, kind="stable")[:MAX_PLACES]
        kept = kept[weight[kept] > NEAR]
        weight = weight[kept] / weight[kept].sum()
        table = self._table
        return ScanPlaces(
            table.xy_m[kept],
            table.level[kept],
            weight,
            self.spread_m,
            self.astray,
            self._area_m2,
            float(distance.min()),
        )

    def _settings(self) -> tuple[float, float, float]:
        """Those under which the places of the survey's own scans are likeliest, given the scans of other walks."""
        walk = self.radio_map.walk
        asked = np.unique(np.linspace(0, len(walk) - 1, MAX_ASKED).astype(np.int64))
        distance = np.where(walk[asked, None] == walk[None, :], np.inf, self._matcher.between(asked))
        nearest = distance.min(axis=1)
        matched = np.isfinite(nearest)
        if not matched.any():
            return SOFTNESS[1], SPREAD_M[3], ASTRAY[2]
        distance, asked, nearest = distance[matched], asked[matched], nearest[matched]
        away2 = ((self._table.xy_m[asked, None, :] - self._table.xy_m[None, :, :]) ** 2).sum(axis=2)
        away2[self._table.level[asked, None] != self._table.level[None, :]] = np.inf
        best, found = -math.inf, (SOFTNESS[1], SPREAD_M[3], ASTRAY[2])
        for softness, spread_m in product(SOFTNESS, SPREAD_M):
            weight = np.exp(-(distance - nearest[:, None]) / softness)
            weight /= weight.sum(axis=1, keepdims=True)
            density = (weight * np.exp(-0.5 * away2 / spread_m**2)).sum(axis=1) / (2.0 * math.pi * spread_m**2)
            for astray in ASTRAY:
                likely = float(np.log((1.0 - astray) * density + astray / self._area_m2).mean())
                if likely > best:
                    best, found = likely, (softness, spread_m, astray)
        return found
