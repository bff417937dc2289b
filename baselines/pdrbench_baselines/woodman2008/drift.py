"""The turn that a foot-mounted unit adds to every stride, learned from what the map takes back."""

from __future__ import annotations

import math
from dataclasses import dataclass

from pdrbench.geometry import wrap_rad


@dataclass(frozen=True, slots=True)
class TurnDrift:
    """A constant drift as a normal belief, updated by a scalar Kalman filter.

    A stride event reports a turn u. Only particles that turned as the walker did are not stopped by walls, so the mean
    heading of a converged cloud turns by u less the drift, with a random error for what the walls do not determine:
    u - change of mean heading = drift + N(0, `turn_sigma_rad`^2).

    Attributes:
        mean_rad: Expected drift per stride.
        sigma_rad: Standard deviation of what is known of it.
        turn_sigma_rad: Of one observation.

    >>> drift = TurnDrift(mean_rad=0.0, sigma_rad=0.01, turn_sigma_rad=0.01)
    >>> round(drift.observed(reported_rad=0.52, turned_rad=0.50).mean_rad, 6)
    0.01
    """

    mean_rad: float
    sigma_rad: float
    turn_sigma_rad: float

    def observed(self, reported_rad: float, turned_rad: float) -> TurnDrift:
        """The belief after one stride.

        Args:
            reported_rad: Turn of the stride event.
            turned_rad: By how much the mean heading of the cloud turned.
        """
        variance, noise = self.sigma_rad**2, self.turn_sigma_rad**2
        if not variance > 0:
            return self
        gain = variance / (variance + noise)
        innovation_rad = float(wrap_rad(reported_rad - turned_rad - self.mean_rad))
        return TurnDrift(
            mean_rad=self.mean_rad + gain * innovation_rad,
            sigma_rad=math.sqrt((1 - gain) * variance),
            turn_sigma_rad=self.turn_sigma_rad,
        )
