"""Compiled kernels: `numba.njit` with a cache that is void as soon as a kernel that they call has changed."""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
from numba import get_num_threads, njit
from numba.core.dispatcher import Dispatcher

F = TypeVar("F", bound=Callable[..., Any])


def compiled(function: F) -> F:
    """Compiles a function on its first call with each combination of types, or loads it from the cache.

    Numba compares the source file of the function itself with that of the cached code. Kernels of other files and
    constants become part of the compiled code, so the sources of all kernels that the module of the function imports
    are compared, too, and the numbers that are global there. Divisions follow IEEE 754.
    """
    return cast(F, _kernel(function, no_cpython_wrapper=False))


def inner(function: F) -> F:
    """As `compiled`, for what only kernels call: the entry from Python is left out, a large part of what is compiled.

    Raises:
        TypeError: Python calls it.
    """
    kernel = _kernel(function, no_cpython_wrapper=True)

    def refuse(*_: object) -> None:
        raise TypeError(f"only kernels can call {function.__name__}")

    if kernel is not function:  # without an entry Python must find no code
        kernel._insert, kernel._compile_for_args = (lambda *_: None), refuse
    return cast(F, kernel)


def _kernel(function: Callable[..., Any], *, no_cpython_wrapper: bool) -> Any:
    options: Any = {"no_cpython_wrapper": no_cpython_wrapper, "no_cfunc_wrapper": True}  # an entry from C
    kernel: Any = njit(cache=True, error_model="numpy", nogil=True, **options)(function)
    if isinstance(kernel, Dispatcher):  # a plain function where compilation is disabled
        file = cast(Any, kernel)._cache._cache_file
        file._source_stamp = file._source_stamp, *_dependencies(kernel)
    return kernel


def in_threads(kernel: Callable[..., object], count: int, *arguments: Any) -> None:
    """Runs a kernel over chunks, in as many threads as Numba has: Numba's parallel loops take seconds to compile.

    Args:
        kernel: Called as `kernel((first, end, thread), *arguments)` with the chunks and the number of a thread.
        count: Of the chunks.
        arguments: Of all threads.
    """
    threads = max(1, min(get_num_threads(), count))
    parts = [((count * k // threads, count * (k + 1) // threads, k), *arguments) for k in range(threads)]
    with ThreadPoolExecutor(threads) as pool:
        others = [pool.submit(kernel, *part) for part in parts[1:]]
        kernel(*parts[0])
        for other in others:
            other.result()  # an error of any thread is one of the call


def _dependencies(kernel: Any) -> list[str]:
    """Digests of the source files, and the numbers, of the kernels that a module imports, directly or in turn."""
    found: dict[str, str] = {}
    waiting = [kernel.py_func]
    while waiting:
        function = waiting.pop()
        if function.__module__ not in found:
            names = function.__globals__
            numbers = sorted((n, repr(v)) for n, v in names.items() if isinstance(v, (int, float, np.generic)))
            found[function.__module__] = f"{_digest(function.__code__.co_filename)} {numbers}"
            waiting += [value.py_func for value in names.values() if isinstance(value, Dispatcher)]
    return [found[module] for module in sorted(found)]


@functools.cache
def _digest(file: str) -> str:
    return hashlib.sha256(Path(file).read_bytes()).hexdigest()
