"""The simulator: synthetic buildings, people who walk through them, and what their sensors measure.

`buildings` draws buildings; `people` plans routes through any building and walks them; `foot` and `phone` move a unit;
`units`, `fields` and `radio` give what it measures; `record` puts all of it together, and `resolution` rounds it to
what devices say. `readers` reads recorded sets. Import the submodules: they need SciPy and shapely.
"""

READERS = {
    "foot_stride_gcp": "pdrbench_sim.readers.foot_stride_gcp:READER",
    "foot_vicon": "pdrbench_sim.readers.foot_vicon:READER",
    "ilc20": "pdrbench_sim.readers.ilc20:READER",
    "ilc20_map": "pdrbench_sim.readers.ilc20_map:READER",
    "wifi_fingerprints": "pdrbench_sim.readers.wifi_fingerprints:READER",
}
