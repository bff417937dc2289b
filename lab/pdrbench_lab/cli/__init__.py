"""Cli, in the laboratory."""
