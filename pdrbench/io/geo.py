"""Latitude and longitude of WGS 84 to metres about a place, and back."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.errors import RecordingError
from pdrbench.geometry import FloatArray

WGS84_A_M: Final = 6_378_137.0
WGS84_E2: Final = 6.694379990141317e-3  # first eccentricity squared: f (2 - f), f = 1/298.257223563
_NUM_CORRECTIONS: Final = 8  # each is a factor of about distance / 6400 km


@dataclass(frozen=True, slots=True)
class GeoFrame:
    """The plane that touches the ellipsoid at a place: x east, y north, in metres.

    Lengths agree with those on the ellipsoid to 1e-8 within a kilometre and to 1e-5 within 30 km.

    Attributes:
        lat_deg: Latitude of the origin, north positive.
        lon_deg: Longitude of the origin, east positive.

    >>> frame = GeoFrame(49.46, 11.11)
    >>> frame.to_local(49.46, 11.11 + 1e-3).round(3).tolist()
    [72.496, 0.0]
    """

    lat_deg: float
    lon_deg: float

    def __post_init__(self) -> None:
        if not (abs(self.lat_deg) < 90.0 and abs(self.lon_deg) <= 360.0):
            raise RecordingError(
                f"latitude {self.lat_deg}, longitude {self.lon_deg} is no place in degrees; "
                f"are the two swapped, or are they metres?"
            )

    def to_local(self, lat_deg: ArrayLike, lon_deg: ArrayLike) -> FloatArray:
        """(..., 2) metres east and north of the origin, of places at height 0.

        Args:
            lat_deg: (...).
            lon_deg: (...), the same shape.
        """
        lat, lon = np.radians(np.asarray(lat_deg, np.float64)), np.radians(np.asarray(lon_deg, np.float64))
        lat0, dlon = math.radians(self.lat_deg), lon - math.radians(self.lon_deg)
        radius_m = WGS84_A_M / np.sqrt(1.0 - WGS84_E2 * np.sin(lat) ** 2)
        radius0_m = WGS84_A_M / math.sqrt(1.0 - WGS84_E2 * math.sin(lat0) ** 2)
        # differences of coordinates fixed to the Earth, the meridian of the origin in the x-z plane
        dx_m = radius_m * np.cos(lat) * np.cos(dlon) - radius0_m * math.cos(lat0)
        east_m = radius_m * np.cos(lat) * np.sin(dlon)
        dz_m = (1.0 - WGS84_E2) * (radius_m * np.sin(lat) - radius0_m * math.sin(lat0))
        return np.stack([east_m, math.cos(lat0) * dz_m - math.sin(lat0) * dx_m], axis=-1)

    def to_geo(self, xy_m: ArrayLike) -> tuple[FloatArray, FloatArray]:
        """Latitude (...) and longitude (...) in degrees of places (..., 2); the inverse of `to_local`."""
        xy_m = np.asarray(xy_m, np.float64)
        lat0 = math.radians(self.lat_deg)
        scale = 1.0 - WGS84_E2 * math.sin(lat0) ** 2
        meridian_m = WGS84_A_M * (1.0 - WGS84_E2) / scale**1.5
        parallel_m = WGS84_A_M * math.cos(lat0) / math.sqrt(scale)
        lat_deg = np.full(xy_m.shape[:-1], self.lat_deg)
        lon_deg = np.full(xy_m.shape[:-1], self.lon_deg)
        for _ in range(_NUM_CORRECTIONS):
            miss_m = xy_m - self.to_local(lat_deg, lon_deg)
            lat_deg = lat_deg + np.degrees(miss_m[..., 1] / meridian_m)
            lon_deg = lon_deg + np.degrees(miss_m[..., 0] / parallel_m)
        return lat_deg, lon_deg


def frame_at(lat_deg: ArrayLike, lon_deg: ArrayLike) -> GeoFrame:
    """A frame near the middle of places (N,), at a whole hundredth of a degree: files of one site often share it."""
    return GeoFrame(*(float(np.round((np.nanmin(deg) + np.nanmax(deg)) / 2.0, 2)) for deg in (lat_deg, lon_deg)))
