"""Inertial units: error profiles, Allan deviation, and the errors of the strides they yield."""
