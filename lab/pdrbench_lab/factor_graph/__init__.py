"""Smoothing on a factor graph: displacements of a network, heading bias, length scale, radio and walls."""
