"""What the process of a localizer may read: Python, installed packages and its own code; no environment, no data."""

from __future__ import annotations

import ast
import contextlib
import functools
import hashlib
import importlib.util
import itertools
import os
import sys
import sysconfig
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import pdrbench
from pdrbench.datasets.folders import cache_folder, data_folders
from pdrbench.localizer_folder import list_files, parse_target, read_settings
from pdrbench.registry import OURS, WARM_UPS_GROUP, PluginError, entries, environment_packages, localizers
from pdrbench.settings import split_name
from pdrbench_leaderboard.confine.toolbox import TOOLBOX

PRIVATE_VARIABLE: Final = "PDRBENCH_PRIVATE"
HOME: Final = Path(pdrbench.__file__).parent
# Shared libraries, time zones, and what numeric libraries ask the kernel: of its files those alone that never change,
# since a counter of the whole machine carries notes from one walk to the next.
SYSTEM: Final = (
    *("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/usr/local/lib", "/usr/share/zoneinfo", "/etc/ld.so.cache"),
    *("/etc/localtime", "/etc/nsswitch.conf", "/sys/kernel/mm/transparent_hugepage/enabled"),
    *(f"/sys/devices/system/cpu/{name}" for name in ("online", "possible", "present", "kernel_max")),
    *("/dev/urandom", "/dev/random", "/dev/zero"),
)
SOURCES: Final = (".py", ".so", ".pyd", ".pyc")
BELONGING: Final = (".libs", ".dist-info")  # folders that wheels put beside packages: libraries, and what is installed
PIP_FOLDERS: Final = ("site-packages", "dist-packages")  # also a user's own, and one on PYTHONPATH
MAX_SOURCES, MAX_SOURCE_BYTES = 1_000, 1 << 20  # of a localizer, that are searched for what they import
MAX_TOTAL_BYTES: Final = 8 << 20  # of these together: a megabyte takes half a second
MAX_FOLDER_ENTRIES: Final = 5_000  # a working folder may hold anything


@dataclass(frozen=True, slots=True)
class ReadPermissions:
    """What one kind of child may open."""

    readable: tuple[str, ...]  # files, and folders with everything below them
    listed: tuple[str, ...]  # folders whose names may be listed
    # files and folders of its code; of a localizer that comes with pdrbench, the one that it is in
    own: tuple[str, ...]
    # Folder of the packages that it imports instead of those that are installed; "": the latter
    packages: str = ""

    @property
    def imports(self) -> tuple[str, ...]:
        """Modules that its sources name; they are read, not run."""
        return _imports(self.own, tuple(_changed_ns(place) for place in self.own))

    @property
    def calls_compiled(self) -> bool:
        """Whether it is likely to call compiled functions, of pdrbench or its own."""
        return any(name.startswith(("numba", *TOOLBOX)) for name in self.imports)

    @property
    def toolbox(self) -> list[str]:
        """Packages of functions that it is likely to call, building's in any case, and that are not compiled yet."""
        named = [f"{name}." for name in ("pdrbench.building", *self.imports)]
        called = [name for name in entries(WARM_UPS_GROUP) if any(module.startswith(f"{name}.") for module in named)]
        return [name for name in called if not _is_compiled(name)]


def permissions_of(localizer: str, target: str) -> ReadPermissions:
    """What the process of a localizer may open.

    Args:
        localizer: As the user named it; settings in it do not count.
        target: Where its class is, as `localizer_target` returns it.

    Raises:
        PluginError: It is a folder that cannot be run, or its package also registers environments, which no localizer
            may read.
    """
    return _permissions(split_name(localizer)[0], target, _files_of_folder(target), tuple(sys.path), numba_cache())


def _files_of_folder(target: str) -> tuple[tuple[str, int], ...]:
    """Files that belong to a folder and when each has changed: a folder is edited while this process lives."""
    if (found := parse_target(target)) is None:
        return ()
    paths = [found.folder / name for name in list_files(found.folder, read_settings(found.folder))]
    return tuple((str(path), path.stat().st_mtime_ns) for path in paths)


