"""Reproduce, in the laboratory."""
