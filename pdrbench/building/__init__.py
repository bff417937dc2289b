"""A building as 2.5-D floor polygons with walls and connections (Woodman & Harle 2008, section 3; claims W6, W7)."""

from __future__ import annotations

from pdrbench.building.building import Building
from pdrbench.building.polygons import KINDS, WALL, FloorPolygon, Zone
from pdrbench.building.region import FloorRegion

__all__ = ["KINDS", "WALL", "Building", "FloorPolygon", "FloorRegion", "Zone"]
