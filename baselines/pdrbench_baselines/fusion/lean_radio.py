"""The radio evidence of `fusion` at a fraction of the expense: of levels and offsets that particles still have."""

from __future__ import annotations

from collections.abc import Collection, Iterator

import numpy as np

from pdrbench.building import Building
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.recording import RadioMap
from pdrbench_baselines.fusion.kernels import add_reading
from pdrbench_baselines.fusion.radio import MIN_LOG, RadioEvidence
from pdrbench_baselines.gp_wifi.localizer import GpWifiParams


class LeanRadioEvidence(RadioEvidence):
    """`RadioEvidence` that fits and evaluates fields only where `focus` says that particles may be.

    Args:
        radio_map, building, params, error_m: As `RadioEvidence`.
    """

    def __init__(self, radio_map: RadioMap, building: Building | None, params: GpWifiParams, error_m: float) -> None:
        super().__init__(radio_map, building, params, error_m, is_lazy=True)

    def begin(self, trust: float, fingerprint_trust: float = 0.0) -> None:
        super().begin(trust, fingerprint_trust)
        self._offsets = np.arange(len(self.prior))

    def focus(self, levels: Collection[int], is_left: BoolArray) -> None:
        """Scans are evaluated on these levels and those between them, on all where none is surveyed, and under the
        offsets (K,) that are left."""
        on = np.flatnonzero(np.isin(self._map.levels, list(levels)))
        if len(on):
            self._numbers = range(int(on[0]), int(on[-1]) + 1)
        self._offsets = np.flatnonzero(is_left)

    def update(self, rows: FloatArray) -> Iterator[FloatArray]:
        """Log-likelihoods (N, K), up to a constant, of all scans among the next rows together; very low elsewhere."""
        if not len(rows):
            return
        places = slice(int(self._map.first[self._numbers[0]]), int(self._map.first[self._numbers[-1] + 1]))
        total = np.zeros((places.stop - places.start, len(self._offsets)))
        for likelihood in self._of_fields(rows):
            total += likelihood
        if self.fingerprints is not None and self._fingerprint_trust > 0.0:
            for density in self.fingerprints.update(rows, places):
                total += self._fingerprint_trust * density[:, None]
        if np.ptp(total) > 0.0:
            everywhere = np.full((len(self.level), len(self.prior)), MIN_LOG)
            everywhere[places, self._offsets] = np.maximum(total - total.max(), MIN_LOG)
            yield everywhere

    def _of_fields(self, rows: FloatArray) -> Iterator[FloatArray]:
        """(n, k) of each scan at the places and under the offsets that are left."""
        if self._trust == 0.0:
            return
        for _, fresh, _ in self._sweeps.update(rows):
            likelihood = self._likelihood(fresh)
            if np.ptp(likelihood) > 0.0:
                yield self.spread(self._trust * likelihood)

    def _likelihood(self, fresh: FloatArray) -> FloatArray:
        p, offset_db = self.params, self.offset_db[self._offsets]
        access_points = fresh[:, 1].astype(np.int64)
        readings = [(dbm, p.trust_of(dbm), *p.reported_of(dbm)) for dbm in fresh[:, 2].tolist()]
        found = [np.zeros((size, len(offset_db))) for size in np.diff(self._map.first)[self._numbers]]
        for number, part in zip(self._numbers, found, strict=True):
            fields = self._map.prepare(access_points, number)
            for one, (dbm, trust, reported, unexpected) in zip(fields, readings, strict=True):
                if one is not None:
                    odds, noise_db2 = reported / unexpected, p.field.noise_db**2
                    add_reading(part, one.at, one.mean_dbm, one.variance_db2, dbm, offset_db, noise_db2, odds, trust)
        return np.concatenate(found)
