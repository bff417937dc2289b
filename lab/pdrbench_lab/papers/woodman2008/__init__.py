"""Woodman2008, in the laboratory."""