@functools.lru_cache(maxsize=64)
def _permissions(
    localizer: str, target: str, files: tuple[tuple[str, int], ...], path: tuple[str, ...], cache: str
) -> ReadPermissions:
    place = target.partition(":")[0]
    packages = ""
    if (folder := parse_target(target)) is not None:
        own = [name for name, _ in files]
        listed_too = [str(folder.folder)]
        if folder.packages is not None:
            packages = os.path.realpath(folder.packages)
            listed_too.append(packages)
    else:
        own, listed_too = [place] if place.endswith(".py") else _package(place.partition(".")[0], localizer), []
    entry = localizers().get(localizer)
    is_ours = entry is not None and entry.package == OURS
    readable, listed = _common(path)
    compiled = compiled_folders()
    its_own = [*own, *([packages] if packages else [])]
    return ReadPermissions(
        tuple(dict.fromkeys([*readable, *compiled, *map(os.path.realpath, its_own)])),
        tuple(dict.fromkeys([*listed, *map(os.path.realpath, listed_too)])),
        tuple(_beside(place, own) if is_ours else own),
        packages,
    )


def _changed_ns(place: str) -> int:
    """When a file was changed; 0 where it is gone."""
    with contextlib.suppress(OSError):
        return os.stat(place).st_mtime_ns  # noqa: PTH116
    return 0


@functools.lru_cache(maxsize=64)
def _imports(places: tuple[str, ...], changed_ns: tuple[int, ...]) -> tuple[str, ...]:
    """Every module, and every name taken from one, in import statements of sources.

    The sources are read and not run: what a running localizer reports could carry a note from one walk to the next.
    """
    found = set()
    trees = ([Path(place)] if Path(place).is_file() else Path(place).rglob("*.py") for place in places)
    left = MAX_TOTAL_BYTES
    for path in itertools.islice(itertools.chain.from_iterable(trees), MAX_SOURCES):
        with contextlib.suppress(OSError, SyntaxError, ValueError, RecursionError, MemoryError):
            if path.suffix != ".py" or (left := left - path.stat().st_size) < 0:
                continue
            for node in ast.walk(ast.parse(path.read_bytes()[:MAX_SOURCE_BYTES])):
                if isinstance(node, ast.Import):
                    found |= {name.name for name in node.names}
                elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                    found |= {node.module, *(f"{node.module}.{name.name}" for name in node.names)}
    return tuple(sorted(found))


