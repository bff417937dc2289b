"""Recognises the format of a file or folder by its content, and reads it."""

from __future__ import annotations

import contextlib
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import TYPE_CHECKING, Any, Final

from pdrbench.building import Building
from pdrbench.errors import MapError, RecordingError, not_loaded
from pdrbench.io import READERS
from pdrbench.io.compressed import found_file
from pdrbench.io.container import Container, open_container
from pdrbench.io.log import Log
from pdrbench.io.reader import HEAD_BYTES, Head, head_of

if TYPE_CHECKING:
    from pdrbench_formats.maps.plan import Plan

_MAX_SEARCHED: Final = 20  # files of a folder for the one recording among them: more are many recordings


def detect(path: Path | str) -> str:
    """The format of a file or folder: a key of `READERS`, the first that recognises it.

    A folder or archive that no format recognises, with one file or one recording in it, is in the format of that.

    Raises:
        RecordingError: It is missing or damaged, or in no format that is known; says which are.
    """
    with unpacked(Path(path)) as place:
        return _recognise(place, head_of(place))


def read(path: Path | str, kind: str | None = None, **options: Any) -> Any:
    """Reads a file or folder by the reader of its format.

    Args:
        path: Of the file or folder.
        kind: A key of `READERS`; None to recognise the format by the content.
        options: Of the reader; `strict=False` is passed to those that know it.

    Returns:
        What that reader returns: a `Log`, a `Recording`, a `Building`, or a record of its own.

    Raises:
        RecordingError, MapError: No such format, or as the reader says; or it has no such option.
    """
    from shapely.errors import GEOSException

    with unpacked(Path(path)) as place:
        kind = _recognise(place, head_of(place)) if kind is None else kind
        reader = READERS[kind]
        if "strict" not in reader.options:
            options.pop("strict", None)
        for option in options.keys() - set(reader.options):
            raise RecordingError(f"{path}: the format {kind} has no option {option!r}; leave it out")
        try:
            found = reader.read(place, **options)
        except GEOSException as error:
            raise MapError(f"{path}: its outlines cannot be laid over one another ({error}); redraw them") from error
        except MapError as error:  # of what is drawn: builders know no files
            if str(place) in str(error):
                raise
            raise MapError(f"{path}: {error}") from error
        if place == path or not isinstance(found, Log):
            return found
        others = {name: 1 for name in open_container(Path(path)).sizes if PurePosixPath(name).name != place.name}
        return replace(found, report=replace(found.report, skipped={**found.report.skipped, **others}))


def _recognise(path: Path, head: Head) -> str:
    damage = None
    broken = READERS.broken()
    loaded = {name: READERS[name] for name in READERS if name not in broken}
    for name in sorted(loaded, key=lambda name: loaded[name].fallback):
        try:
            if loaded[name].sniff(head):
                return name
        except RecordingError as error:  # another format may recognise what this one takes for damaged
            damage = damage or error
    if damage is not None:
        raise damage
    if path.is_file() and not head.content.strip():
        raise RecordingError(f"{path}: is empty; copy or export it again")
    members = ", ".join(head.members()[:3])
    unpack = "unpack it and name its folder, or " if head.container is not None and head.container.is_zip else ""
    remedy = f", or {unpack}one of the files in it ({members}, ...)" if members else ""
    raise RecordingError(
        f"{path}: in no format that pdrbench knows ({', '.join(sorted(READERS))}); name the format where its content "
        f"does not show it{remedy}{not_loaded(broken)}"
    )


@contextlib.contextmanager
def unpacked(path: Path) -> Iterator[Path]:
    """The path; of an archive or folder with one file or one recording in it, that file while this lasts."""
    container = head_of(path).container if path.exists() else None
    name = "" if container is None else _only_member(path, container)
    if container is None or not name or not container.is_zip:
        yield found_file(path / container.prefix / name) if container is not None and name else path
        return
    with tempfile.TemporaryDirectory() as folder:
        place = Path(folder) / PurePosixPath(name.replace(":", "-")).name  # Windows has drives and streams there
        place.write_bytes(container.read(name))
        try:
            yield place
        except (RecordingError, MapError) as error:
            raise type(error)(str(error).replace(str(place), str(path / name))) from error


def _only_member(path: Path, container: Container) -> str:
    """The only file of an archive; or the only recording in it or a folder, where no format is that of the whole."""
    names = list(container.sizes)
    if len(names) == 1 and container.is_zip:
        return names[0]
    if container.is_file or len(names) > _MAX_SEARCHED:
        return ""
    from pdrbench_formats.recordings.csv_columns import is_inertial

    readers = [READERS[name] for name in READERS if name not in READERS.broken()]
    logs = [reader for reader in readers if "strict" in reader.options and not reader.fallback]
    with contextlib.suppress(RecordingError):
        head = head_of(path)
        if not any(reader.sniff(head) for reader in readers):
            heads = {name: Head(path / name, container.read(name, HEAD_BYTES)) for name in names}
            logs_of = {name: any(reader.sniff(head) for reader in logs) for name, head in heads.items()}
            found = [name for name, head in heads.items() if logs_of[name] or is_inertial(head.content, head.path)]
            return found[0] if len(found) == 1 else ""
    return ""


def read_plan(path: Path | str, kind: str | None = None, doors: str = "none") -> Plan:
    """Reads a plan of a building in any format.

    Args:
        path: Of the file or folder.
        kind: A key of `READERS`; None to recognise the format by the content.
        doors: For rooms without one: "none", "rooms", "nearest" or "wide", as `maps.openings.with_doors` makes them.

    Raises:
        MapError: It is no plan, or as its reader says.
        RecordingError: In no format that is known.
    """
    from pdrbench_formats.maps.openings import with_doors
    from pdrbench_formats.maps.plan import Plan

    kind = detect(path) if kind is None else kind
    content = read(path, kind)
    plan = Plan(content, source=kind) if isinstance(content, Building) else content
    if isinstance(plan, Plan):
        return with_doors(plan, doors)
    raise MapError(f"{path} is no map but a recording or the like ({kind}); name a file with a plan of a building")
