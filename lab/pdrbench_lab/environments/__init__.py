"""Environments, in the laboratory."""
