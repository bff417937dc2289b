"""Compiled functions are kept in Numba's cache, which no confined process may write.

Files of that cache are unpickled when they are read: untrusted code that could write one would run in other processes.
Functions that it compiles therefore stay in the memory of its own process.
"""

from __future__ import annotations

import contextlib
import functools
import os
from typing import Any, Final

from numba.core import caching, config
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target

from pdrbench.registry import OURS, WARM_UPS_GROUP, entries

_STATE: Final[dict[str, bool]] = {"writes": False}  # whether this process may write the cache


class _Cache(caching.IndexDataCacheFile):
    """Numba's cache of one function, which is written only where this process may."""

    def load(self, key: Any) -> Any:
        """The cached function; None where it cannot be read."""
        with contextlib.suppress(OSError):
            return super().load(key)  # type: ignore[no-untyped-call]
        return None

    def save(self, key: Any, data: Any) -> None:
        if _STATE["writes"]:
            with contextlib.suppress(OSError):  # a full disk costs a compilation, not a walk
                super().save(key, data)  # type: ignore[no-untyped-call]


def _accept_folder(locator: Any) -> None:
    """Replaces Numba's test whether the folder can be written; called for every function that is to be cached."""
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
    setattr(caching._CacheLocator, "ensure_cache_path", _accept_folder)  # noqa: B010


def keep_all(folder: str) -> None:
    """From now on functions that are declared are looked for in a folder, whether they ask for a cache or not.

    It holds what the same localizer compiled in a rehearsal, and nothing of another one.
    """
    setattr(config, "CACHE_DIR", folder)  # noqa: B010
    declare = Dispatcher.__init__

    def declare_cached(self: Any, *given: Any, **options: Any) -> None:
        declare(self, *given, **options)
        with contextlib.suppress(RuntimeError):  # of a function without a source there is none
            self.enable_caching()

    setattr(Dispatcher, "__init__", declare_cached)  # noqa: B010


@functools.cache
def compile_package(name: str) -> None:
    """Compiles a package of our distribution in this process, which may write the cache, once; others are left."""
    entry = entries(WARM_UPS_GROUP).get(name)
    if entry is not None and entry.package == OURS:
        entry.load()()


def prepare() -> None:
    """Loads what Numba needs for any compiled function, which takes as long as a short walk; starts no thread."""
    cpu_target.target_context.refresh()
    cpu_target.typing_context.refresh()


def enable_writing() -> None:
    """Undoes `read_only` as to writing."""
    _STATE["writes"] = True
