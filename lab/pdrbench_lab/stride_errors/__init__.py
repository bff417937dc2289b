"""Stride errors, in the laboratory."""
