"""Synthetic buildings, people and sensors: office, lab, route, walker, strides.

`office.make_office` and `lab.make_lab` draw buildings; `route.navigation_mesh` plans ways through any building;
`walker.walk_through` lets a `person` walk them; `strides` says where the feet rest. `device` makes what an inertial
unit delivers of ideal signals (`allan` looks at its noise), `magnetic` and `barometer` what there is to sense beside.
Import the submodules: they need SciPy and shapely.
"""
