"""Displacements of a network, a radio map that extrapolates and the plan in one filter, a cloud for every level."""
