"""What is known of every recorded dataset: where it comes from, under which licence, and the hash of each file."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from importlib.resources import files as package_files
from typing import Any

import msgspec

from pdrbench.errors import DatasetError, unknown_name
from pdrbench.files import is_safe_name, is_safe_path

LICENCE, NOTE = "licence", "note"


class DataFile(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True, kw_only=True):
    """One file of a dataset.

    Attributes:
        path: Relative to the folder of the set, with forward slashes.
        sha256: Of the file, hexadecimal.
        bytes: Size of the file.
        role: "licence"; "note" (a remark on how the set was collected: may be absent); "map"; or what the set's own
            description calls it, such as "train", "radiomap", "eval".
        facts: What is known of it without opening it.
        content_sha256: Of the decompressed content where the file is compressed with gzip or xz; "" elsewhere.
        url: Where its source file is fetched from; "package:NAME" for a licence text that travels with pdrbench
            in `datasets/licences`; "" where it cannot be fetched.
        source_blob: Git blob id of the source file, sha1 over "blob <size>\\0" and the content; "" where not known.
        recipe: How the file is made from its source file: a key of `recipes.RECIPES`.
    """

    path: str
    sha256: str
    bytes: int
    role: str
    facts: Mapping[str, Any] = {}
    content_sha256: str = ""
    url: str = ""
    source_blob: str = ""
    recipe: str = "copy"

    def __post_init__(self) -> None:
        if not is_safe_path(self.path):
            raise ValueError(f"a path inside the set was expected; got {self.path!r}")

    @property
    def is_required(self) -> bool:
        """False for notes: the set is whole without them."""
        return self.role != NOTE


class Dataset(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """One recorded dataset, without its rows.

    Attributes:
        name: Key in `datasets()` and name of its folder.
        summary: One sentence for tables.
        licence: SPDX expression, or "LicenseRef-..." where nothing could be confirmed.
        licence_note: What is known of the licence beyond its name.
        source_url: Repository or page the files come from.
        commit: Commit of the repository.
        citation: What to cite.
        how_to_get: What to do where the set cannot be fetched.
        by_content: True where `path` is not the name that the source gave the file, because those names hold names
            of people; such files are recognised by their hash, wherever they lie in the folder.
        files: Every file; none of a set that every user brings, see `data add`.
        also_named: Other names of its folder.
    """

    name: str
    summary: str
    licence: str
    licence_note: str
    source_url: str
    commit: str
    citation: str
    how_to_get: str
    by_content: bool
    files: tuple[DataFile, ...]
    also_named: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not is_safe_name(self.name):
            raise ValueError(f"a name of a folder was expected; got {self.name!r}")

    @property
    def total_bytes(self) -> int:
        """Size of all files."""
        return sum(file.bytes for file in self.files)

    @property
    def is_fetchable(self) -> bool:
        """True where every required file has a source that it can be fetched from."""
        return bool(self.files) and all(file.url for file in self.files if file.is_required)


def read_table(text: bytes, origin: str) -> Dataset:
    """Reads one table; `origin` is named where it is wrong."""
    try:
        return msgspec.json.decode(text, type=Dataset)
    except (msgspec.DecodeError, UnicodeDecodeError) as error:
        remedy = "make it anew with: python -m pdrbench_lab.dataset_table FOLDER"
        raise DatasetError(f"{origin}: {error}; {remedy}") from error


@functools.cache
def datasets() -> Mapping[str, Dataset]:
    """Every registered dataset by name."""
    folder = package_files("pdrbench.datasets") / "tables"
    tables = sorted((place for place in folder.iterdir() if place.name.endswith(".json")), key=lambda p: p.name)
    found = (read_table(place.read_bytes(), place.name) for place in tables)
    return {dataset.name: dataset for dataset in found}


def dataset(name: str) -> Dataset:
    """One registered dataset; raises `UnknownNameError` with the nearest name."""
    try:
        return datasets()[name]
    except KeyError:
        raise unknown_name("dataset", name, datasets()) from None
