"""Toolbox for particle filters on a building (Woodman & Harle 2008; claims W4 to W16)."""

from __future__ import annotations

from pdrbench.filters.clusters import Clusters, cluster
from pdrbench.filters.discs import floor_around, floor_from
from pdrbench.filters.drift import TurnDrift
from pdrbench.filters.kld import kld_bound, normal_quantile
from pdrbench.filters.literal import LiteralMapFilter
from pdrbench.filters.mapfilter import MapFilter
from pdrbench.filters.params import Cloud, FilterError, HeadingPrior, MapFilterParams
from pdrbench.filters.warm import warm_up

__all__ = [
    "Cloud",
    "Clusters",
    "FilterError",
    "HeadingPrior",
    "LiteralMapFilter",
    "MapFilter",
    "MapFilterParams",
    "TurnDrift",
    "cluster",
    "floor_around",
    "floor_from",
    "kld_bound",
    "normal_quantile",
    "warm_up",
]
