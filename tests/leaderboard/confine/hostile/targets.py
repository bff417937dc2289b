"""Where things are in the world of a test, which writes them here."""

TARGETS: dict[str, str] = {}
