"""Files that users have: all conversion of units, axes, clocks and names happens here and in readers of other packages.

A reader takes a path and raises `RecordingError` or `MapError` with file, place in it and remedy; nothing is left out
without being counted in a `ReadReport`. `text`, `columns` and `imu` hold what readers share.
"""

from __future__ import annotations

from typing import Final

from pdrbench.io.reader import Head, Reader
from pdrbench.registry import Table

BUILTIN: Final = {
    "geojson": "pdrbench.io.geojson:READER",
    "native": "pdrbench.io.native:READER",
    "getsensordata": "pdrbench.io.recordings.getsensordata:READER",
    "sensor_logger": "pdrbench.io.recordings.sensor_logger:READER",
    "phyphox": "pdrbench.io.recordings.phyphox:READER",
    "androsensor": "pdrbench.io.recordings.androsensor:READER",
    "xsens": "pdrbench.io.recordings.xsens:READER",
    "ridi": "pdrbench.io.recordings.ridi:READER",
    "oxiod": "pdrbench.io.recordings.oxiod:READER",
    "euroc": "pdrbench.io.recordings.euroc:READER",
    "ros": "pdrbench.io.recordings.ros:READER",
    "ronin": "pdrbench.io.recordings.ronin:READER",
    "matlab_mobile": "pdrbench.io.recordings.matlab_mobile:READER",
    "xio": "pdrbench.io.recordings.xio:READER",
    "csv": "pdrbench.io.recordings.csv_columns:READER",
    "dxf": "pdrbench.io.maps.dxf:READER",
    "geojson_plan": "pdrbench.io.maps.geojson_plan:READER",
    "imdf": "pdrbench.io.maps.imdf:READER",
    "indoorgml": "pdrbench.io.maps.indoorgml:READER",
    "mvf": "pdrbench.io.maps.mvf:READER",
    "osm_indoor": "pdrbench.io.maps.osm_indoor:READER",
    "picture": "pdrbench.io.maps.raster:READER",
    "ros_map": "pdrbench.io.maps.raster:ROS",
    "wrld3d": "pdrbench.io.maps.wrld3d:READER",
}
READERS: Final[Table[Reader]] = Table("pdrbench.readers", "format", BUILTIN)

__all__ = ["BUILTIN", "READERS", "Head", "Reader"]
