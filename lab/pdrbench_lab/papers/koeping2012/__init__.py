"""Koeping2012, in the laboratory."""
