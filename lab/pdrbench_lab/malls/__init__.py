"""Malls, in the laboratory."""
