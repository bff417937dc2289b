"""Digests of code: of what a module or a package does, without comments, docstrings and layout."""

from __future__ import annotations

import ast
import functools
import hashlib
import importlib.util
import json
import sys
from collections.abc import Iterable, Iterator, Mapping, Set
from pathlib import Path
from typing import Final, NamedTuple

from pdrbench.datasets.folders import cache_folder
from pdrbench.errors import ResultError
from pdrbench.evaluation.store import write_whole
from pdrbench.registry import CARDS_FILE, PluginError

NOT_CODE: Final = frozenset({CARDS_FILE, "py.typed"})  # files of a package that change no estimate
DOCUMENTED: Final = (ast.Module, ast.ClassDef, ast.FunctionDef, ast.AsyncFunctionDef)
MAX_PARSED_BYTES: Final = 1 << 20  # of a file; parsing it takes up to half a gigabyte
MAX_CACHED: Final = 5000  # files, ten times those of pdrbench


class Import(NamedTuple):
    """An import statement: dots before the module, the module, and the names taken from it; none of `import module`."""

    level: int
    module: str
    names: tuple[str, ...]


class Source(NamedTuple):
    """What is known of the text of a Python file."""

    sha256: str  # of its code, or of its bytes where they are not Python
    imports: tuple[Import, ...]  # every import statement, also those inside functions
    is_table: bool  # whether it holds constants only, as the `__init__` of a package that registers plug-ins


def files_sha256(root: Path, files: Iterable[Path]) -> str:
    """Digest of some files below a folder: of the code of Python files, of the bytes of others."""
    lines = [f"{path.relative_to(root).as_posix()} {_file_sha256(path)}" for path in sorted(files)]
    _save_cache()
    return _join(lines)


def package_sha256(package: str) -> str:
    """Digest of every file of a top-level package or module; raises `PluginError` where it has none."""
    roots, origin = _place_of(package)
    if roots:
        return _join(files_sha256(root, [path for path in root.rglob("*") if _counts(path, root)]) for root in roots)
    if origin is None or not origin.is_file():
        raise PluginError(f"the source of {package!r} cannot be found, so stored results may be of other code")
    return files_sha256(origin.parent, [origin])


def closure_sha256(module: str, others: Set[str] = frozenset()) -> str:
    """Digest of a module and of everything in its package that it imports, directly or not, with the data beside it.

    Args:
        module: Dotted name.
        others: Top-level packages besides its own whose modules count.

    Raises:
        PluginError: Its package cannot be found.
    """
    found = closure_files(module, others)
    if not found:
        return package_sha256(module.partition(".")[0])
    lines = [f"{name} {_source(path).sha256}" for name, path in found.items()]
    for folder in {path.parent for path in found.values()}:
        lines += [f"{path.relative_to(folder)} {_file_sha256(path)}" for path in _data_files(folder)]
    _save_cache()
    return _join(sorted(lines))


def closure_files(module: str, others: Set[str] = frozenset()) -> dict[str, Path]:
    """A module and everything in its package that it imports, by dotted name; empty where it is no file of a package.

    Imports are read from the text, also those inside functions. The `__init__` of a package counts where it does more
    than hold constants, or is imported by name. Arguments and errors as of `closure_sha256`.
    """
    top = module.partition(".")[0]
    places = {name: _place_of(name)[0] for name in {top, *others}}
    found: dict[str, Path] = {}
    todo = [module] if places[top] else []
    while todo:
        name = todo.pop()
        path = _module_file(name, places)
        if name in found or path is None:
            continue
        found[name] = path
        todo += _imported(name, path, places)
        parents = [name.rsplit(".", depth)[0] for depth in range(1, name.count(".") + 1)]
        todo += [parent for parent in parents if (file := _module_file(parent, places)) and not _source(file).is_table]
    return found


def _imported(name: str, path: Path, places: Mapping[str, list[Path]]) -> Iterator[str]:
    """Modules that a module imports, as far as their packages are followed."""
    package = name if path.name == "__init__.py" else name.rpartition(".")[0]
    for level, module, names in _source(path).imports:
        base = package.rsplit(".", level - 1)[0] if level > 1 else package
        full = ".".join(filter(None, (base, module))) if level else module
        inner = [f"{full}.{attribute}" for attribute in names]
        modules = [candidate for candidate in inner if _module_file(candidate, places)]
        yield from modules
        if len(modules) < max(1, len(names)):  # something is taken from the module itself
            yield full


