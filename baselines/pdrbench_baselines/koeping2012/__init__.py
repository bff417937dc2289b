"""Köping et al. 2012: a particle filter on the graph of a building."""
