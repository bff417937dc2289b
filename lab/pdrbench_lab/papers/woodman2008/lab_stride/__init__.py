"""Woodman & Harle's building: a replica of three levels, and the environments that replay strides in it."""
