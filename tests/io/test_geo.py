"""Degrees to metres and back."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pdrbench.errors import RecordingError
from pdrbench.io.geo import GeoFrame

A_M, F = 6378137.0, 1 / 298.257223563
OFFSETS_M = st.floats(-20_000.0, 20_000.0)


def parallel_m(lat_deg: float, dlon_deg: float) -> float:
    """Length of an arc of a parallel of WGS 84: N cos(lat) dlon."""
    lat = math.radians(lat_deg)
    return A_M / math.sqrt(1 - F * (2 - F) * math.sin(lat) ** 2) * math.cos(lat) * math.radians(dlon_deg)


@pytest.mark.parametrize("lat_deg", [0.0, 49.46, -33.9, 78.2])
def test_lengths_are_those_of_the_ellipsoid(lat_deg: float) -> None:
    frame = GeoFrame(lat_deg, 11.11)
    east_m = frame.to_local(lat_deg, 11.11 + 0.01)[0]
    assert east_m == pytest.approx(parallel_m(lat_deg, 0.01), rel=1e-6)
    # a hundredth of a degree of a meridian, by the series for the length of a quadrant
    lat, dlat = math.radians(lat_deg), math.radians(0.01)
    e2 = F * (2 - F)
    north_m = A_M * (1 - e2) * (1 - e2 * math.sin(lat + dlat / 2) ** 2) ** -1.5 * dlat
    assert frame.to_local(lat_deg + 0.01, 11.11)[1] == pytest.approx(north_m, rel=1e-6)


@given(x_m=OFFSETS_M, y_m=OFFSETS_M, lat_deg=st.floats(-80.0, 80.0), lon_deg=st.floats(-180.0, 180.0))
def test_round_trip(x_m: float, y_m: float, lat_deg: float, lon_deg: float) -> None:
    frame = GeoFrame(lat_deg, lon_deg)
    lat, lon = frame.to_geo([[x_m, y_m]])
    assert np.abs(frame.to_local(lat, lon) - [[x_m, y_m]]).max() < 1e-6


@pytest.mark.parametrize("place", [(91.0, 0.0), (445_538.0, 5_444_904.0), (math.nan, 0.0)])
def test_what_is_no_place_in_degrees(place: tuple[float, float]) -> None:
    with pytest.raises(RecordingError, match="no place in degrees"):
        GeoFrame(*place)
