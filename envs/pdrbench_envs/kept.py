"""Simulated walks of `train` and `val`, whose truth is public, are made once and then read from the cache folder.

They lie under a digest of everything that makes them: another source or another library makes them anew.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import os
import platform
import shutil
import time
import zlib
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final

import msgspec

from pdrbench.datasets import cache_folder
from pdrbench.errors import PdrbenchError
from pdrbench.evaluation.origin import package_sha256
from pdrbench.evaluation.store import keep_whole
from pdrbench.process.serialise import decoder, encoder
from pdrbench.recording import RadioMap, Recording
from pdrbench.registry import OURS, environments, make_task
from pdrbench.task import KNOWN_SPLITS, Task

MAKERS: Final = (OURS, "pdrbench_envs", "pdrbench_sim", "pdrbench_formats")
LIBRARIES: Final = ("numba", "numpy", "scipy", "shapely")
UNUSED_S: Final = 7 * 86_400.0


def kept_task(name: str) -> Task:
    """As `registry.make_task`; simulated walks of `KNOWN_SPLITS`, and their surveys, are kept."""
    task = make_task(name)
    entry = environments().get(name.removeprefix("pdrbench/"))
    if task.source != "generated" or entry is None or entry.package != OURS:
        return task
    known = {walk for split in KNOWN_SPLITS for walk in task.walks.get(split, ())}

    def kept(walk: str, what: str, kind: Any, make: Callable[[], Any]) -> Any:
        if walk not in known:
            return make()
        file = kept_folder("walks") / task.id / f"{walk}.{what}"
        with contextlib.suppress(OSError, zlib.error, msgspec.MsgspecError, PdrbenchError):
            return decoder(kind).decode(zlib.decompress(file.read_bytes()))
        made = make()
        keep_whole(file, zlib.compress(encoder().encode(made), 1))
        return made

    return dataclasses.replace(
        task,
        load=lambda walk: kept(walk, "walk", Recording, lambda: task.load(walk)),
        radio_map=lambda of: kept(of.id, "survey", RadioMap | None, lambda: task.radio_map(of)),
    )


@functools.cache
def kept_folder(kind: str) -> Path:
    """For what the sources and libraries of today make; what others made is removed after a week without use."""
    facts = [*map(package_sha256, MAKERS), *map(version, LIBRARIES), platform.python_version()]
    folder = cache_folder() / kind / hashlib.sha256("\n".join(facts).encode()).hexdigest()[:16]
    with contextlib.suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
        os.utime(folder)
        for other in folder.parent.iterdir():
            if time.time() - other.stat().st_mtime > UNUSED_S:
                shutil.rmtree(other, ignore_errors=True)
    return folder
