"""Hostile localizers by class of attack; `registry` lists them. A test copies this package and writes `targets.py`."""
