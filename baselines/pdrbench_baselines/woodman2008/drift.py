"""The turn that a foot-mounted unit adds to every stride, learned from what the map takes back."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from pdrbench.geometry import wrap_rad
from pdrbench_baselines.woodman2008.params import WoodmanFilterParams


@dataclass(frozen=True, slots=True)
class DriftParams:
    """What foot-mounted units do: lengths come short, and every walk has a drift to learn; beyond the paper.

    The priors are the mean bias of length and the root mean square of the drift of `foot_dual`, a set that no
    environment draws its strides from: two feet of one person, two walks, so that the prior is wide and its mean is 0.
    The other settings were chosen on the train and val walks of the replica of the paper's building.

    Attributes:
        length_scale: Factor on every length.
        sigma_rad: Spread over walks of the turn that the unit adds to every stride.
        turn_sigma_rad: Noise of one observation of it; see `TurnDrift`.
        steady_strides: For which a single place has to stand before it is believed, instead of that of the paper.
        search: Settings of the filter until it has converged, and again after a depletion: the heading is as uncertain
            as a drift that is not known yet makes it, and there are more particles.
    """

    length_scale: float = 1.0 / (1.0 - 0.01768)  # `pdrbench error-model --law`
    sigma_rad: float = math.radians(0.1681)  # likewise: -0.22 of the left foot, 0.10 of the right one
    turn_sigma_rad: float = math.radians(1.0)  # ours
    steady_strides: int = 20
    search: WoodmanFilterParams = field(
        default_factory=lambda: WoodmanFilterParams(
            heading_sigma_rad=math.radians(1.0), kld_epsilon=0.0125, max_particles=2_000_000
        )
    )


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
