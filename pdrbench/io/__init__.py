"""Files that users have: all conversion of units, axes, clocks and names happens here and in readers of other packages.

A reader takes a path and raises `RecordingError` or `MapError` with file, place in it and remedy; nothing is left out
without being counted in a `ReadReport`. `text`, `container` and `log` hold what readers share.
"""

from __future__ import annotations

from typing import Final

from pdrbench.io.reader import Head, Reader
from pdrbench.registry import Table

BUILTIN: Final[dict[str, str]] = {}
READERS: Final[Table[Reader]] = Table("pdrbench.readers", "format", BUILTIN)

__all__ = ["BUILTIN", "READERS", "Head", "Reader"]
