"""Copies of the set on this machine: the folders and archives that users name, and what lies in them."""

from __future__ import annotations

import functools
import os
import zipfile
from collections import defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Final

import msgspec

from pdrbench.datasets import cache_folder
from pdrbench.datasets.folders import brought_folders, remember_folder
from pdrbench.errors import DatasetError, RecordingError
from pdrbench.files import is_safe_name
from pdrbench.io.compressed import content_of, plain_name
from pdrbench.io.container import DAMAGED, ZIP_MAGIC
from pdrbench.io.text import MAX_TEXT_BYTES, Text, clean_text
from pdrbench_sim.readers.ilc20_map import PLAN, SIZE

DATASET: Final = "kaggle_iln"
TEST: Final = "test"  # folder of walks without places
_BETWEEN: Final = "path_data_files"  # of walks, in the form of ILC20


class Member(msgspec.Struct, frozen=True):
    """One file of a source.

    Attributes:
        source: Folder or zip archive.
        name: Inside it, with forward slashes.
        num_bytes: Size.
        stamp: Changes where the file does: its time of change, or its checksum in an archive.
    """

    source: str
    name: str
    num_bytes: int
    stamp: int

    @property
    def path(self) -> Path:
        """How errors name it."""
        return Path(self.source) / self.name

    def content(self) -> bytes:
        """What it holds, decompressed.

        Raises:
            RecordingError: It is missing, damaged or too large.
        """
        if self.num_bytes > MAX_TEXT_BYTES:
            raise RecordingError(f"{self.path}: more than {MAX_TEXT_BYTES >> 20} MiB; no walk of the set is so long")
        try:
            if Path(self.source).is_dir():
                with self.path.open("rb") as stream:
                    return content_of(stream, self.path, MAX_TEXT_BYTES)
            with _archive(self.source).open(self.name) as stream:
                return content_of(stream, self.path, MAX_TEXT_BYTES)
        except DAMAGED as error:
            raise RecordingError(f"{self.path}: cannot be read: {error}; copy it again") from error

    def text(self) -> Text:
        """What a walk holds."""
        return clean_text(self.content(), self.path)


@dataclass(frozen=True, slots=True)
class Site:
    """Files of one building.

    Attributes:
        name: Of the building.
        walks: Files by floor and name of the walk.
        plans: Files by floor and name of the file.
    """

    name: str
    walks: Mapping[tuple[str, str], Member]
    plans: Mapping[tuple[str, str], Member]


def _archive(path: str) -> zipfile.ZipFile:
    """An open archive of this process: one that is forked shares the place in the file that its parent has open."""
    return _opened(path, os.getpid())


@functools.lru_cache(maxsize=4)
def _opened(path: str, process: int) -> zipfile.ZipFile:
    return zipfile.ZipFile(path)


def sources() -> tuple[Path, ...]:
    """Copies that were added, then those in the folders of `PDRBENCH_DATA`, each once."""
    return tuple(dict.fromkeys(path.resolve() for path in brought_folders(DATASET)))


def sites() -> Mapping[str, Site]:
    """Buildings of all sources by name; of a walk that two of them hold, the first is taken."""
    return _sites(sources())


@functools.lru_cache(maxsize=2)
def _sites(places: tuple[Path, ...]) -> Mapping[str, Site]:
    walks: dict[str, dict[tuple[str, str], Member]] = defaultdict(dict)
    plans: dict[str, dict[tuple[str, str], Member]] = defaultdict(dict)
    for member in (member for place in places for member in members(place)):
        *folders, name = (PurePosixPath(member.source).stem, *PurePosixPath(member.name).parts)
        if folders[-1] == _BETWEEN:
            folders.pop()
        plain = plain_name(name)
        if len(folders) < 2 or folders[-1] == TEST or name.startswith("."):  # hidden: no walk, what systems add
            continue
        if not is_safe_name(folders[-2]):  # no building of the set, whose names become those of files
            continue
        site, floor = folders[-2:]
        if plain in (PLAN, SIZE):
            plans[site].setdefault((floor, plain), member)
        elif plain.endswith(".txt"):
            walks[site].setdefault((floor, plain.removesuffix(".txt")), member)
    return {name: Site(name, walks[name], plans.get(name, {})) for name in sorted(walks)}


def secret_walks() -> list[Member]:
    """Files of walks whose places nobody has published."""
    every = (member for place in sources() for member in members(place))
    return [each for each in every if PurePosixPath(each.name).parent.name == TEST and each.name.endswith(".txt")]


def members(place: Path) -> Iterator[Member]:
    """Every file of a folder or zip archive, by name; none where it is gone.

    Raises:
        DatasetError: It is neither, or a damaged archive.
    """
    if place.is_dir():
        for folder, inner, names in os.walk(place):
            inner.sort()
            for name in sorted(names):
                file = Path(folder, name)
                state = file.stat()
                yield Member(str(place), file.relative_to(place).as_posix(), state.st_size, state.st_mtime_ns)
    elif place.is_file():
        try:
            found = sorted(_archive(str(place)).infolist(), key=lambda each: each.filename)
        except DAMAGED as error:
            raise DatasetError(f"{place}: no folder and no zip archive ({error}); name the download") from error
        for each in found:
            if not each.is_dir():
                yield Member(str(place), each.filename, each.file_size, each.CRC)


def kept_folder() -> Path:
    """Where indexes lie."""
    return cache_folder() / DATASET


def add(folder: Path) -> Path:
    """Remembers a copy of the set, without copying it.

    Raises:
        DatasetError: It is no folder or archive, or holds no walk of the set.
    """
    place = folder.expanduser().resolve()
    if not place.is_dir() and not (place.is_file() and place.open("rb").read(4) == ZIP_MAGIC):
        raise DatasetError(f"{folder}: no folder and no zip archive; name the download of the set, unpacked or as zip")
    if not _sites((place,)):
        raise DatasetError(
            f"{folder}: no walk of the set; expected SITE/FLOOR/WALK.txt, as in train/, compressed or not"
        )
    remember_folder(DATASET, place)
    return place
