"""A scratch folder is emptied of whatever a localizer left in it, and nothing else is touched."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from pdrbench_leaderboard.confine.scratch import empty

pytestmark = pytest.mark.confinement

DEPTH = 1_200  # deeper than the interpreter's recursion limit, and longer than a path may be


def test_a_tree_of_any_depth_is_removed(tmp_path: Path) -> None:
    before = Path.cwd()
    os.chdir(tmp_path)
    for _ in range(DEPTH):
        os.mkdir("a-long-name")  # noqa: PTH102
        os.chdir("a-long-name")
    os.chdir(before)
    empty(str(tmp_path))
    assert list(tmp_path.iterdir()) == []


def test_links_are_not_followed(tmp_path: Path) -> None:
    scratch, kept = tmp_path / "scratch", tmp_path / "kept"
    kept.mkdir(mode=0o750)
    (kept / "result").write_text("a result")
    (scratch / "deep").mkdir(parents=True)
    for place in (scratch, scratch / "deep"):
        (place / "folder").symlink_to(kept)
        (place / "file").symlink_to(kept / "result")
    empty(str(scratch))
    assert list(scratch.iterdir()) == []
    assert (kept / "result").read_text() == "a result"
    assert kept.stat().st_mode & 0o777 == 0o750


def test_folders_without_rights_go(tmp_path: Path) -> None:
    (tmp_path / "locked" / "inner").mkdir(parents=True)
    (tmp_path / "locked" / "inner" / "file").write_text("x")
    (tmp_path / "locked" / "inner").chmod(0)
    (tmp_path / "locked").chmod(0)
    empty(str(tmp_path))
    assert list(tmp_path.iterdir()) == []


def test_a_missing_folder_or_a_link_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / "file").write_text("x")
    (tmp_path / "link").symlink_to(tmp_path / "kept")
    empty(str(tmp_path / "nowhere"))
    empty(str(tmp_path / "link"))
    assert (tmp_path / "kept" / "file").exists()
