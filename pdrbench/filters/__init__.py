"""Toolbox for particle filters on a building.

Everything in `__all__` may be relied on: functions on arrays, and `MapFilter`, the base of filters that walk particles
through a map. Compiled kernels for filters of their own are in `map_walk`.
"""

from __future__ import annotations

from pdrbench.building.level_map import level_map
from pdrbench.filters.kld import kld_bound, normal_quantile
from pdrbench.filters.map_filter import FilterError, MapFilter
from pdrbench.filters.map_walk import walk
from pdrbench.filters.resampling import multinomial, systematic

__all__ = ["FilterError", "MapFilter", "kld_bound", "level_map", "multinomial", "normal_quantile", "systematic", "walk"]
