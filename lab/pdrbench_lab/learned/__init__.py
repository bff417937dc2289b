"""Learned, in the laboratory."""