def _module_file(name: str, places: Mapping[str, list[Path]]) -> Path | None:
    top, *inner = name.split(".")
    for root in places.get(top, ()):
        for path in (root.joinpath(*inner, "__init__.py"), root.joinpath(*inner).with_suffix(".py")):
            if (inner or path.name == "__init__.py") and path.is_file():
                return path
    return None


def _place_of(top: str) -> tuple[list[Path], Path | None]:
    """Folders of a top-level package, or the file of a top-level module."""
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError) as error:
        raise PluginError(f"{top!r} cannot be found: {error}") from error
    if spec is None:
        raise PluginError(f"there is no module {top!r}; is its package installed?")
    return [Path(place) for place in spec.submodule_search_locations or ()], Path(spec.origin) if spec.origin else None


def _counts(path: Path, root: Path) -> bool:
    parts = path.relative_to(root).parts
    is_hidden = "__pycache__" in parts or any(part.startswith(".") for part in parts)
    return not is_hidden and path.name not in NOT_CODE and path.is_file()


def _data_files(folder: Path) -> Iterator[Path]:
    """Files of a package besides its code, such as the weights of a model; packages inside are left out."""
    for path in folder.iterdir():
        if path.is_dir() and not (path / "__init__.py").exists() and path.name != "__pycache__" and path.name[0] != ".":
            yield from _data_files(path)
        elif path.suffix != ".py" and _counts(path, folder):
            yield path


def _file_sha256(path: Path) -> str:
    if path.suffix == ".py":
        return _source(path).sha256
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _source(path: Path) -> Source:
    content = path.read_bytes()
    key = hashlib.sha256(content).hexdigest()
    if key not in _cache():
        _cache()[key] = _read_source(content)
        _new_keys().add(key)
    return _cache()[key]


def _read_source(content: bytes) -> Source:
    try:
        return _parsed(content)
    except (SyntaxError, ValueError, RecursionError, MemoryError):
        return Source(hashlib.sha256(content).hexdigest(), (), is_table=False)


def _parsed(content: bytes) -> Source:
    if len(content) > MAX_PARSED_BYTES:
        raise ValueError("too large to be parsed for what it does")
    tree = ast.parse(content)
    imports = []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            imports += [Import(0, alias.name, ()) for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            imports.append(Import(node.level, node.module or "", tuple(alias.name for alias in node.names)))
        elif isinstance(node, DOCUMENTED) and ast.get_docstring(node, clean=False) is not None:
            del node.body[0]
    return Source(hashlib.sha256(ast.unparse(tree).encode()).hexdigest(), tuple(imports), _is_table(tree))


def _is_table(tree: ast.Module) -> bool:
    try:
        for node in tree.body:
            if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
                return False
            ast.literal_eval(node.value)
    except ValueError:
        return False
    return True


# Parsing pdrbench takes a second, hashing its bytes 15 ms: what parsing gave is kept by the hash of the bytes.
@functools.cache
def _cache() -> dict[str, Source]:
    try:
        known = json.loads(_cache_file().read_bytes())
        return {
            key: Source(sha256, tuple(Import(level, name, tuple(names)) for level, name, names in imports), is_table)
            for key, (sha256, imports, is_table) in known.items()
        }
    except (OSError, ValueError, TypeError, AttributeError):
        return {}


@functools.cache
def _new_keys() -> set[str]:
    return set()


def _save_cache() -> None:
    """Keeps what was parsed for the next process; where that is impossible, the next one parses again."""
    if not _new_keys():
        return
    kept = _cache() if len(_cache()) <= MAX_CACHED else {key: _cache()[key] for key in _new_keys()}
    _new_keys().clear()
    try:
        _cache_file().parent.mkdir(parents=True, exist_ok=True)
        write_whole(_cache_file(), json.dumps(kept).encode())
    except (OSError, ResultError):
        return


def _cache_file() -> Path:
    return cache_folder() / f"code-{sys.version_info.major}.{sys.version_info.minor}.json"


def _join(lines: Iterable[str]) -> str:
    return hashlib.sha256("\n".join(lines).encode()).hexdigest()
