"""A magnetometer on a foot: which samples to believe and where the field points."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pdrbench.geometry import FloatArray


@dataclass(frozen=True, slots=True)
class FieldParams:
    """Settings for a magnetometer (F7); within 30 cm of the floor the field is rarely the Earth's (W19).

    Attributes:
        sigma_rad: Standard deviation of the heading of one sample.
        gate: A heading further off than so many standard deviations is not used.
        strength_fraction: Largest relative difference of its strength from that of the first samples at rest.
        dip_rad: Largest difference of its dip from theirs.
        every_s: At most one sample in this time is used: the disturbance of neighbours is the same.
    """

    sigma_rad: float = math.radians(15.0)
    gate: float = 3.0
    strength_fraction: float = 0.1
    dip_rad: float = math.radians(5.0)
    every_s: float = 0.5


class FieldGate:
    """Chooses the samples of a magnetometer that are used, while the foot rests and the field is undisturbed."""

    def __init__(self, params: FieldParams) -> None:
        self._params = params
        self._strength_ut, self._dip_rad = math.nan, math.nan
        self._used_s = -math.inf

    def choose(self, t_s: FloatArray, accel: FloatArray, field: FloatArray, sigma_mps: FloatArray) -> FloatArray:
        """(n, 3) the field where it is to be used, NaN elsewhere.

        Args:
            t_s: (n,) seconds.
            accel: (n, 3) specific force; up, where the foot rests.
            field: (n, 3) microtesla, NaN where there is none.
            sigma_mps: (n,) of `Rest`.
        """
        p = self._params
        used = np.full_like(field, np.nan)
        rests = np.flatnonzero(np.isfinite(sigma_mps) & (sigma_mps < 0.1) & np.isfinite(field).all(axis=1))
        if not len(rests) or t_s[rests[-1]] - self._used_s < p.every_s:
            return used
        seen, force = field[rests], accel[rests]
        strength_ut = np.linalg.norm(seen, axis=1)
        sine = (seen * force).sum(axis=1) / np.maximum(strength_ut * np.linalg.norm(force, axis=1), 1e-12)
        dip_rad = np.arcsin(sine.clip(-1.0, 1.0))
        if math.isnan(self._strength_ut):
            self._strength_ut, self._dip_rad = float(strength_ut[0]), float(dip_rad[0])
        is_strong = np.abs(strength_ut - self._strength_ut) < p.strength_fraction * self._strength_ut
        for k in rests[is_strong & (np.abs(dip_rad - self._dip_rad) < p.dip_rad)].tolist():
            if t_s[k] - self._used_s >= p.every_s:
                used[k] = field[k]
                self._used_s = float(t_s[k])
        return used
