"""What environments share whose walks are generated: ids of walks, and a digest of what generates them."""

from __future__ import annotations

import functools
import hashlib
import importlib.util
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import files as package_files
from pathlib import Path

from pdrbench.errors import unknown_name


@dataclass(frozen=True, slots=True)
class WalkTable:
    """Walks by id.

    Attributes:
        env: Environment whose name goes into the ids of its test split.
        num_walks: By split.
    """

    env: str
    num_walks: Mapping[str, int]

    def ids(self, split: str) -> tuple[str, ...]:
        """In the order of play. Those of the test split are digests, played in their order, and tell nothing."""
        ids = self._by_number(split)
        return tuple(sorted(ids)) if split == "test" else ids

    def place_of(self, walk: str) -> tuple[str, int]:
        """Split of a walk, and its place in the order of play; raises `UnknownNameError` where there is none."""
        places = {walk: (split, index) for split in self.num_walks for index, walk in enumerate(self.ids(split))}
        if walk not in places:
            raise unknown_name(f"walk of {self.env}", walk, places)
        return places[walk]

    def _by_number(self, split: str) -> tuple[str, ...]:
        names = [f"{split}-{index:02d}" for index in range(self.num_walks[split])]
        if split != "test":
            return tuple(names)
        return tuple(f"test-{hashlib.sha256(f'{self.env}/{name}'.encode()).hexdigest()[:12]}" for name in names)


@functools.cache
def source_digest(env: str, modules: tuple[str, ...]) -> str:
    """Hex sha256 over the source of the modules, and the data files beside them, that make the walks of an environment.

    Args:
        env: Id.
        modules: Dotted names; "package/file.json" for a data file.

    Cheap, and on the safe side: it also changes where only a comment does. What a walk contains is fixed by that source
    and the version of NumPy's generators, which keep their streams.
    """
    digest = hashlib.sha256(env.encode())
    for name in modules:
        if "/" in name:
            package, _, file = name.partition("/")
            digest.update(package_files(package).joinpath(file).read_bytes())
            continue
        spec = importlib.util.find_spec(name)
        assert spec is not None and spec.origin is not None
        digest.update(Path(spec.origin).read_bytes())
    return digest.hexdigest()
