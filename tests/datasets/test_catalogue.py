"""The registered tables: complete, typed, and free of forbidden content."""

from __future__ import annotations

import re
from collections import Counter
from importlib.resources import files
from pathlib import Path

import pytest

from pdrbench.datasets import dataset, datasets, verify
from pdrbench.datasets.catalogue import read_table
from pdrbench.errors import DatasetError, UnknownNameError

HEAD = b'"name":"x","summary":"","licence":"","licence_note":"","source_url":"","commit":"","citation":"",'
ROW = '{"path":"a","sha256":"","bytes":1,"role":"data"%s}'


def table(row: str) -> bytes:
    return b"{" + HEAD + b'"how_to_get":"","by_content":false,"files":[' + row.encode() + b"]}"


def test_every_set_are_registered_with_hashes_and_licences() -> None:
    assert sorted(datasets()) == [
        "foot_dual", "foot_loops", "foot_short", "foot_stride_gcp", "foot_stride_gcp_2", "foot_vicon", "foot_vicon_2",
        "ilc20", "ilc20_full", "ipin2023_track3", "kaggle_iln", "maps", "phone_steps", "wifi_fingerprints",
    ]  # fmt: skip
    for name, each in datasets().items():
        assert each.name == name
        assert each.summary and each.licence and each.licence_note and each.source_url and each.citation
        assert any(file.role == "licence" for file in each.files) or name == "kaggle_iln"  # users bring it
        assert all(re.fullmatch("[0-9a-f]{64}", file.sha256) for file in each.files)
        assert len({file.path for file in each.files}) == len(each.files)
        assert each.is_fetchable or each.how_to_get


def test_ilc20_carries_the_facts_that_environments_need() -> None:
    files_by_role = Counter(file.role for file in dataset("ilc20").files)
    assert files_by_role == {"train": 28, "eval": 33, "edge": 1, "radiomap": 62, "map": 18, "licence": 1, "note": 2}
    for file in dataset("ilc20").files:
        if file.role in ("train", "eval", "edge", "radiomap"):
            assert {"site", "floor", "recording_session", "tags", "n_waypoints"} <= set(file.facts)
            assert file.url.endswith(".txt") and len(file.source_blob) == 40 and file.content_sha256


def test_neither_walks_of_sealed_sets_nor_names_of_people_are_told() -> None:
    """A localizer can read the tables, so that counts or durations would tell it which walk it plays."""
    walks = [file for file in dataset("ilc20_full").files if file.role == "path"]
    assert len(walks) == 698
    assert all(set(file.facts) == {"site", "floor"} and file.recipe == "xz" for file in walks)
    subjects = {file.facts["subject"] for file in dataset("phone_steps").files if "subject" in file.facts}
    assert dataset("phone_steps").by_content and subjects == {"A", "B"}
    for file in dataset("phone_steps").files:
        assert file.role != "data" or re.fullmatch(r"data/[A-Z][a-z]+_[AB]_\w+/\w+\.csv\.gz", file.path)


@pytest.mark.data
@pytest.mark.parametrize("name", sorted(datasets()))
def test_the_registered_hashes_are_those_of_the_data(name: str, data_root: Path) -> None:
    if not (data_root / name).is_dir():
        pytest.skip(f"{name} is not under PDRBENCH_DATA")
    assert [problem for problem in verify(name, data_root / name) if not problem.is_harmless] == []


@pytest.mark.data
def test_no_name_of_a_person_is_in_a_table(data_root: Path) -> None:
    folders = (data_root / "phone_steps" / "data").iterdir()
    people = {folder.name.split("_")[1].encode().lower() for folder in folders}
    assert len(people) == 2
    for place in (files("pdrbench.datasets") / "tables").iterdir():
        assert not any(person in place.read_bytes().lower() for person in people), place.name


def test_an_unknown_field_and_an_unknown_set_are_refused_with_names() -> None:
    assert read_table(table(ROW % ""), "x.json").files[0].path == "a"
    with pytest.raises(DatasetError, match=r"x.json: .*unknown field `colour`.*pdrbench_lab.dataset_table"):
        read_table(table(ROW % ',"colour":"red"'), "x.json")
    with pytest.raises(UnknownNameError, match="no dataset named 'ilc2'; did you mean 'ilc20'"):
        dataset("ilc2")


@pytest.mark.parametrize("path", ["../a", "/etc/passwd", "a/../../b", "", "a\\\\b"])
def test_a_path_that_leaves_the_set_is_refused(path: str) -> None:
    with pytest.raises(DatasetError, match="a path inside the set was expected"):
        read_table(table((ROW % "").replace('"a"', f'"{path}"')), "x.json")


@pytest.mark.parametrize("text", [b"", b"{", b"\xff\xfe", b"[]"])
def test_a_file_that_is_no_table_is_refused(text: bytes) -> None:
    with pytest.raises(DatasetError, match=r"x.json: "):
        read_table(text, "x.json")
