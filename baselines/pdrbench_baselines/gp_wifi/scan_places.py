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
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray, IntArray
from pdrbench.radio import ScanMatcher
from pdrbench.recording import RadioMap, SensorSpec
from pdrbench_baselines.gp_wifi.kernels import mixture, mixtures

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

    def density_per_m2(self, xy_m: FloatArray, level: IntArray) -> FloatArray:
        """(N,) at places (N, 2) on levels (N,); nowhere 0."""
        scale = (1.0 - self.astray) / (2.0 * math.pi * self.spread_m**2)
        own = self.xy_m, self.level, scale * self.weight
        density: FloatArray = mixture(xy_m, level, *own, self.spread_m, self.astray / self.area_m2)
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
        levels = [self._table.xy_m[self._table.level == level] for level in np.unique(self._table.level)]
        # Rectangles around the survey of every level, 100 m2 at least.
        self._area_m2 = float(sum(max(float(np.prod(np.ptp(xy_m, axis=0))), 100.0) for xy_m in levels))
        self.softness, self.spread_m, self.astray = self._settings()

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
        kept = np.flatnonzero(weight > NEAR)
        kept = kept[np.argsort(-weight[kept], kind="stable")[:MAX_PLACES]]
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
        matched = np.isfinite(distance.min(axis=1))
        if not matched.any():
            return SOFTNESS[1], SPREAD_M[3], ASTRAY[2]
        table, spread_m = self._table, np.array(SPREAD_M)
        scans = distance[matched], asked[matched]
        found_m2 = mixtures(*scans, table.xy_m.copy(), table.level.copy(), np.array(SOFTNESS), spread_m)
        density = found_m2[:, :, None] / (2.0 * math.pi * spread_m[:, None, None] ** 2)
        astray = np.array(ASTRAY)[:, None]
        likely = np.log((1.0 - astray) * density + astray / self._area_m2).mean(axis=3)
        softest, widest, most = np.unravel_index(np.argmax(likely), likely.shape)
        return SOFTNESS[softest], SPREAD_M[widest], ASTRAY[most]
