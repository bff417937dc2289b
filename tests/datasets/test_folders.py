"""The folders that are searched for data, and the error where it is missing."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pdrbench.datasets import cache_folder, dataset, find, is_available
from pdrbench.errors import DatasetError


@pytest.fixture(autouse=True)
def no_data(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.delenv("PDRBENCH_DATA", raising=False)
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))


def put(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(b"")
    return path


def test_the_first_place_that_holds_the_set_wins_and_may_be_the_set_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    put(tmp_path / "b/ilc20/LICENSE")
    put(tmp_path / "c/ilc20/LICENSE")
    (tmp_path / "a/ilc20").mkdir(parents=True)  # empty: holds nothing
    places = [tmp_path / "absent", tmp_path / "a", tmp_path / "b", tmp_path / "c"]
    monkeypatch.setenv("PDRBENCH_DATA", os.pathsep.join(map(str, places)))
    assert find("ilc20") == tmp_path / "b/ilc20"
    assert is_available("ilc20") and not is_available("maps")
    data = next(file for file in dataset("foot_short").files if file.role == "data")
    put(tmp_path / "my copy" / data.path)
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path / "my copy"))
    assert find("foot_short") == tmp_path / "my copy"
    assert not is_available("foot_loops")


def test_the_cache_counts_once_it_is_whole(tmp_path: Path) -> None:
    required = [file for file in dataset("foot_short").files if file.is_required]
    for file in required:
        assert not is_available("foot_short")
        put(tmp_path / "cache/foot_short" / file.path)
    assert find("foot_short") == tmp_path / "cache/foot_short"


def test_an_absent_set_says_where_it_was_searched_and_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PDRBENCH_DATA", str(tmp_path))
    with pytest.raises(DatasetError) as caught:
        find("ilc20")
    for part in (str(tmp_path), str(tmp_path / "cache/ilc20"), "pdrbench data fetch ilc20", "PDRBENCH_DATA"):
        assert part in str(caught.value)
    with pytest.raises(DatasetError, match="cannot be fetched automatically: copy"):
        find("foot_loops")


def test_the_cache_follows_the_platform_unless_set(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    assert cache_folder() == tmp_path / "cache"
    monkeypatch.delenv("PDRBENCH_CACHE")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_folder() == tmp_path / "xdg/pdrbench"
    assert not (tmp_path / "xdg").exists()  # asking makes nothing
