"""Magnetic field and air pressure inside a building."""
