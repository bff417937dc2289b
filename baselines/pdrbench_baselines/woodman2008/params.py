"""Settings of the particle filter, and its particles as others see them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pdrbench.filters import FilterError
from pdrbench.geometry import FloatArray, IntArray, read_only


@dataclass(frozen=True, slots=True)
class WoodmanFilterParams:
    """Defaults from Woodman & Harle 2008 unless a line says otherwise.

    Attributes:
        length_sigma_m: Of the noise on the length of a stride, eq. (7).
        heading_sigma_rad: Of the noise on the change of heading, eq. (8).
        height_sigma_m: Of the change of height, eq. (16); infinite: heights weigh nothing (W17).
        kld_epsilon: Bound on the Kullback-Leibler distance.
        kld_delta: Probability that the bound does not hold.
        bin_m: Edge of a bin in x, y and height.
        bin_rad: Width of a bin in heading; a full turn is a whole number of them.
        min_particles: Of a generation.
        max_particles: Of a generation, whatever the bound asks for.
        clip_length: No stride is perturbed below zero; False walks it backwards, as eq. (7) says (W4).
        live_only: Only particles that hit no wall count in bins; False counts all propagated ones, as the text says
            (W10).
    """

    length_sigma_m: float = 0.15
    heading_sigma_rad: float = math.radians(0.6)
    height_sigma_m: float = 0.1
    kld_epsilon: float = 0.05  # W10: follows from the paper's counts
    kld_delta: float = 0.01  # W10
    bin_m: float = 1.0
    bin_rad: float = math.radians(10)
    min_particles: int = 32  # W10: safety, not in the paper
    max_particles: int = 8_000_000  # ours: memory
    clip_length: bool = False
    live_only: bool = False

    def __post_init__(self) -> None:
        for name in ("length_sigma_m", "heading_sigma_rad"):
            if not (math.isfinite(getattr(self, name)) and getattr(self, name) >= 0):
                raise FilterError(f"{name} is a standard deviation, 0 or more; got {getattr(self, name)!r}")
        for name in ("height_sigma_m", "kld_epsilon", "bin_m", "bin_rad"):
            if not getattr(self, name) > 0:
                raise FilterError(f"{name} must be positive; got {getattr(self, name)!r}")
        if not 0 < self.kld_delta < 1:
            raise FilterError(f"kld_delta is a probability between 0 and 1; got {self.kld_delta!r}")
        if not 1 <= self.min_particles <= self.max_particles:
            raise FilterError(
                f"need 1 <= min_particles <= max_particles; got {self.min_particles} and {self.max_particles}"
            )
        turns = 2 * math.pi / self.bin_rad
        if abs(turns - round(turns)) > 1e-6:
            raise FilterError(f"bin_rad must divide a full turn; got {math.degrees(self.bin_rad):g} degrees")

    @property
    def heading_bins(self) -> int:
        """Bins of a full turn."""
        return round(2 * math.pi / self.bin_rad)


@dataclass(frozen=True, slots=True)
class HeadingPrior:
    """Headings drawn uniformly from `centre_rad` - `half_width_rad` to `centre_rad` + `half_width_rad`."""

    centre_rad: float = 0.0
    half_width_rad: float = math.pi


@dataclass(frozen=True, slots=True)
class ParticleCloud:
    """The particles of a filter.

    Attributes:
        xy_m: (N, 2).
        heading_rad: (N,) in [-pi, pi).
        polygon: (N,) int, floor polygon; the last one before the wall where the particle hit one.
        weight: (N,) not normalised, 0 where it hit a wall.
    """

    xy_m: FloatArray
    heading_rad: FloatArray
    polygon: IntArray
    weight: FloatArray

    def __post_init__(self) -> None:
        for name in ("xy_m", "heading_rad", "polygon", "weight"):
            dtype = np.int64 if name == "polygon" else np.float64
            object.__setattr__(self, name, read_only(getattr(self, name), dtype))

    def __len__(self) -> int:
        return len(self.weight)
