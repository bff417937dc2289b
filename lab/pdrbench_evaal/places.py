"""Positions as a server of the EvAAL API writes them: metres of a building or degrees, in an order of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from pdrbench.errors import EstimateError, PdrbenchError
from pdrbench.geometry import FloatArray
from pdrbench.io.geo import GeoFrame

METRES: Final = ("x", "y")
DEGREES: Final = ("lon", "lat")
LEVEL: Final = "level"
MAX_PLACE_CHARACTERS: Final = 200


@dataclass(frozen=True, slots=True)
class PlaceFormat:
    """How a position is written.

    Attributes:
        names: "x" and "y" in metres, or "lon" and "lat" in degrees, in any order, and "level" or not.
        geo: Where the building frame has its origin, x east and y north; needed for degrees.

    >>> place = PlaceFormat(("x", "y", "level"))
    >>> place.write(np.array([1.5, -2.0]), 3)
    '1.5,-2.0,3'
    >>> place.read("1.5;-2.0;3")
    (array([ 1.5, -2. ]), 3)
    """

    names: tuple[str, ...] = (*METRES, LEVEL)
    geo: GeoFrame | None = None

    def __post_init__(self) -> None:
        plane = sorted(name for name in self.names if name != LEVEL)
        if len(set(self.names)) != len(self.names) or plane not in (sorted(METRES), sorted(DEGREES)):
            raise PdrbenchError(
                f"a position is written as x,y,level or lon,lat,level, in any order and with or without the level; "
                f"got {','.join(self.names)}"
            )
        if self.is_geographic and self.geo is None:
            raise PdrbenchError("positions in degrees need the place of the building's origin: name its LAT,LON")

    @property
    def is_geographic(self) -> bool:
        """True where positions are in degrees."""
        return "lon" in self.names

    def write(self, xy_m: FloatArray, level: int) -> str:
        """The text of a position; its numbers read back to the last bit."""
        found: dict[str, float] = dict(zip(METRES, np.asarray(xy_m, np.float64).tolist(), strict=True))
        if self.geo is not None:
            lat_deg, lon_deg = self.geo.to_geo(xy_m)
            found |= {"lon": float(lon_deg), "lat": float(lat_deg)}
        return ",".join(str(int(level)) if name == LEVEL else repr(found[name]) for name in self.names)

    def read(self, text: str) -> tuple[FloatArray, int]:
        """Place (2,) in metres and level of a text whose numbers are separated by commas or semicolons.

        Raises:
            EstimateError: It is no position of this format.
        """
        parts = text.replace(";", ",").split(",") if len(text) <= MAX_PLACE_CHARACTERS else []
        expected = f"a position is {','.join(self.names)}"
        if len(parts) != len(self.names):
            raise EstimateError(f"{expected}; got {text[:MAX_PLACE_CHARACTERS]!r}")
        try:
            found = dict(zip(self.names, map(float, parts), strict=True))
        except ValueError:
            raise EstimateError(f"{expected}, numbers all; got {text!r}") from None
        level = found.get(LEVEL, 0.0)
        if not all(map(math.isfinite, found.values())) or not level.is_integer():
            raise EstimateError(f"{expected}, finite, on a level that is a whole number; got {text!r}")
        if not self.is_geographic:
            return np.array([found["x"], found["y"]]), int(level)
        assert self.geo is not None
        if abs(found["lat"]) > 90.0 or abs(found["lon"]) > 360.0:
            raise EstimateError(f"{expected}, in degrees; got {text!r}")
        return self.geo.to_local(found["lat"], found["lon"]), int(level)


def frame_at_place(names: tuple[str, ...], text: str) -> GeoFrame:
    """A frame whose origin is a position in degrees, written as `names` say; raises `EstimateError`.

    >>> frame_at_place(("lon", "lat", "level"), "11.11,49.46,0")
    GeoFrame(lat_deg=49.46, lon_deg=11.11)
    """
    parts = text.replace(";", ",").split(",")
    try:
        found = dict(zip(names, map(float, parts), strict=True))
        return GeoFrame(found["lat"], found["lon"])
    except (ValueError, KeyError):
        raise EstimateError(f"a position is {','.join(names)}; got {text[:MAX_PLACE_CHARACTERS]!r}") from None


LOCAL_PLACES: Final = PlaceFormat()
