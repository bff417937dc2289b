"""Magnetic field and air pressure inside a building.

`magnetic.make_magnetic_field` draws a field that is evaluated at any place, `dipoles` its local sources;
`magnetic.draw_magnetometer` and `barometer.draw_barometer` draw the errors of a sensor in it.
"""
