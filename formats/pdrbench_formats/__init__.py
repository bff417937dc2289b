"""What people bring and take: formats of recordings and plans, derived streams, task files, replays, exports."""

from __future__ import annotations

from pathlib import Path
from typing import Final

COMMANDS: Final = {
    "inspect": "pdrbench_formats.commands.inspect:inspect",
    "convert": "pdrbench_formats.commands.convert:convert",
    "try": "pdrbench_formats.commands.try_:try_",
    "score": "pdrbench_formats.commands.score:score",
    "map": "pdrbench_formats.commands.map:app",
    "replay": "pdrbench_formats.commands.replay:replay",
    "live": "pdrbench_formats.commands.live:live",
}

# What the core asks for by name: it reads no format itself, and results draw nothing.
EXCHANGES: Final = {
    "task_file": "pdrbench_formats.taskfile.load:task_of_file",
    "pack": "pdrbench_formats.taskfile.pack:pack",
    "fetch_pack": "pdrbench_formats.taskfile.pack:fetch_pack",
    "derived": "pdrbench_formats.derive:derived_streams",
    "plot_cdf": "pdrbench_formats.pages.results:plot_cdf",
    "plot_walk": "pdrbench_formats.pages.results:plot_walk",
    "methods": "pdrbench_formats.pages.results:methods_text",
}

# Apps whose tables differ by their names only: each TOML file there is one.
_APPS: Final = sorted(path.stem for path in (Path(__file__).parent / "recordings").glob("*.toml"))

READERS: Final = {
    "geojson": "pdrbench_formats.maps.geojson:READER",
    "native": "pdrbench_formats.recordings.native:READER",
    "getsensordata": "pdrbench_formats.recordings.getsensordata:READER",
    "sensor_logger": "pdrbench_formats.recordings.sensor_logger:READER",
    "gnss_logger": "pdrbench_formats.recordings.gnss_logger:READER",
    "phyphox": "pdrbench_formats.recordings.phyphox:READER",
    **{name: f"pdrbench_formats.recordings.apps:{name}" for name in _APPS},
    "xsens": "pdrbench_formats.recordings.xsens:READER",
    "ros": "pdrbench_formats.recordings.ros:READER",
    "ronin": "pdrbench_formats.recordings.ronin:READER",
    "geojson_plan": "pdrbench_formats.maps.geojson_plan:READER",  # before csv: features on lines are no table
    "csv": "pdrbench_formats.recordings.csv_columns:READER",
    "other_program": "pdrbench_formats.recordings.other_program:READER",
    "dxf": "pdrbench_formats.maps.dxf:READER",
    "shapefile": "pdrbench_formats.maps.shapefile:READER",
    "imdf": "pdrbench_formats.maps.imdf:READER",
    "indoorgml": "pdrbench_formats.maps.indoorgml:READER",
    "osm_indoor": "pdrbench_formats.maps.osm_indoor:READER",
    "picture": "pdrbench_formats.maps.raster:READER",
    "ros_map": "pdrbench_formats.maps.raster:ROS",
}
