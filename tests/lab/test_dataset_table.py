"""The maintainers' module that makes tables."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import msgspec
import pytest

from pdrbench.datasets import dataset, datasets
from pdrbench.datasets.catalogue import read_table
from pdrbench_lab.dataset_table import main, make_table, write_table


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    place = tmp_path / "walks"
    (place / "data").mkdir(parents=True)
    (place / "LICENSE.txt").write_text("MIT")
    (place / "README.md").write_text("words")
    (place / "data/a.csv").write_text("1")
    return place


def test_a_new_folder_gets_a_row_per_file_with_its_role(folder: Path) -> None:
    made = make_table(folder)
    assert made.name == "walks"
    assert {file.path: file.role for file in made.files} == {
        "LICENSE.txt": "licence",
        "README.md": "note",
        "data/a.csv": "data",
    }


def test_the_words_of_people_survive_a_refresh(folder: Path, tmp_path: Path) -> None:
    made = make_table(folder)
    rows = [msgspec.structs.replace(row, facts={"n": 1}, url="http://x") for row in made.files]
    known = msgspec.structs.replace(made, summary="walks of people", files=tuple(rows))
    (folder / "data/a.csv").write_text("22")
    (folder / "data/b.csv").write_text("3")
    again = make_table(folder, known)
    row = next(row for row in again.files if row.path == "data/a.csv")
    assert (again.summary, row.facts, row.url, row.bytes) == ("walks of people", {"n": 1}, "http://x", 2)
    assert {row.path for row in again.files} - {row.path for row in known.files} == {"data/b.csv"}


def test_a_set_registered_by_content_shows_no_name_of_its_files(folder: Path) -> None:
    known = msgspec.structs.replace(make_table(folder), by_content=True, files=())
    paths = [row.path for row in make_table(folder, known).files]
    assert paths[:2] == ["LICENSE.txt", "README.md"]
    assert paths[2].startswith("data/6b86b273ff34fce1") and paths[2].endswith(".csv")  # sha256 of "1"


def test_a_manifest_gives_facts_and_source(folder: Path) -> None:
    entry = {
        "path": "data/a.csv", "kind": "path", "role": "eval", "site": "s", "floor": "F1", "records": "all",
        "source_path": "d/a.txt", "source_git_blob": "0" * 40, "start_time_ms": 5, "length_m": 6.0,
    }  # fmt: skip
    (folder / "manifest.json").write_text(json.dumps({"files": [entry], "maps": []}))
    known = msgspec.structs.replace(make_table(folder), source_url="https://github.com/o/r", commit="c0ffee")
    row = next(row for row in make_table(folder, known).files if row.path == "data/a.csv")
    assert row.role == "eval" and row.recipe == "gzip"
    assert row.facts == {"site": "s", "floor": "F1", "records": "all"}
    assert row.url == "https://raw.githubusercontent.com/o/r/c0ffee/d/a.txt"


@pytest.mark.parametrize("name", sorted(datasets()))
def test_a_written_table_is_read_back_and_equals_the_packaged_one(name: str, tmp_path: Path) -> None:
    write_table(dataset(name), tmp_path / "t.json")
    assert read_table((tmp_path / "t.json").read_bytes(), "t.json") == dataset(name)


def test_the_command_makes_and_refreshes_a_table(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    out = tmp_path / "walks.json"
    monkeypatch.setattr(sys, "argv", ["table", str(folder), "--out", str(out)])
    main()
    out.write_text(out.read_text().replace('"licence": ""', '"licence": "MIT"'))
    main()
    assert read_table(out.read_bytes(), "walks.json").licence == "MIT"


def test_the_packaged_ilc20_table_is_that_of_its_folder(data_root: Path) -> None:
    assert make_table(data_root / "ilc20", dataset("ilc20")) == dataset("ilc20")
