"""A localizer that is a folder: sources, declared weights, locked requirements, and a file that says how to make it.

The settings stand in `localizer.toml`, or under `[tool.pdrbench]` in `pyproject.toml`, as `Settings` has them.
"""

from __future__ import annotations

import contextlib
import functools
import hashlib
import importlib
import os
import re
import sys
import tomllib
import types
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.machinery import EXTENSION_SUFFIXES, SOURCE_SUFFIXES, ExtensionFileLoader, FileFinder, SourceFileLoader
from pathlib import Path
from typing import Annotated, Any, Final

import msgspec

from pdrbench.errors import PluginError
from pdrbench.files import MAX_DEPTH, SAFE_PATH, sha256_of

SETTINGS_FILE, PROJECT_FILE = "localizer.toml", "pyproject.toml"
PACKAGES_MARK: Final = "@"  # between a folder and that with the packages it imports, in the name of a localizer
SOURCES_BELOW: Final = "src"  # a folder in which modules may lie, besides the top
MAX_FILES: Final = 1000
MAX_SOURCE_BYTES: Final = 8_000_000  # of all files but weights
MAX_SETTINGS_BYTES: Final = 250_000
MAX_WEIGHTS_BYTES: Final = 4_000_000_000  # of each of them
PATH: Final = re.compile(rf"{SAFE_PATH}\Z")
NOT_PACKED: Final = re.compile(r"(\..*|__pycache__|.*\.egg-info|.*\.pdrz)\Z")

RelativePath = Annotated[str, msgspec.Meta(pattern=rf"^{PATH.pattern}")]


