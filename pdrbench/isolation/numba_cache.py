"""What is compiled is kept in Numba's cache, which only code of pdrbench itself may write.

A file of that cache is unpickled by whoever reads it: a stranger's code that could write one would run in everybody's
process. Its compiled functions are therefore kept in the memory of its own process.
"""

from __future__ import annotations

import contextlib
import functools
import os
from pathlib import Path
from typing import Any, Final

from numba.core import caching, config

from pdrbench.registry import WARM_UPS_GROUP, entries

HOME: Final = Path(__file__).parents[1]
# Of this process: whether it may write the cache, rooms of pdrbench by folder of the cache, and those rooms of whose
# functions it has compiled some that were not kept.
_STATE: Final[dict[str, Any]] = {"writes": False, "rooms": {}, "lost": set()}


class _Cache(caching.IndexDataCacheFile):
    """Numba's cache of one function; where it may not be written, nothing is."""

    def load(self, key: Any) -> Any:
        """What is kept; what cannot be read is not."""
        with contextlib.suppress(OSError):
            return super().load(key)  # type: ignore[no-untyped-call]
        return None

    def save(self, key: Any, data: Any) -> None:
        if _STATE["writes"]:
            with contextlib.suppress(OSError):  # a full disk costs a compilation, not a walk
                super().save(key, data)  # type: ignore[no-untyped-call]
        elif self._cache_path in _STATE["rooms"]:
            _STATE["lost"].add(_STATE["rooms"][self._cache_path])


def _need_not_exist(locator: Any) -> None:
    """In place of trying whether the folder can be written; called for every function that asks for the cache."""
    source = Path(getattr(locator, "_py_file", ""))
    if source.parent.parent == HOME:
        _STATE["rooms"][locator.get_cache_path()] = source.parent.name
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


def lost() -> list[str]:
    """Rooms of pdrbench of whose functions this process has compiled some and could not keep them."""
    return sorted(_STATE["lost"])


@functools.cache
def compile_room(room: str) -> None:
    """Compiles a package of compiled functions in this process, which may write the cache; once."""
    entry = entries(WARM_UPS_GROUP).get(room)
    if entry is not None and entry.package == HOME.name:
        entry.load()()


def lose() -> None:
    """From now on this process keeps what it compiles to itself, also of functions that are defined already."""
    setattr(caching.IndexDataCacheFile, "save", lambda *_: None)  # noqa: B010
    setattr(caching._CacheLocator, "ensure_cache_path", _need_not_exist)  # noqa: B010


def writeable() -> None:
    """This process may write it after all."""
    _STATE["writes"] = True
