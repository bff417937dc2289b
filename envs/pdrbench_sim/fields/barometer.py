"""What a barometer in a building reads (sources.md 1.8).

Air pressure falls with height by so little that the weather hides on which level one is; a change of level shows.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray
from pdrbench_sim.noise import autoregressive

HPA_PER_M: Final = 0.12  # fall of the pressure near the ground
SEA_LEVEL_HPA: Final = 1013.25  # standard atmosphere


@dataclass(frozen=True, slots=True)
class BarometerErrors:
    """One device on one day; three components as Sabatini & Genovese 2013 [V] have them, and steps."""

    offset_hpa: float = 0.0  # weather of the day, altitude of the building and offset of the device together
    # Standard deviation of the random walk of the weather after an hour.
    weather_hpa_per_sqrt_h: float = 0.3  # 0.1 to 1 hPa/h [R]
    # Standard deviation of the Gauss-Markov component (draughts, ventilation).
    local_hpa: float = 0.02  # assumption [R]: as large as the noise
    local_s: float = 30.0  # its correlation falls to 1/e; assumption [R]
    noise_hpa: float = 0.02  # standard deviation of white noise on each sample; 0.01 to 0.03 hPa [R]
    steps_per_h: float = 6.0  # how often a door or a fan changes the pressure, or changes it back; assumption [R]
    step_hpa: tuple[float, float] = (0.05, 0.3)  # least and largest size of such a step, up or down; [R]

    def __post_init__(self) -> None:
        sizes = (self.weather_hpa_per_sqrt_h, self.local_hpa, self.noise_hpa, self.steps_per_h, *self.step_hpa)
        if not (math.isfinite(self.offset_hpa) and all(0 <= size < math.inf for size in sizes) and self.local_s > 0):
            raise RecordingError(f"errors of a barometer are finite and not negative, its local_s positive; got {self}")


def draw_barometer(rng: np.random.Generator) -> BarometerErrors:
    """Another device on another day.

    The offset is N(0, 8) hPa, 67 m of height (assumption [R]); weather is log-uniform in 0.1 to 1 hPa after an hour and
    noise uniform in 0.01 to 0.03 hPa [R].
    """
    return BarometerErrors(
        offset_hpa=float(rng.normal(0.0, 8.0)),
        weather_hpa_per_sqrt_h=10 ** float(rng.uniform(-1.0, 0.0)),
        noise_hpa=float(rng.uniform(0.01, 0.03)),
    )


def measure(
    t_s: ArrayLike, z_m: ArrayLike, rng: np.random.Generator, errors: BarometerErrors | None = None
) -> FloatArray:
    """(n,) hPa: 1013.25 - 0.12 z + offset + weather + local + steps + noise.

    Each component has a generator of its own: one that is switched off does not change the others, and more samples do
    not change those before them.

    Args:
        t_s: (n,) increasing; parts sold in phones deliver 5 to 10 a second.
        z_m: (n,) height of the device above level 0, or one for all.
        rng: Draws everything; the components draw from its children.
        errors: None for the defaults.

    Raises:
        RecordingError: Times do not increase, or something is not finite.
    """
    errors = errors or BarometerErrors()
    times_s, height_m = np.asarray(t_s, dtype=np.float64), np.asarray(z_m, dtype=np.float64)
    if times_s.ndim != 1 or not len(times_s) or height_m.shape not in ((), times_s.shape):
        raise RecordingError(
            f"a barometer needs (n,) times and as many heights, or one; got {times_s.shape}, {height_m.shape}"
        )
    if not (np.isfinite(times_s).all() and np.isfinite(height_m).all()):
        raise RecordingError("a barometer needs finite times and heights; leave out what is not known")
    step_s = np.diff(times_s)
    if (step_s <= 0).any():
        row = int(np.argmax(step_s <= 0)) + 1
        raise RecordingError(
            f"times of a barometer increase; row {row} has {times_s[row]:g} s after {times_s[row - 1]:g} s"
        )
    weather_rng, local_rng, step_rng, noise_rng = rng.spawn(4)
    return (
        SEA_LEVEL_HPA
        + errors.offset_hpa
        - HPA_PER_M * height_m
        + _weather_hpa(weather_rng, step_s, errors.weather_hpa_per_sqrt_h)
        + errors.local_hpa * autoregressive(local_rng.standard_normal(len(times_s)), np.exp(-step_s / errors.local_s))
        + _steps_hpa(step_rng, times_s, errors)
        + errors.noise_hpa * noise_rng.standard_normal(len(times_s))
    )


def _weather_hpa(rng: np.random.Generator, step_s: FloatArray, hpa_per_sqrt_h: float) -> FloatArray:
    """(n,) random walk from 0, given the n - 1 times between samples."""
    moves = hpa_per_sqrt_h * np.sqrt(step_s / 3600) * rng.standard_normal(len(step_s))
    return np.concatenate([[0.0], np.cumsum(moves)])


def _steps_hpa(rng: np.random.Generator, t_s: FloatArray, errors: BarometerErrors) -> FloatArray:
    """(n,) 0 at first; a step at random times up or down, and back at the next such time."""
    offset_hpa = np.zeros(len(t_s))
    if errors.steps_per_h == 0:
        return offset_hpa
    from_s = t_s[0]
    while from_s <= t_s[-1]:
        begin_s = from_s + 3600 / errors.steps_per_h * rng.standard_exponential()
        from_s = begin_s + 3600 / errors.steps_per_h * rng.standard_exponential()
        size_hpa = rng.uniform(*errors.step_hpa) * (1 if rng.random() < 0.5 else -1)
        offset_hpa[(t_s >= begin_s) & (t_s < from_s)] = size_hpa
    return offset_hpa
