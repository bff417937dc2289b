"""A radio field that several receivers ask about the same places: what reaches these is computed once."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.geometry import FloatArray
from pdrbench_sim.radio.wlan import RadioField


@dataclass(frozen=True, eq=False)
class SharedField(RadioField):
    """A radio field that shares its means with others of the same senders, whose receivers have other thresholds."""

    known_dbm: dict[bytes, FloatArray] = field(kw_only=True, repr=False)  # what was asked of all of them

    @classmethod
    def of(cls, one: RadioField, known_dbm: dict[bytes, FloatArray]) -> SharedField:
        """The same field."""
        return cls(**{part.name: getattr(one, part.name) for part in fields(one)}, known_dbm=known_dbm)

    def rssi_mean_dbm(
        self, level: ArrayLike, xy_m: ArrayLike, height_m: ArrayLike, *, doors_open: ArrayLike = True
    ) -> FloatArray:
        senders = self.access_points.xy_m, self.access_points.rssi_1m_dbm, self.shadow_phase_rad
        asked = hashlib.sha256()
        for values in (*senders, level, xy_m, height_m, doors_open):
            asked.update(np.ascontiguousarray(values).tobytes())
        key = asked.digest()
        if key not in self.known_dbm:
            self.known_dbm[key] = super().rssi_mean_dbm(level, xy_m, height_m, doors_open=doors_open)
        return self.known_dbm[key].copy()
