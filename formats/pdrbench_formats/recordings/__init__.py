"""Recordings that people bring: one module for each app, device or set, named in `pdrbench_formats.READERS`."""
