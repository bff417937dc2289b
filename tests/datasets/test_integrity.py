"""`verify` on a folder."""

from __future__ import annotations

import gzip
from pathlib import Path

import msgspec
import pytest

from pdrbench.datasets import Dataset, integrity, verify
from pdrbench.datasets.download import fetch_into


@pytest.fixture
def folder(small: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The small set as registered, whole."""
    monkeypatch.setattr(integrity, "registered", lambda name: small)
    return fetch_into(small, tmp_path / "small").folder


def problems(folder: Path) -> dict[str, str]:
    return {problem.path: problem.kind for problem in verify("small", folder)}


def test_a_whole_set_has_no_problem_with_or_without_its_notes(folder: Path) -> None:
    assert problems(folder) == {}
    (folder / "README.md").write_bytes(b"words")
    assert problems(folder) == {}


def test_missing_differing_and_extra_files_are_listed(folder: Path) -> None:
    (folder / "LICENSE").unlink()
    (folder / "map.json").write_bytes(b"[]")
    (folder / "README.md").write_bytes(b"other words")
    (folder / "floor/more.txt").write_bytes(b"")
    (folder / integrity.PARTIAL_FOLDER).mkdir()
    (folder / integrity.PARTIAL_FOLDER / "x.part").write_bytes(b"")  # a fetch that has not ended is no problem
    assert problems(folder) == {
        "LICENSE": "missing",
        "map.json": "differs",
        "README.md": "differs",
        "floor/more.txt": "extra",
    }


def test_a_damaged_gzip_file_differs(folder: Path) -> None:
    walk = folder / "floor/walk.txt.gz"
    whole = walk.read_bytes()
    for damaged in (b"", whole[:-10], whole[:500] + b"\0\0\0\0" + whole[504:], b"no gzip"):
        walk.write_bytes(damaged)
        assert problems(folder) == {"floor/walk.txt.gz": "differs"}


def test_the_same_content_in_another_wrapping_is_reported_and_harmless(folder: Path) -> None:
    walk = folder / "floor/walk.txt.gz"
    walk.write_bytes(gzip.compress(gzip.decompress(walk.read_bytes()), 1))
    (problem,) = verify("small", folder)
    assert problem.kind == "recompressed" and problem.is_harmless


def test_files_registered_by_content_are_found_under_any_name(
    folder: Path, small: Dataset, monkeypatch: pytest.MonkeyPatch
) -> None:
    unnamed = msgspec.structs.replace(small, by_content=True)
    monkeypatch.setattr(integrity, "registered", lambda name: unnamed)
    (folder / "floor").rename(folder / "elsewhere")
    assert problems(folder) == {}
    walk = folder / "elsewhere/walk.txt.gz"
    walk.write_bytes(gzip.compress(gzip.decompress(walk.read_bytes()), 1))
    (folder / "map.json").write_bytes(b"[]")
    assert problems(folder) == {"elsewhere/walk.txt.gz": "recompressed", "map.json": "missing"}
