"""Compiled functions are kept in Numba's cache, which only code of pdrbench itself may write.

Files of that cache are unpickled when they are read: untrusted code that could write one would run in other processes.
Functions that it compiles therefore stay in the memory of its own process.
"""

from __future__ import annotations

import contextlib
import functools
import os
import sys
from types import ModuleType
from typing import Any, Final

from numba.core import caching, config
from numba.core.dispatcher import Dispatcher
from numba.core.registry import cpu_target

from pdrbench.registry import OURS, WARM_UPS_GROUP, entries
from pdrbench_leaderboard.confine.toolbox import TOOLBOX

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


def is_called_by(module: ModuleType) -> bool:
    """Whether a module, or one beside it in its folder, has compiled functions or takes something from `TOOLBOX`."""
    return any(
        isinstance(value, Dispatcher)
        or str(getattr(value, "__module__", getattr(value, "__name__", ""))).startswith(TOOLBOX)
        for value in _names_in(module)
    )


def _names_in(module: ModuleType) -> list[Any]:
    """What the names in a module, and in those beside it in its folder, stand for."""
    folder = module.__name__.rpartition(".")[0] + "."
    beside = [other for name, other in sys.modules.items() if "." in folder[:-1] and name.startswith(folder)]
    return [value for other in [module, *beside] for value in vars(other).values()]


def prepare() -> None:
    """Loads what Numba needs for any compiled function, which takes as long as a short walk; starts no thread."""
    cpu_target.target_context.refresh()
    cpu_target.typing_context.refresh()


def load(module: ModuleType) -> None:
    """Loads compiled functions that a module, or one beside it, calls from Python, but none that starts threads."""
    kernels: set[Any] = {value for value in _names_in(module) if isinstance(value, Dispatcher)}
    called = {name for kernel in kernels for name in kernel.py_func.__code__.co_names}  # part of what calls them
    for kernel in kernels:
        cache = kernel._cache
        if kernel.py_func.__name__ in called or kernel.targetoptions.get("parallel") or not cache.cache_path:
            continue
        for key in cache._cache_file._load_index():
            if key == cache._index_key(key[0], kernel.targetctx.codegen()):
                kernel.compile(key[0])


def enable_writing() -> None:
    """Undoes `read_only` as to writing."""
    _STATE["writes"] = True
