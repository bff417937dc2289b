"""What is compiled is kept in Numba's cache, which only code of pdrbench itself may write.

A file of that cache is unpickled by whoever reads it: a stranger's code that could write one would run in everybody's
process. Its compiled functions are therefore kept in the memory of its own process.
"""

from __future__ import annotations

import contextlib
import os
from typing import Any, Final

from numba.core import caching, config

_STATE: Final = {"writes": False}


class _Cache(caching.IndexDataCacheFile):
    """Numba's cache of one function; where it may not be written, nothing is."""

    def save(self, key: Any, data: Any) -> None:
        if _STATE["writes"]:
            with contextlib.suppress(OSError):  # a full disk costs a compilation, not a walk
                super().save(key, data)  # type: ignore[no-untyped-call]


def _need_not_exist(locator: Any) -> None:
    """In place of trying whether the folder can be written."""
    if _STATE["writes"]:
        with contextlib.suppress(OSError):
            os.makedirs(locator.get_cache_path(), exist_ok=True)  # noqa: PTH103


def read_only(folder: str) -> None:
    """From now on this process reads Numba's cache and writes nothing there.

    Args:
        folder: Of the cache; empty where it lies beside the sources.
    """
    # Numba lets places be chosen, not what happens there.
    setattr(config, "CACHE_DIR", folder)  # noqa: B010
    setattr(caching, "IndexDataCacheFile", _Cache)  # noqa: B010
    setattr(caching._CacheLocator, "ensure_cache_path", _need_not_exist)  # noqa: B010


def lose() -> None:
    """From now on this process keeps what it compiles to itself, also of functions that are defined already."""
    setattr(caching.IndexDataCacheFile, "save", lambda *_: None)  # noqa: B010
    setattr(caching._CacheLocator, "ensure_cache_path", _need_not_exist)  # noqa: B010


def writeable() -> None:
    """This process may write it after all."""
    _STATE["writes"] = True
