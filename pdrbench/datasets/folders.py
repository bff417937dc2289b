"""The folders of datasets on this machine."""

from __future__ import annotations

import os
from pathlib import Path

from pdrbench.datasets.catalogue import LICENCE, NOTE, Dataset, dataset
from pdrbench.errors import DatasetError

_FOLDERS = "folders.txt"  # of the copies of a set that were added
DATA_VARIABLE, CACHE_VARIABLE = "PDRBENCH_DATA", "PDRBENCH_CACHE"


def find(name: str) -> Path:
    """The folder that holds a dataset.

    Looks into every place of `PDRBENCH_DATA` (a path list; a place holds the set as a subfolder of its name, or is
    the set itself), then into the cache folder, where a set counts once all of it was fetched.

    Raises:
        UnknownNameError: No such dataset is registered.
        DatasetError: It lies in none of these places; says how to get it.
    """
    sought = dataset(name)
    for place in data_folders():
        for folder in (place / name, place):
            if _holds(folder, sought):
                return folder
    cached = cache_folder() / name
    if not sought.files:
        for folder in brought_folders(name):
            return folder
    elif is_whole(cached, sought):
        return cached
    raise DatasetError(_how_to_get(sought, cached))


def brought_folders(name: str) -> list[Path]:
    """Copies of a set that every user brings: those that were added, then folders of `PDRBENCH_DATA` named like it."""
    kept = cache_folder() / name / _FOLDERS
    added = kept.read_text(encoding="utf-8").splitlines() if kept.is_file() else []
    named = (place / one for place in data_folders() for one in (name, *dataset(name).also_named))
    return [place for place in (*map(Path, added), *named) if place.exists()]


def remember_folder(name: str, place: Path) -> None:
    """Makes a folder or archive a copy of a set that every user brings."""
    kept = cache_folder() / name / _FOLDERS
    kept.parent.mkdir(parents=True, exist_ok=True)
    before = kept.read_text(encoding="utf-8").splitlines() if kept.is_file() else []
    kept.write_text("".join(f"{one}\n" for one in dict.fromkeys([*before, str(place)])), encoding="utf-8")


def is_available(name: str) -> bool:
    """True where `find` finds it."""
    try:
        find(name)
    except DatasetError:
        return False
    return True


def data_folders() -> tuple[Path, ...]:
    """The places of `PDRBENCH_DATA` in their order."""
    return tuple(Path(place).expanduser() for place in os.environ.get(DATA_VARIABLE, "").split(os.pathsep) if place)


def cache_folder() -> Path:
    """Where fetched sets go: `PDRBENCH_CACHE`, or the platform's cache folder."""
    chosen = os.environ.get(CACHE_VARIABLE)
    if chosen:
        return Path(chosen).expanduser()
    import pooch  # slow to import

    return Path(pooch.os_cache("pdrbench"))


def is_whole(folder: Path, sought: Dataset) -> bool:
    """True where every required file of the set lies in `folder`; their content is for `verify` to check."""
    return all((folder / file.path).is_file() for file in sought.files if file.is_required)


def _holds(folder: Path, sought: Dataset) -> bool:
    """True where `folder` is this set: by its name and not empty, or by a file of the set in it."""
    if not folder.is_dir():
        return False
    if folder.name == sought.name:
        return any(folder.iterdir())
    return any((folder / f.path).is_file() for f in sought.files if f.role not in (LICENCE, NOTE))


def _how_to_get(sought: Dataset, cached: Path) -> str:
    looked = ", ".join(str(place) for place in (*data_folders(), cached))
    remedy = f"run `pdrbench data fetch {sought.name}`" if sought.is_fetchable else sought.how_to_get
    return (
        f"the dataset {sought.name!r} is not available (looked in {looked}); {remedy}, "
        f"or set {DATA_VARIABLE} to the folder that holds {sought.name}/"
    )
