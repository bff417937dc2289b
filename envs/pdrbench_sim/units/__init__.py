"""Inertial units: error profiles, what one of a kind measures, and the errors of the strides they yield."""
