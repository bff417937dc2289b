"""Files that users have: all conversion of units, axes, clocks and names happens here.

A reader takes a path and raises `RecordingError` or `MapError` with file, line and remedy; nothing is left out
without being counted in a `ReadReport`.
"""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import Final

READERS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "foot_loops": "pdrbench.io.foot_loops:read",
        "foot_short": "pdrbench.io.foot_short:read",
        "foot_stride_gcp": "pdrbench.io.foot_stride_gcp:read",
        "foot_vicon": "pdrbench.io.foot_vicon:read",
        "geojson": "pdrbench.io.geojson:read",
        "ilc20": "pdrbench.io.ilc20:read",
        "ilc20_map": "pdrbench.io.ilc20_map:read",
        "native": "pdrbench.io.native:read",
        "phone_steps": "pdrbench.io.phone_steps:read",
        "wifi_fingerprints": "pdrbench.io.wifi_fingerprints:read",
    }
)

__all__ = ["READERS"]
