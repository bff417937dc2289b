"""The page "Submit in ten minutes" works: every block, in order, in an empty folder."""

from __future__ import annotations

from pathlib import Path

import pytest

from pdrbench_leaderboard.entry import read_entry

from .documented import follow

PAGE = Path(__file__).resolve().parents[2] / "docs" / "submit.md"

pytestmark = pytest.mark.skipif(not PAGE.is_file(), reason="documentation is not part of a wheel")


@pytest.mark.long(seconds=60)
@pytest.mark.timeout(900)
def test_from_a_class_to_a_row(tmp_path: Path) -> None:
    """A folder outside the repository, with nothing but what the page writes there."""
    folder = tmp_path / "empty"
    folder.mkdir()
    assert follow(PAGE, folder, tmp_path / "bin") == 4
    entry = folder / "leaderboards" / "OfficeStride-v2" / "mine-v0"
    assert read_entry(entry).tier == "reproduced"
    assert "mine-v0" in (entry.parent / "TABLE.md").read_text()
    assert (folder / "site" / "index.html").is_file()
