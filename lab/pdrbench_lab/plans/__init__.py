"""Readers of plans that few people have: WRLD 3D, Mappedin Venue Format."""
