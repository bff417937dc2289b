"""Procedural buildings: offices, malls, ring floors, and the parts they are assembled from."""
