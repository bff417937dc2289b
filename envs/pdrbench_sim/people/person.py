"""People: how tall they are and how they walk (sources.md 1.2)."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any, Final

import numpy as np

from pdrbench.errors import PdrbenchError
from pdrbench.geometry import FloatArray

CUT: Final = 2.0  # standard deviations from the mean at which people are cut
MIN_CADENCE_HZ: Final = 1.25  # below it steps get shorter, not slower; ours
MIN_STEP_FRACTION: Final = 0.45  # of the preferred step, when starting and stopping; ours
# What a person can be, runners and children included; ours.
POSSIBLE: Final = {
    "height_m": (0.5, 2.8),
    "cadence_hz": (0.5, 4.0),
    "step_length_m": (0.1, 2.5),
    "step_slope_m_per_hz": (0.01, 3.0),
    "asymmetry": (-0.5, 0.5),
    "step_factor": (0.2, 3.0),
}


class PersonError(PdrbenchError):
    """Facts that no person has."""


@dataclass(frozen=True, slots=True)
class Person:
    """How one person walks."""

    height_m: float  # body height
    cadence_hz: float  # preferred steps per second
    step_length_m: float  # step length at that cadence
    step_slope_m_per_hz: float  # growth of a step with the cadence
    asymmetry: float  # relative excess of the right step over the mean of both

    def __post_init__(self) -> None:
        for name, value in _by_name(self).items():
            _check(f"{name} of a person", value, POSSIBLE[name])

    @property
    def speed_mps(self) -> float:
        """Preferred speed on the flat."""
        return self.cadence_hz * self.step_length_m

    def step_at(self, speed_mps: FloatArray) -> FloatArray:
        """(N,) step length at speeds (N,).

        Speed is f L(f) with L = L0 + a (f - f0), solved for f; a slow walker keeps `MIN_CADENCE_HZ`.
        """
        slope = self.step_slope_m_per_hz
        rest_m = self.step_length_m - slope * self.cadence_hz
        cadence_hz = (np.sqrt(rest_m**2 + 4 * slope * np.maximum(speed_mps, 0.0)) - rest_m) / (2 * slope)
        step_m = speed_mps / np.maximum(cadence_hz, MIN_CADENCE_HZ)
        return np.maximum(step_m, MIN_STEP_FRACTION * self.step_length_m)


@dataclass(frozen=True, slots=True)
class PersonParams:
    """How people differ; mean and standard deviation of normal laws, cut at two standard deviations."""

    height_m: tuple[float, float] = (1.70, 0.09)  # sources.md 1.2
    cadence_hz: tuple[float, float] = (1.91, 0.15)  # sources.md 1.2
    step_factor: tuple[float, float] = (1.0, 0.06)  # sources.md 1.2
    step_slope_m_per_hz: tuple[float, float] = (0.30, 0.07)  # sources.md 1.2
    asymmetry: tuple[float, float] = (0.0, 0.02)  # sources.md 1.2

    def __post_init__(self) -> None:
        for name, (mean, sigma) in _by_name(self).items():
            if not 0 <= sigma < math.inf:
                raise PersonError(f"{name} of people has a standard deviation of {sigma}; give 0 or more")
            for value in (mean - CUT * sigma, mean + CUT * sigma):
                _check(f"{name} of people, {CUT:g} standard deviations from the mean,", value, POSSIBLE[name])


def draw_person(rng: np.random.Generator, params: PersonParams | None = None) -> Person:
    """Draws a person.

    The step length at the preferred cadence is 0.7 + 0.371 (H - 1.75) + 0.227 (f - 1.79) H / 1.75 times a personal
    factor (Chen, Pei & Chen 2011, as in sources.md 1.2); how it grows with the cadence is personal, too.
    """
    params = params or PersonParams()

    def draw(law: tuple[float, float]) -> float:
        return law[0] + law[1] * float(np.clip(rng.standard_normal(), -CUT, CUT))

    height_m, cadence_hz = draw(params.height_m), draw(params.cadence_hz)
    step_m = 0.7 + 0.371 * (height_m - 1.75) + 0.227 * (cadence_hz - 1.79) * height_m / 1.75
    return Person(
        height_m=height_m,
        cadence_hz=cadence_hz,
        step_length_m=step_m * draw(params.step_factor),
        step_slope_m_per_hz=draw(params.step_slope_m_per_hz),
        asymmetry=draw(params.asymmetry),
    )


def _by_name(record: Person | PersonParams) -> Mapping[str, Any]:
    return {field.name: getattr(record, field.name) for field in fields(record)}


def _check(what: str, value: float, possible: tuple[float, float]) -> None:
    low, high = possible
    if not low <= value <= high:
        raise PersonError(f"{what} is {value:g}; people have {low:g} to {high:g}")