class Weights(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A file that is no source."""

    bytes: Annotated[int, msgspec.Meta(ge=0, le=MAX_WEIGHTS_BYTES)]
    sha256: Annotated[str, msgspec.Meta(pattern=r"^[0-9a-f]{64}\Z")]


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How a folder is run."""

    entry: Annotated[str, msgspec.Meta(max_length=300)]  # `file.py:Class` or `package.module:Class`
    # Version of Python that it runs on; any where empty
    python: Annotated[str, msgspec.Meta(pattern=r"^([0-9]{1,2}\.[0-9]{1,2})?\Z")] = ""
    requirements: RelativePath | None = None  # locked, with hashes; None: it imports pdrbench and what that needs
    weights: Annotated[dict[RelativePath, Weights], msgspec.Meta(max_length=100)] = {}


@dataclass(frozen=True, slots=True)
class FolderTarget:
    """Where the class of a folder is; as text `/folder/:module:Class`, or `/folder/@/packages/:module:Class`."""

    folder: Path
    packages: Path | None  # what its requirements were installed into; None: whatever is installed here
    module: str
    attribute: str

    def __str__(self) -> str:
        packages = "" if self.packages is None else f"{PACKAGES_MARK}{self.packages}/"
        return f"{self.folder}/{packages}:{self.module}:{self.attribute}"

    @property
    def roots(self) -> list[str]:
        """Folders in which its modules lie."""
        below = self.folder / SOURCES_BELOW
        return [str(self.folder), *([str(below)] if below.is_dir() else [])]

    def load(self) -> Any:
        """Imports the module, from the folder; raises `PluginError`."""
        packages = [] if self.packages is None else [str(self.packages)]
        _compile_anew(tuple(self.roots))
        sys.path[:0] = [root for root in (*self.roots, *packages) if root not in sys.path]
        try:
            module = importlib.import_module(self.module)
            found = getattr(module, self.attribute)
        except ModuleNotFoundError as error:
            place = "installed" if self.packages is None else f"among its locked requirements in {self.packages}"
            raise PluginError(f"{self.folder} imports {error.name!r}, which is neither in it nor {place}") from error
        except AttributeError as error:
            if hasattr(error, "name") and error.name == self.attribute:
                raise PluginError(f"{self.folder}: its entry is not found: {error}") from error
            raise PluginError(f"{self.folder} cannot be loaded: AttributeError: {error}") from error
        except (Exception, SystemExit) as error:  # it may raise anything when it is imported
            raise PluginError(f"{self.folder} cannot be loaded: {type(error).__name__}: {error}") from error
        if not Path(module.__file__ or "").is_relative_to(self.folder):
            raise PluginError(
                f"{self.folder}: another module named {self.module!r} is loaded already, {module.__file__}; "
                f"give that of the folder another name"
            )
        return found


@functools.cache
def _compile_anew(roots: tuple[str, ...]) -> None:
    """Lets modules in these folders be compiled from their sources whenever they are imported.

    Compiled bytes of a file that was edited twice within a second would be those of the first edit.
    """

    def finder(place: str) -> FileFinder:
        if not any(Path(place).is_relative_to(root) for root in roots):
            raise ImportError(place)
        return FileFinder(place, (ExtensionFileLoader, EXTENSION_SUFFIXES), (_SourceLoader, SOURCE_SUFFIXES))

    sys.path_hooks.insert(0, finder)
    for place in [place for place in sys.path_importer_cache if any(place.startswith(root) for root in roots)]:
        del sys.path_importer_cache[place]


class _SourceLoader(SourceFileLoader):
    """Neither reads nor writes compiled bytes."""

    def get_code(self, fullname: str) -> types.CodeType:
        path = self.get_filename(fullname)
        found: types.CodeType = self.source_to_code(self.get_data(path), path)
        return found


def parse_target(target: str) -> FolderTarget | None:
    """The folder in a target; None where it names a file or a module."""
    place, _, entry = target.partition(":")
    if not place.endswith("/"):
        return None
    folder, _, packages = place[:-1].partition(f"/{PACKAGES_MARK}")
    module, _, attribute = entry.partition(":")
    return FolderTarget(Path(folder), Path(packages) if packages else None, module, attribute)


def find_target(name: str) -> FolderTarget | None:
    """The class behind `path/to/folder`, or `path/to/folder@path/to/packages`; None where a name is of another kind.

    Raises:
        PluginError: It names a folder that is no localizer, or not as it was declared.
    """
    if ":" in name:
        return parse_target(name)
    folder, mark, packages = name, "", ""
    if not Path(name).is_dir() and PACKAGES_MARK in name:
        folder, mark, packages = name.rpartition(PACKAGES_MARK)
    if not Path(folder).is_dir():
        if "/" in name:
            raise PluginError(
                f"no folder {folder}; name an id, package.module:Class, path/to/file.py:Class or a folder"
            )
        return None
    if mark and not Path(packages).is_dir():
        raise PluginError(f"no folder {packages} with the packages of {folder}")
    place = Path(folder).absolute()
    if f"/{PACKAGES_MARK}" in str(place):
        raise PluginError(f"{place}: a folder on the way begins with {PACKAGES_MARK!r}; move it elsewhere")
    module, attribute = check_folder(place)
    return FolderTarget(place, Path(packages).absolute() if mark else None, module, attribute)


def check_folder(folder: Path) -> tuple[str, str]:
    """Module and class of a folder in which everything is as its settings say.

    Raises:
        PluginError: Settings that are wrong or missing, another Python, weights that changed, no such entry.
    """
    settings = read_settings(folder)
    here = f"{sys.version_info.major}.{sys.version_info.minor}"
    if settings.python not in ("", here):
        raise PluginError(f"{folder} is for Python {settings.python}; this is {here}")
    if settings.requirements is not None and not (folder / settings.requirements).is_file():
        raise PluginError(f"{folder}: its lock is missing: no file {settings.requirements}")
    for name, declared in settings.weights.items():
        _check_weights(folder, name, declared)
    return find_entry_in(folder, settings)


def read_settings(folder: Path) -> Settings:
    """What `localizer.toml`, or `[tool.pdrbench]` in `pyproject.toml`, says; raises `PluginError`."""
    for name in (SETTINGS_FILE, PROJECT_FILE):
        path = folder / name
        if path.is_file():
            try:
                return parse_settings(path.read_bytes(), is_project=name == PROJECT_FILE)
            except (OSError, PluginError) as error:
                raise PluginError(f"{path}: {error}") from error
    raise PluginError(
        f'{folder} has neither {SETTINGS_FILE} nor {PROJECT_FILE}; write `entry = "file.py:Class"` into the former'
    )


def parse_settings(content: bytes, *, is_project: bool) -> Settings:
    """Settings from the text of a file; raises `PluginError`."""
    if len(content) > MAX_SETTINGS_BYTES:
        raise PluginError(f"has {len(content)} bytes, {MAX_SETTINGS_BYTES} are allowed")
    try:
        found: Any = tomllib.loads(content.decode())
        if is_project:
            tools = found.get("tool")
            found = tools.get("pdrbench") if isinstance(tools, dict) else None
            if found is None:
                raise PluginError(f"has no table [tool.pdrbench]; write one with its entry, or {SETTINGS_FILE}")
        return msgspec.convert(found, Settings)
    except (msgspec.MsgspecError, ValueError, RecursionError) as error:  # tomllib's and Unicode's are ValueErrors
        raise PluginError(" ".join(str(error).split())[:300] or "is nested too deeply") from None


def find_entry_in(folder: Path, settings: Settings) -> tuple[str, str]:
    """Module and class that the settings name; raises `PluginError` where the folder has no such module."""
    place, _, attribute = settings.entry.partition(":")
    module = ".".join(place.removesuffix(".py").split("/")) if place.endswith(".py") else place
    parts = module.split(".")
    if not (attribute.isidentifier() and all(part.isidentifier() for part in parts)):
        raise PluginError(
            f"{folder}: the entry is written 'file.py:Class' or 'package.module:Class'; got {settings.entry!r}"
        )
    for root in (folder, folder / SOURCES_BELOW):
        path = root.joinpath(*parts)
        if path.with_suffix(".py").is_file() or (path / "__init__.py").is_file():
            return module, attribute
    raise PluginError(f"{folder}: its entry is not found: no module {module!r} in it")


def list_files(folder: Path, settings: Settings) -> dict[str, int]:
    """Size by path of every file that belongs to a folder: sources, which are text, and declared weights.

    Hidden files, compiled code, virtual environments and bundles are left out.

    Raises:
        PluginError: A link, a name that is not harmless everywhere, too many or too large files.
    """
    found: dict[str, int] = {}
    source_bytes = 0
    for entry in _entries(folder, folder):
        path = Path(entry.path).relative_to(folder).as_posix()
        if entry.is_symlink() or not entry.is_file():
            raise PluginError(f"{folder}: {path} is a link or no plain file; a folder is packed without links")
        if not PATH.match(path):
            raise PluginError(f"{folder}: {path[:120]!r} has a name that no other system may have; rename it")
        found[path] = entry.stat().st_size
        source_bytes += 0 if path in settings.weights else found[path]
        if len(found) > MAX_FILES or source_bytes > MAX_SOURCE_BYTES:
            raise PluginError(
                f"{folder} has more than {MAX_FILES} files or {MAX_SOURCE_BYTES} bytes without declared weights, the "
                f"last is {path}; keep data elsewhere, and declare weights in {SETTINGS_FILE}"
            )
    return dict(sorted(found.items()))


def _entries(folder: Path, top: Path) -> Iterator[os.DirEntry[str]]:
    """Everything below a folder but what is not packed; folders that are links come as they are."""
    with os.scandir(folder) as entries:
        listed = sorted(entries, key=lambda entry: entry.name)
    for entry in listed:
        if NOT_PACKED.match(entry.name):
            continue
        if entry.is_dir(follow_symlinks=False):
            if len(Path(entry.path).relative_to(top).parts) >= MAX_DEPTH:
                raise PluginError(f"{top}: {entry.path} is more than {MAX_DEPTH} folders deep")
            if not (Path(entry.path) / "pyvenv.cfg").is_file():
                yield from _entries(Path(entry.path), top)
        else:
            yield entry


def installed_sha256(packages: Path) -> str:
    """Digest of what was installed into a folder: of the records that wheels leave there."""
    digest = hashlib.sha256()
    for record in sorted(packages.glob("*.dist-info/RECORD")):
        digest.update(f"{record.parent.name} {sha256_of(record)}\n".encode())
    return digest.hexdigest()


def _check_weights(folder: Path, name: str, declared: Weights) -> None:
    path = folder / name
    try:
        size = path.stat().st_size
        same = size == declared.bytes and sha256_of(path) == declared.sha256
    except OSError as error:
        raise PluginError(f"{folder}: its weights {name} are missing: {error.strerror}") from error
    if not same:
        raise PluginError(
            f"{folder}: its weights {name} are not those that {SETTINGS_FILE} declares; where they are meant to be, "
            f"write\n{weights_toml(folder, name)}"
        )


def weights_toml(folder: Path, name: str) -> str:
    """The lines that declare a file as weights."""
    path = folder / name
    return f'[weights."{name}"]\nbytes = {path.stat().st_size}\nsha256 = "{sha256_of(path)}"'


def neighbour_of(file: Path, module: str | None) -> bool:
    """Whether a module that was not found lies beside the file that imports it."""
    top = (module or "").partition(".")[0]
    with contextlib.suppress(OSError):
        return bool(top) and ((file.parent / f"{top}.py").is_file() or (file.parent / top).is_dir())
    return False