@functools.lru_cache(maxsize=4)
def _common(path: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """What every child may read and list, where modules are searched on `path`."""
    hidden = hidden_places()
    readable: list[str] = []
    listed = [str(root) for root in _import_roots() if root.is_dir()]
    for root in _readable_roots():
        _cover(root, hidden, readable, listed)
    return tuple(dict.fromkeys(readable)), tuple(dict.fromkeys(listed))


def numba_cache() -> str:
    """The folder where Numba keeps what it compiles; empty where that lies beside the sources."""
    chosen = os.environ.get("NUMBA_CACHE_DIR", "")
    if chosen:
        return str(Path(chosen).absolute())
    if os.access(HOME, os.W_OK):
        return ""
    from numba.misc.appdirs import AppDirs

    return str(AppDirs(appname="numba", appauthor=False).user_cache_dir)  # type: ignore[no-untyped-call]


def compiled_folders() -> list[str]:
    """Where compiled functions of pdrbench and its localizers lie; made where they are missing."""
    folder = numba_cache()
    builtin = {entry.target.partition(".")[0] for entry in localizers().values() if entry.package == OURS}
    roots = [Path(place) for name in sorted({OURS, *builtin}) for place in _locations(name)]
    sources = sorted({path.parent for root in roots for path in root.rglob("*.py")})
    if folder:  # that of the simulator is in there too
        places = [Path(folder) / _cache_name(source) for source in sources]
    else:
        places = [source / "__pycache__" for source in sources if os.access(source, os.W_OK)]
    for place in places:
        place.mkdir(parents=True, exist_ok=True)
    return [str(place) for place in places]


def _is_compiled(package: str) -> bool:
    """Whether every module of a package that has compiled functions has some in the cache that are not older."""
    for place in _locations(package):
        cache = Path(numba_cache()) / _cache_name(Path(place)) if numba_cache() else Path(place) / "__pycache__"
        for source in Path(place).glob("*.py"):
            made_s = [file.stat().st_mtime for file in cache.glob(f"{source.stem}.*.nbi")]
            if b"@compiled" in source.read_bytes() and max(made_s, default=0.0) < source.stat().st_mtime:
                return False
    return True


def _cache_name(source: Path) -> str:
    """The folder for functions of a folder of sources within a cache that Numba has in one place."""
    return f"{source.name}_{hashlib.sha1(str(source).encode(), usedforsecurity=False).hexdigest()}"


def private_root() -> Path | None:
    """The folder with task folders of private recordings, each called as the environment it is like; None: none."""
    named = os.environ.get(PRIVATE_VARIABLE)
    return Path(named).absolute() if named else None


def hidden_places() -> frozenset[str]:
    """What no localizer may read: packages with environments and simulators, wherever they are installed, and data."""
    private = private_root()
    found = {str(place) for place in (*data_folders(), cache_folder(), *([] if private is None else [private]))}
    for name in environment_packages():
        for root in _import_roots():
            found |= {str(root / name), str(root / f"{name}.py")}
        found |= {str(place) for place in _locations(name)}
        if numba_cache():
            sources = {path.parent for place in _locations(name) for path in Path(place).rglob("*.py")}
            found |= {str(Path(numba_cache()) / _cache_name(source)) for source in sources}
    return frozenset(os.path.realpath(place) for place in found if os.path.lexists(place))


def _package(top: str, localizer: str) -> list[str]:
    if top in environment_packages():
        raise PluginError(
            f"{localizer}: its package {top!r} registers environments, which the process of a localizer may not read; "
            f"put localizers into a package of their own, or run it without --confined"
        )
    return list(_locations(top))


def _beside(module: str, folders: Iterable[str]) -> Iterator[str]:
    """The folder of a module within the folders of its package; its file where that is at the top of the package."""
    _, *between, last = module.split(".")
    for folder in folders:
        yield str(Path(folder, *between) if between else Path(folder, f"{last}.py"))


def _locations(top: str) -> Iterator[str]:
    """The folders of a package, or the file of a module, on disk."""
    try:
        spec = importlib.util.find_spec(top)
    except (ImportError, ValueError):
        return
    if spec is None:
        return
    folders = list(spec.submodule_search_locations or ())
    if folders:
        yield from folders
    elif spec.origin is not None and os.path.isfile(spec.origin):  # noqa: PTH113
        yield spec.origin


def _import_roots() -> tuple[Path, ...]:
    return tuple(dict.fromkeys(Path(root or os.curdir).absolute() for root in sys.path))


def _installed_roots() -> set[Path]:
    """Folders that pip and the system own; the whole of them is code and what belongs to it."""
    names = ("stdlib", "platstdlib", "purelib", "platlib")
    found = {Path(sysconfig.get_path(name)) for name in names} | {Path(sys.prefix) / "pyvenv.cfg"}
    return found | {root for root in _import_roots() if root.name in PIP_FOLDERS}


def _readable_roots() -> Iterator[str]:
    """Readable folders and files, but for what is hidden below them."""
    yield from SYSTEM
    installed = _installed_roots()
    yield from (str(path) for path in installed)
    for root in _import_roots():
        if root in installed:
            continue
        if root.is_file() or any(root.is_relative_to(path) for path in installed):
            yield str(root)
        elif root.is_dir():
            yield from _importable(root)


def _importable(root: Path) -> Iterator[str]:
    """What `import` finds in a folder of sources; other files and folders there belong to the user."""
    with os.scandir(root) as entries:
        for count, entry in enumerate(entries):
            if count == MAX_FOLDER_ENTRIES:
                return
            if entry.is_dir():
                has_code = os.path.isfile(os.path.join(entry.path, "__init__.py"))  # noqa: PTH113, PTH118
                wanted = has_code or entry.name.endswith(BELONGING)
            else:
                wanted = entry.name.endswith(SOURCES) and entry.is_file()
            if wanted:
                yield entry.path


def _cover(root: str, hidden: frozenset[str], readable: list[str], listed: list[str]) -> None:
    """Adds a folder, or where something hidden lies in it what lies around that."""
    place = os.path.realpath(root)
    if not os.path.lexists(place) or place in hidden or any(place.startswith(f"{of}{os.sep}") for of in hidden):
        return
    if not any(of.startswith(f"{place}{os.sep}") for of in hidden):
        readable.append(place)
        return
    listed.append(place)
    with os.scandir(place) as entries:
        for entry in entries:
            if entry.name != "__pycache__" or not _holds_hidden_module(place, hidden):
                _cover(entry.path, hidden, readable, listed)


def _holds_hidden_module(folder: str, hidden: frozenset[str]) -> bool:
    """True where the compiled form of something hidden may lie in the `__pycache__` of a folder."""
    return any(os.path.dirname(of) == folder and of.endswith(".py") for of in hidden)  # noqa: PTH120
