"""Finds files by their hashes, for datasets whose file names are not registered."""

from __future__ import annotations

import functools
from pathlib import Path

from pdrbench.datasets.catalogue import dataset
from pdrbench.datasets.folders import find
from pdrbench.datasets.integrity import files_in, sha256_of, sha256_of_content


def locate(name: str) -> dict[str, Path]:
    """Where each registered file is that was found, by its registered path.

    A file that was compressed anew is found by its content.

    Raises:
        UnknownNameError: No such dataset is registered.
        DatasetError: It is not available.
    """
    folder = find(name)
    paths = [folder / path for path in files_in(folder)]
    return dict(_located(name, tuple((path, *_state(path)) for path in paths)))


def _state(path: Path) -> tuple[int, int]:
    """Size and time of the last change: they differ once a file is written again."""
    status = path.stat()
    return status.st_size, status.st_mtime_ns


@functools.lru_cache(maxsize=16)
def _located(name: str, files: tuple[tuple[Path, int, int], ...]) -> tuple[tuple[str, Path], ...]:
    registered = dataset(name).files
    by_sha256 = {file.sha256: file.path for file in registered}
    by_content = {file.content_sha256: file.path for file in registered if file.content_sha256}
    found = []
    for path, _, _ in files:
        at = by_sha256.get(sha256_of(path))
        if at is None and by_content:
            at = by_content.get(sha256_of_content(path))
        if at is not None:
            found.append((at, path))
    return tuple(sorted(found))
