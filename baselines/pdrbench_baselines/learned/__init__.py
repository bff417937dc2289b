"""Displacements of a phone's bearer, second by second, by a small neural network in compiled code."""
