"""Where the registered files of a set lie, whatever its source or its owner has called them."""

from __future__ import annotations

import functools
from pathlib import Path

from pdrbench.datasets.catalogue import dataset
from pdrbench.datasets.folders import find
from pdrbench.datasets.integrity import files_in, registered_file


def locate(name: str) -> dict[str, Path]:
    """Where each registered file was found, by its registered path: by its hash, or by its content if compressed anew.

    Raises:
        UnknownNameError: No such dataset is registered.
        DatasetError: It is not available.
    """
    folder = find(name)
    states = ((folder / path, (folder / path).stat()) for path in files_in(folder))
    return dict(_located(name, tuple((path, state.st_size, state.st_mtime_ns) for path, state in states)))


@functools.lru_cache(maxsize=16)
def _located(name: str, files: tuple[tuple[Path, int, int], ...]) -> tuple[tuple[str, Path], ...]:
    """Path registered and found of each file; size and time of its last change differ once it is written again."""
    found = ((registered_file(dataset(name), path)[0], path) for path, _, _ in files)
    return tuple(sorted((file.path, path) for file, path in found if file is not None))
