"""No import goes upwards and none closes a circle: read from the source, so that imports inside functions count."""

from __future__ import annotations

import ast
import functools
import graphlib
from collections import defaultdict
from collections.abc import Iterator, Mapping
from importlib import import_module
from pathlib import Path

import pytest

# Each may import those before it.
PACKAGES = (
    "pdrbench",
    "pdrbench_formats",
    "pdrbench_leaderboard",
    "pdrbench_sim",
    "pdrbench_envs",
    "pdrbench_baselines",
)


def sources() -> dict[str, Path]:
    """File by name of module."""
    found = {}
    for package in PACKAGES:
        folder = Path(str(import_module(package).__file__)).parent
        for file in folder.rglob("*.py"):
            parts = (package, *file.relative_to(folder).with_suffix("").parts)
            found[".".join(parts).removesuffix(".__init__")] = file
    return found


SOURCES = sources()


def statements(node: ast.AST, *, inside_functions: bool) -> Iterator[ast.AST]:
    """Every statement but those for type checkers only."""
    for child in ast.iter_child_nodes(node):
        if isinstance(child, ast.expr):
            continue
        if isinstance(child, ast.If) and ast.unparse(child.test) == "TYPE_CHECKING":
            continue
        if inside_functions or not isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef)):
            yield child
            yield from statements(child, inside_functions=inside_functions)


@functools.cache
def parsed(file: Path) -> ast.Module:
    return ast.parse(file.read_text(encoding="utf-8"))


def imported(file: Path, *, inside_functions: bool) -> set[str]:
    """Modules of the four packages that a file imports."""
    names = set()
    for node in statements(parsed(file), inside_functions=inside_functions):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module is not None:
            full = {f"{node.module}.{alias.name}" for alias in node.names}
            names |= {name if name in SOURCES else node.module for name in full}
    return names & SOURCES.keys()


def room(module: str) -> str:
    """The folder or file directly below a package."""
    return ".".join(module.split(".")[:2])


def require_no_circle(graph: Mapping[str, set[str]]) -> None:
    try:
        graphlib.TopologicalSorter(graph).prepare()
    except graphlib.CycleError as error:
        pytest.fail(" imports ".join(reversed(error.args[1])))


def test_no_package_imports_one_above_it() -> None:
    upwards = [
        f"{module} imports {other}"
        for module, file in SOURCES.items()
        for other in imported(file, inside_functions=True)
        if PACKAGES.index(other.split(".")[0]) > PACKAGES.index(module.split(".")[0])
    ]
    assert upwards == []


def test_rooms_import_each_other_in_no_circle() -> None:
    graph = defaultdict(set)
    for module, file in SOURCES.items():
        others = {room(other) for other in imported(file, inside_functions=True)} - {*PACKAGES, room(module)}
        if module not in PACKAGES:
            graph[room(module)] |= others
    assert len(graph) > 40
    require_no_circle(graph)


def test_modules_of_a_room_import_each_other_in_no_circle() -> None:
    graph = {
        module: imported(file, inside_functions=False) - {*PACKAGES, module}
        for module, file in SOURCES.items()
        if module not in PACKAGES
    }
    require_no_circle(graph)
