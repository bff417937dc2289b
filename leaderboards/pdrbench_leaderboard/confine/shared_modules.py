"""Which installed modules a localizer with packages of its own still imports: pdrbench, and what that needs."""

from __future__ import annotations

import functools
import importlib.abc
import importlib.machinery
import importlib.metadata
import re
import sys
from collections.abc import Collection, Iterator, Sequence
from types import ModuleType
from typing import Final

OURS: Final = "pdrbench"
REQUIREMENT: Final = re.compile(r"[A-Za-z0-9._-]+")


@functools.cache
def shared_distributions() -> dict[str, str]:
    """Version by normalised name of pdrbench and of every distribution that it needs, directly or not."""
    found: dict[str, str] = {}
    waiting = [OURS]
    while waiting:
        name = normalised(waiting.pop())
        if name in found:
            continue
        try:
            distribution = importlib.metadata.distribution(name)
        except importlib.metadata.PackageNotFoundError:
            continue  # of another system
        found[name] = distribution.version
        for line in distribution.requires or ():
            if "extra ==" not in line and (match := REQUIREMENT.match(line)):
                waiting.append(match.group())
    return found


@functools.cache
def shared_modules() -> frozenset[str]:
    """Top-level modules of these distributions."""
    shared = shared_distributions()
    found = {module for name in shared for module in top_level_modules(name)}
    own = importlib.metadata.distribution(OURS).entry_points  # of an editable installation no file says which
    return frozenset(found | {OURS} | {point.value.partition(":")[0].partition(".")[0] for point in own})


def top_level_modules(distribution: str) -> Iterator[str]:
    """Names that a distribution adds to what can be imported."""
    for file in importlib.metadata.distribution(distribution).files or ():
        first, *below = file.parts
        name = first if below else first.partition(".")[0]
        if name.isidentifier() and (below or file.suffix in (".py", ".so", ".pyd")):
            yield name


def normalised(name: str) -> str:
    """The name of a distribution as all spellings of it agree.

    >>> normalised("Typing_Extensions")
    'typing-extensions'
    """
    return re.sub(r"[-_.]+", "-", name).lower()


class _Own(importlib.abc.MetaPathFinder):
    """Finds some of the installed modules, and all that lie in folders which are put on the path later."""

    def __init__(self, modules: Collection[str]) -> None:
        self._modules = frozenset(modules) | sys.stdlib_module_names
        self._installed = frozenset(sys.path)
        self._finders = tuple(sys.meta_path)

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> importlib.machinery.ModuleSpec | None:
        """The module, where it is one of those; None where it is hidden or there is none."""
        if path is None and fullname not in self._modules:
            places = [place for place in sys.path if place not in self._installed]
            return importlib.machinery.PathFinder.find_spec(fullname, places, target)
        specs = (finder.find_spec(fullname, path, target) for finder in self._finders)
        return next((spec for spec in specs if spec is not None), None)


def import_only(modules: Collection[str]) -> None:
    """From now on this process imports of what is installed the standard library and some modules; for good."""
    sys.meta_path[:] = [_Own(modules)]
