"""People: how tall they are and how they walk (sources.md 1.2)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray

LEAST_CADENCE_HZ: Final = 1.25  # below it steps get shorter, not slower; ours
LEAST_STEP_SHARE: Final = 0.45  # of the preferred step, when starting and stopping; ours


@dataclass(frozen=True, slots=True)
class Person:
    """How one person walks.

    Attributes:
        height_m: Body height.
        cadence_hz: Preferred steps per second.
        step_length_m: Step length at that cadence.
        step_slope_m_per_hz: Growth of a step with the cadence.
        asymmetry: Relative excess of the right step over the mean of both.
    """

    height_m: float
    cadence_hz: float
    step_length_m: float
    step_slope_m_per_hz: float
    asymmetry: float

    @property
    def speed_mps(self) -> float:
        """Preferred speed on the flat."""
        return self.cadence_hz * self.step_length_m

    def step_at(self, speed_mps: FloatArray) -> FloatArray:
        """(N,) step length at speeds (N,).

        Speed is f L(f) with L = L0 + a (f - f0), solved for f; a slow walker keeps `LEAST_CADENCE_HZ`.
        """
        slope = self.step_slope_m_per_hz
        rest_m = self.step_length_m - slope * self.cadence_hz
        cadence_hz = (np.sqrt(rest_m**2 + 4 * slope * np.maximum(speed_mps, 0.0)) - rest_m) / (2 * slope)
        step_m = speed_mps / np.maximum(cadence_hz, LEAST_CADENCE_HZ)
        return np.maximum(step_m, LEAST_STEP_SHARE * self.step_length_m)


@dataclass(frozen=True, slots=True)
class PersonParams:
    """How people differ; mean and standard deviation of normal laws, cut at two standard deviations."""

    height_m: tuple[float, float] = (1.70, 0.09)  # sources.md 1.2
    cadence_hz: tuple[float, float] = (1.91, 0.15)  # sources.md 1.2
    step_factor: tuple[float, float] = (1.0, 0.06)  # sources.md 1.2
    step_slope_m_per_hz: tuple[float, float] = (0.30, 0.07)  # sources.md 1.2
    asymmetry: tuple[float, float] = (0.0, 0.02)  # sources.md 1.2


def draw_person(rng: np.random.Generator, params: PersonParams | None = None) -> Person:
    """Draws somebody.

    The step length at the preferred cadence is 0.7 + 0.371 (H - 1.75) + 0.227 (f - 1.79) H / 1.75 times a personal
    factor (Chen, Pei & Chen 2011, as in sources.md 1.2); how it grows with the cadence is personal, too.
    """
    params = params or PersonParams()

    def draw(law: tuple[float, float]) -> float:
        return law[0] + law[1] * float(np.clip(rng.standard_normal(), -2, 2))

    height_m, cadence_hz = draw(params.height_m), draw(params.cadence_hz)
    step_m = 0.7 + 0.371 * (height_m - 1.75) + 0.227 * (cadence_hz - 1.79) * height_m / 1.75
    return Person(
        height_m=height_m,
        cadence_hz=cadence_hz,
        step_length_m=step_m * draw(params.step_factor),
        step_slope_m_per_hz=draw(params.step_slope_m_per_hz),
        asymmetry=draw(params.asymmetry),
    )
