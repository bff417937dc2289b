"""Finds everything that can be added: ours and that of other packages in the same way, by entry point.

An entry point of a group names a dict of `id: "module:attribute"`. What cannot be listed or loaded is named with its
reason, and so is an id that two packages register.
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import hashlib
import importlib
import importlib.util
import sys
import warnings
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from importlib.metadata import EntryPoint, entry_points
from pathlib import Path
from typing import Any, TypeVar

from pdrbench.errors import PdrbenchError, UnknownNameError, unknown_name
from pdrbench.errors import PluginError as PluginError
from pdrbench.localizer import Localizer
from pdrbench.localizer_folder import SETTINGS_FILE, find_target, neighbour_of, parse_target
from pdrbench.settings import (
    MARK,
    PARAMS,
    SettingsError,
    canonical_query,
    join_name,
    read_query,
    sorted_query,
    split_name,
)
from pdrbench.task import Task, commitment

ENVIRONMENTS_GROUP = "pdrbench.environments"
LOCALIZERS_GROUP = "pdrbench.localizers"
COMMANDS_GROUP = "pdrbench.commands"
EXCHANGES_GROUP = "pdrbench.exchanges"  # what reads task files, packs and exports them
HIDDEN_GROUP = "pdrbench.hidden"  # packages that make walks, named only: no localizer may read them
WARM_UPS_GROUP = "pdrbench.warm_ups"
LAUNCHERS_GROUP = "pdrbench.launchers"  # what starts processes of localizers, by the kind of isolation
HELD_OUT_GROUP = "pdrbench.held_out"  # what makes held-out walks of recordings, under "recorded"
BOARDS_GROUP = "pdrbench.boards"  # functions that return the environments of boards by name

Thing = TypeVar("Thing")

CARDS_FILE = "cards.toml"  # in a package that registers localizers, see `pdrbench_leaderboard.card`
RENAMED = "renamed:"  # begins the target of a former id, before its new id
OURS = "pdrbench"  # this package, and its distribution, whose localizers may be loaded into any process
TASK_FILE = "task.toml"  # makes a folder of recordings an environment, see `pdrbench_formats.taskfile`


@dataclass(frozen=True, slots=True)
class PluginEntry:
    """One registered name."""

    id: str  # name, for an environment `Name-vN`
    target: Any  # `package.module:attribute`, or the record itself where a table holds records
    package: str  # distribution that registered it

    def load(self) -> Any:
        """Imports the target; raises `PluginError` with the cause."""
        if not isinstance(self.target, str):
            return self.target
        return _load_target(self.target, f"{self.id!r} from {self.package}")

    @property
    def folder(self) -> Path | None:
        """The folder of the top-level package of the target; None where that is a single module."""
        spec = importlib.util.find_spec(self.target.partition(":")[0].partition(".")[0])
        places = [] if spec is None else [Path(place) for place in spec.submodule_search_locations or ()]
        return places[0] if places else None


def _load_target(target: str, who: str) -> Any:
    module_name, _, attribute = target.partition(":")
    try:
        return getattr(importlib.import_module(module_name), attribute)
    except (Exception, SystemExit) as error:  # a plug-in may raise anything when it is imported
        raise PluginError(f"{who} cannot be loaded: {type(error).__name__}: {error}") from error


def _read_table(point: EntryPoint, package: str) -> Mapping[str, Any]:
    """The dict of targets or records that an entry point names; raises `PluginError` where it is anything else."""
    table = _load_target(point.value, f"entry point {point.name!r} of {package}")
    if not isinstance(table, Mapping) or not all(
        isinstance(k, str) and (":" in v if isinstance(v, str) else dataclasses.is_dataclass(v))
        for k, v in table.items()
    ):
        raise PluginError(f"entry point {point.name!r} of {package} must name a dict of 'id': 'module:attribute'")
    return table


@functools.cache
def _scan(group: str) -> tuple[dict[str, PluginEntry], dict[str, str], dict[str, str]]:
    """Entries by id, reason by name for what is broken, such as an id registered twice, and new id by former id."""
    entries: dict[str, PluginEntry] = {}
    broken: dict[str, str] = {}
    renamed: dict[str, str] = {}
    for point in sorted(entry_points(group=group), key=lambda point: (point.name != "builtin", point.value)):
        package = point.dist.name if point.dist is not None else point.value.partition(":")[0]
        try:
            table = _read_table(point, package)
        except PluginError as error:
            broken[f"{package}:{point.name}"] = str(error)
            continue
        for name, target in table.items():
            if isinstance(target, str) and target.startswith(RENAMED):
                renamed[name] = target.removeprefix(RENAMED)
                continue
            if name in entries and entries[name].target != target:
                broken[f"{package}:{name}"] = f"{name!r} is already registered by {entries[name].package}"
                continue
            entries[name] = PluginEntry(name, target, package)
    return entries, broken, renamed


def environments() -> Mapping[str, PluginEntry]:
    """Every registered environment by id."""
    return _scan(ENVIRONMENTS_GROUP)[0]


def localizers() -> Mapping[str, PluginEntry]:
    """Every registered localizer by id."""
    return _scan(LOCALIZERS_GROUP)[0]


def entries(group: str) -> Mapping[str, PluginEntry]:
    """Everything registered in an entry-point group, by name."""
    return _scan(group)[0]


def environment_packages() -> frozenset[str]:
    """Top-level packages that register or define environments, and those registered as hidden."""
    groups = (ENVIRONMENTS_GROUP, HIDDEN_GROUP)
    modules = {point.value for group in groups for point in entry_points(group=group)} | {
        entry.target for entry in environments().values()
    }
    return frozenset(module.partition(":")[0].partition(".")[0] for module in modules) - {OURS}


def find_entry(group: str, kind: str, name: str) -> PluginEntry:
    """The entry of a group with this name.

    Args:
        group: Entry-point group.
        kind: What the error message calls an entry, such as "bench".
        name: As registered.

    Raises:
        UnknownNameError: No package registered it; names its new id where it was renamed, else the nearest name.
    """
    if name in entries(group):
        return entries(group)[name]
    if now := successor(group, name):
        raise UnknownNameError(f"no {kind} named {name!r}: {name!r} is now {now!r}")
    raise unknown_name(kind, name, entries(group), broken(group))


def renamed(group: str) -> Mapping[str, str]:
    """New id by former id. In a table of plug-ins, a former id has the target `renamed:` and its new id."""
    return _scan(group)[2]


def successor(group: str, name: str) -> str:
    """The id that stands now for a former one; empty where no rule knows it.

    A table names it with a target `renamed:`, which may have settings. Without that, `name-v0` is now `name`, and
    `Name-v1` the newest `Name-vN`.
    """
    stem, _, number = name.rpartition("-v")
    if name in renamed(group):
        return renamed(group)[name]
    if not (stem and number.isdecimal()):
        return ""
    if stem in entries(group):
        return stem
    numbers = [other.rpartition("-v")[2] for other in entries(group) if other.rpartition("-v")[0] == stem]
    newest = max(map(int, filter(str.isdecimal, numbers)), default=-1)
    return f"{stem}-v{newest}" if newest > int(number) else renamed(group).get(stem, "")


def broken(group: str) -> Mapping[str, str]:
    """Reason by name for every plug-in of a group that could not be listed."""
    return _scan(group)[1]


class Table(Mapping[str, Thing]):
    """Everything of one kind by name, loaded when it is asked for: the built-in entries, then those of other packages.

    >>> from pdrbench.sensors import SENSORS
    >>> "wifi" in SENSORS, SENSORS["wifi"].columns[1]
    (True, 'access_point')
    """

    def __init__(
        self, group: str, kind: str, builtin: Mapping[str, Any], check: Callable[[str, Any], None] | None = None
    ) -> None:
        """Makes the table of an entry-point group.

        Args:
            group: Name of the group.
            kind: What the error message calls an entry, such as "sensor".
            builtin: Targets or records of this package, used without looking up entry points.
            check: Raises `PluginError` where an entry of another package is wrong; it is left out, with a warning.
        """
        self.group = group
        self._kind = kind
        self._check = check
        self._builtin = {name: PluginEntry(name, target, "pdrbench") for name, target in builtin.items()}

    def entries(self) -> Mapping[str, PluginEntry]:
        """Every entry by name, nothing loaded."""
        return {**self._builtin, **entries(self.group)}

    def __getitem__(self, name: str) -> Thing:
        entry = self._builtin.get(name) or find_entry(self.group, self._kind, name)
        thing: Thing = entry.load()
        if self._check is not None and name not in self._builtin:
            self._check(name, thing)
        return thing

    def __contains__(self, name: object) -> bool:
        return name in self._builtin or (name in entries(self.group) and name in set(self))

    def __iter__(self) -> Iterator[str]:
        for name in self.entries():
            try:
                if self._check is not None and name not in self._builtin:
                    self[name]
            except PluginError as error:
                warnings.warn(f"left out: {error}", stacklevel=2)
            else:
                yield name

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def broken(self) -> dict[str, str]:
        """Reason by name for everything of the kind that cannot be listed or loaded; loads all of it."""
        reasons = dict(broken(self.group))
        for name in self.entries():
            try:
                self[name]
            except PluginError as error:
                reasons[name] = str(error)
        return reasons


def make_task(name: str, secret: str | None = None) -> Task:
    """The task behind an environment id, with or without the `pdrbench/` prefix, or behind a path.

    Args:
        name: Id, a folder with a `task.toml`, that file itself, or `path/to/file.py:function`.
        secret: Adds the split "heldout", whose walks are drawn from it: others of their kind where walks are generated,
            replays of test walks, which the package with the leaderboards makes, elsewhere.

    Raises:
        UnknownNameError: It is not registered; suggests the nearest id.
        PluginError: It is registered, or a file is named, and it does not load.
        RecordingError: A task file is wrong; names the key.
        DatasetError: Its recorded data is not available.
        PdrbenchError: It has neither held-out walks nor test walks to replay, or the secret could be guessed.
    """
    if secret is not None:
        commitment(secret)  # raises where it could be guessed
    place = task_place(name)
    task = registered_task(name.removeprefix("pdrbench/")) if place is None else _task_at(place)
    if secret is None:
        return task
    if task.held_out is not None:
        return task.held_out(secret)
    replayed = find_entry(HELD_OUT_GROUP, "maker of held-out walks", "recorded").load()
    held_out: Task = replayed(task, secret)
    return held_out


def make_kept_task(name: str) -> Task:
    """As `make_task`; simulated walks whose truth may be known are read from the cache folder after the first time."""
    task: Task = find_entry(EXCHANGES_GROUP, "exchange", "kept_task").load()(name)
    return task


def task_place(name: str) -> str | None:
    """The absolute form of a path that stands for an environment; None where the name is an id.

    Returns:
        `/path/to/task.toml` or `/path/to/file.py:function`.

    Raises:
        PluginError: It is a path, and no environment is there.
    """
    plain = name.removeprefix("pdrbench/")
    if plain in environments() or plain in renamed(ENVIRONMENTS_GROUP):
        return None
    file, _, function = name.partition(":")
    if file.endswith(".py"):
        if not function:
            raise PluginError(f"{name} names a file and no function in it; write {file}:task")
        return f"{Path(file).absolute()}:{function}"
    path = Path(name).absolute()
    is_folder, is_file = False, False
    with contextlib.suppress(OSError):  # a name too long for the system
        is_folder, is_file = path.is_dir(), path.is_file()
    if is_folder and not (path / TASK_FILE).is_file():
        raise PluginError(
            f"{name} is a folder without {TASK_FILE}; write one, or let `pdrbench try FILE...` write it for recordings"
        )
    if is_folder:
        return str(path / TASK_FILE)
    if path.suffix == ".toml" or "/" in plain:
        if not is_file:
            raise PluginError(
                f"no file or folder {name}; an environment is an id, a folder with {TASK_FILE}, or file.py:function"
            )
        return str(path)
    return None


def _task_at(place: str) -> Task:
    """The task of an absolute place, made again where a file has changed."""
    file, _, function = place.partition(":")
    if not file.endswith(".py"):
        found: Task = find_entry(EXCHANGES_GROUP, "exchange", "task_file").load()(Path(place))
        return found
    make = _load_file(Path(file), function)
    return _checked_task(make, place)


def _checked_task(make: Any, who: str) -> Task:
    """What a function of a plug-in returns, once it is known to be a task."""
    try:
        task = make()
    except PdrbenchError:
        raise
    except (Exception, SystemExit) as error:  # a plug-in may raise anything
        raise PluginError(f"{who} raised {type(error).__name__}: {error}") from error
    if not isinstance(task, Task):
        raise PluginError(f"{who} returned {type(task).__name__}, not a Task")
    return task


@functools.cache
def registered_task(name: str) -> Task:
    """The task behind a registered id; raises as `make_task`."""
    entry = environments().get(name) or find_entry(ENVIRONMENTS_GROUP, "environment", name)
    who = f"{name!r} from {entry.package}"
    task = _checked_task(entry.load(), f"{who}: {entry.target}")
    if task.id != name:
        raise PluginError(f"{who}: its task calls itself {task.id!r}")
    return task


def load_localizer(name: str) -> type:
    """The class behind a localizer id, `package.module:Class`, `path/to/file.py:Class` or `path/to/folder`.

    Settings may follow, as in `li2012?map=false`: they are checked, and `make_localizer` makes use of them.

    Raises:
        UnknownNameError: It is not registered.
        PluginError: It does not load.
        SettingsError: It does not have these settings.
    """
    plain, query = split_name(name)
    found = _load_plain(plain, query)
    if not callable(found):
        raise PluginError(f"{plain} is {type(found).__name__}, not a class that makes localizers")
    if query:
        read_query(found, query, plain)
    return found  # type: ignore[no-any-return]


def _load_plain(name: str, query: str) -> Any:
    place, _, attribute = name.partition(":")
    if (target := parse_target(name)) is not None:
        return target.load()
    if place.endswith(".py"):
        if not attribute:
            raise PluginError(f"{name} names a file and no class in it; write {place}:Class")
        return _load_file(Path(place), attribute)
    if place and attribute:
        return _load_target(name, name)
    if name not in localizers() and (target := find_target(name)) is not None:
        return target.load()
    return localizer_entry(name, query).load()


def localizer_entry(name: str, query: str = "") -> PluginEntry:
    """The entry of a registered localizer; `query` are settings that the error for a former id repeats.

    Raises:
        UnknownNameError: It is not registered.
    """
    try:
        return find_entry(LOCALIZERS_GROUP, "localizer", name)
    except UnknownNameError:
        if not (query and (now := successor(LOCALIZERS_GROUP, name))):
            raise
        plain, more = split_name(now)
        whole = join_name(plain, "&".join(filter(None, (more, query))))
        former = join_name(name, query)
        raise UnknownNameError(f"no localizer named {former!r}: {former!r} is now {whole!r}") from None


def make_localizer(name: str, **parameters: Any) -> Localizer:
    """A new localizer; its name and what is raised are as for `load_localizer`."""
    plain, query = split_name(name)
    make = load_localizer(name)
    if query and PARAMS in parameters:
        raise SettingsError(f"{name!r} has settings in its name, and {PARAMS} besides; leave one of them out")
    if query:
        parameters[PARAMS] = read_query(make, query, plain)
    localizer = make(**parameters)
    if not isinstance(localizer, Localizer):
        raise PluginError(f"{name} lacks reset(briefing, rng) or step(observation)")
    return localizer


def canonical_localizer(name: str, *, loads: bool | None = None) -> str:
    """The name under which a localizer is stored and shown: settings sorted, without those that are the defaults.

    Args:
        name: As for `load_localizer`.
        loads: Whether its class may be loaded into this process; None: where it comes with pdrbench. The settings of a
            class that is not loaded are sorted only.

    Raises:
        SettingsError: As `load_localizer` where it is loaded, else where settings are not written `field=value`.
    """
    plain, query = split_name(name)
    if not query:
        return name.removesuffix(MARK)
    entry = localizers().get(plain)
    if entry is None and successor(LOCALIZERS_GROUP, plain):
        localizer_entry(plain, query)  # raises, and names the id of today
    is_loaded = loads if loads is not None else entry is not None and entry.package == OURS
    found = canonical_query(load_localizer(name), query, plain) if is_loaded else sorted_query(query)
    return join_name(plain, found)


def _load_file(path: Path, attribute: str) -> Any:
    """An attribute of a file outside any package, executed once per content."""
    if not path.is_file():
        raise PluginError(f"no file {path}; name an id, package.module:name or path/to/file.py:name")
    source = path.read_bytes()
    digest = hashlib.sha256(source).hexdigest()[:16]
    module_name = f"_pdrbench_file_{path.stem}_{digest}"
    if module_name not in sys.modules:
        spec = importlib.util.spec_from_file_location(module_name, path)
        if spec is None:
            raise PluginError(f"{path} is not Python source")
        module = importlib.util.module_from_spec(spec)
        sys.modules[module_name] = module
        try:
            # Compiled bytes of a file that was edited twice within a second would be those of the first edit
            exec(compile(source, path, "exec", dont_inherit=True), module.__dict__)
        except BaseException as error:
            del sys.modules[module_name]
            if isinstance(error, ModuleNotFoundError) and neighbour_of(path, error.name):
                raise PluginError(
                    f"{path} imports {error.name!r}, which lies beside it: a localizer of one file reads no other; put "
                    f'{SETTINGS_FILE} with the line `entry = "{path.name}:{attribute}"` into the folder of both and '
                    f"name that folder instead of the file"
                ) from error
            if isinstance(error, (Exception, SystemExit)):
                raise PluginError(f"{path} cannot be loaded: {type(error).__name__}: {error}") from error
            raise
    if not hasattr(sys.modules[module_name], attribute):
        raise PluginError(f"{path} defines no {attribute!r}")
    return getattr(sys.modules[module_name], attribute)
