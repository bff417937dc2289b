"""Köping et al.'s building: a replica, and the environments in it."""
