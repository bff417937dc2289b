"""Foot-mounted inertial navigation with zero-velocity updates."""
