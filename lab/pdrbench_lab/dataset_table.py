"""Makes or refreshes the table of a dataset from its folder: `python -m pdrbench_lab.dataset_table FOLDER`.

What was written by hand into the table (summary, licence, facts, urls) is kept; hashes, sizes and the list of files are
made anew. A folder with a `manifest.json` in the layout of the ILC20 subset gets its facts from there.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping
from pathlib import Path, PurePosixPath
from typing import Any, Final

import msgspec

import pdrbench.datasets
from pdrbench.datasets.catalogue import LICENCE, NOTE, DataFile, Dataset, read_table
from pdrbench.datasets.integrity import files_in, sha256_of_content
from pdrbench.files import sha256_of

TABLES: Final = Path(pdrbench.datasets.__file__).parent / "tables"
MANIFEST: Final = "manifest.json"
# The manifest also knows the absolute start time and the length of each walk: the one gives the order of walks, the
# other is made from the truth, and no table needs either.
_FACTS: Final = (
    "site", "floor", "path_id", "records", "device", "duration_s", "n_waypoints", "n_wifi_scans", "n_wifi_rows",
    "n_ibeacon_rows", "recording_session", "tags",
)  # fmt: skip
_PLACE: Final = ("site", "floor")  # of a set without roles, whose walks any environment may keep for its test split
_TEXTS: Final = ("summary", "licence", "licence_note", "source_url", "commit", "citation", "how_to_get")


def make_table(folder: Path, known: Dataset | None = None) -> Dataset:
    """The table of a folder.

    Args:
        folder: Folder of the set, named like the set.
        known: The table so far, whose texts are kept.
    """
    known = known or Dataset(name=folder.name, by_content=False, files=(), also_named=(), **dict.fromkeys(_TEXTS, ""))
    manifest = _read_manifest(folder)
    make = _row_by_content if known.by_content else _row_by_path
    rows = {row.path: row for row in (make(folder, path, known) for path in files_in(folder))}
    files = [_with_manifest(row, manifest.get(row.path), known) for row in rows.values()]
    return msgspec.structs.replace(known, files=tuple(files))


def write_table(table: Dataset, path: Path) -> None:
    """Writes a table with one line per file, so that a change shows as the lines it concerns."""
    head = msgspec.to_builtins(table)
    rows = head.pop("files")
    lines = [f" {_json(key)}: {_json(value)}," for key, value in head.items()]
    body = ",\n".join(f"  {_json(row)}" for row in rows)
    path.write_text("\n".join(["{", *lines, ' "files": [', body, " ]", "}", ""]), encoding="utf-8", newline="\n")


def _json(value: object) -> str:
    return msgspec.json.encode(value).decode()


def _row_by_path(folder: Path, path: str, known: Dataset) -> DataFile:
    before = {row.path: row for row in known.files}.get(path)
    return _hashed(folder / path, before or DataFile(path=path, sha256="", bytes=0, role=_role(path)))


def _row_by_content(folder: Path, path: str, known: Dataset) -> DataFile:
    """A row whose path is the one of the table before, or made from its hash: the file's own name stays outside."""
    sha256 = sha256_of(folder / path)
    before = {row.sha256: row for row in known.files}.get(sha256)
    if before is not None:
        return before
    opaque = PurePosixPath(path)
    if _role(path) == "data":
        opaque = PurePosixPath("data") / f"{sha256[:16]}{''.join(opaque.suffixes)}"
    return _hashed(folder / path, DataFile(path=str(opaque), sha256="", bytes=0, role=_role(path)))


def _hashed(place: Path, row: DataFile) -> DataFile:
    return msgspec.structs.replace(
        row,
        sha256=sha256_of(place),
        bytes=place.stat().st_size,
        content_sha256=sha256_of_content(place) if place.suffix in (".gz", ".xz") else "",
    )


def _role(path: str) -> str:
    name = PurePosixPath(path).name
    if name.startswith("LICENSE"):
        return LICENCE
    return NOTE if name == "README.md" or path == MANIFEST else "data"


def _read_manifest(folder: Path) -> Mapping[str, Mapping[str, Any]]:
    """Rows of the manifest by path; empty where the folder has none."""
    place = folder / MANIFEST
    if not place.is_file():
        return {}
    manifest = msgspec.json.decode(place.read_bytes(), type=dict[str, Any])
    return {row["path"]: row for row in (*manifest["files"], *manifest["maps"])}


def _with_manifest(row: DataFile, entry: Mapping[str, Any] | None, known: Dataset) -> DataFile:
    """`row` with the facts of the manifest."""
    if entry is None:
        return row
    repository = known.source_url.removeprefix("https://github.com/")
    recipe = "copy"
    if row.path.endswith(".xz"):
        recipe = "xz"
    elif entry["kind"] == "path":
        recipe = "gzip" if entry["records"] == "all" else "radio_survey_gzip"
    return msgspec.structs.replace(
        row,
        role=entry.get("role", entry["kind"]),
        facts={key: entry[key] for key in (_FACTS if "role" in entry else _PLACE) if key in entry},
        url=f"https://raw.githubusercontent.com/{repository}/{known.commit}/{entry['source_path']}",
        source_blob=entry["source_git_blob"],
        recipe=recipe,
    )


def main() -> None:
    """Makes the table of the folder named on the command line and writes it beside the others."""
    parser = argparse.ArgumentParser(prog="python -m pdrbench_lab.dataset_table", description=__doc__)
    parser.add_argument("folder", type=Path, help="folder of the set, named like the set")
    parser.add_argument("--out", type=Path, help="file to write; the packaged table without it")
    arguments = parser.parse_args()
    folder = arguments.folder.resolve()
    out = arguments.out or TABLES / f"{folder.name}.json"
    known = read_table(out.read_bytes(), out.name) if out.exists() else None
    table = make_table(folder, known)
    write_table(table, out)
    print(f"{out}: {len(table.files)} files, {table.total_bytes / 1e6:.1f} MB", file=sys.stderr)  # noqa: T201


if __name__ == "__main__":
    main()
