"""Toolbox for particle filters on a building: the map walk, KLD sampling, level maps (claims W4 to W16)."""

from __future__ import annotations

from pdrbench.filters.kld import kld_bound, normal_quantile
from pdrbench.filters.level_map import LevelMap
from pdrbench.filters.params import Cloud, FilterError, HeadingPrior, MapFilterParams

__all__ = [
    "Cloud",
    "FilterError",
    "HeadingPrior",
    "LevelMap",
    "MapFilterParams",
    "kld_bound",
    "normal_quantile",
]
