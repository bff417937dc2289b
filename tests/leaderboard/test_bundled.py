"""The leaderboards of the repository: entries read, scores recompute from the estimates, tables are those built."""

from __future__ import annotations

from pathlib import Path

import pytest

from pdrbench.errors import DatasetError
from pdrbench_leaderboard.checking import check, rules
from pdrbench_leaderboard.collection import check_boards
from pdrbench_leaderboard.entry import list_entries, read_entry

ROOT = Path(__file__).resolve().parents[2] / "leaderboards"
SMALLEST = {
    folder.parent.name: folder
    for folder in sorted(list_entries(ROOT), key=lambda folder: -(folder / "estimates.bin").stat().st_size)
}

pytestmark = pytest.mark.skipif(not ROOT.is_dir(), reason="leaderboards are not part of a wheel")


@pytest.mark.parametrize("env", sorted(SMALLEST))
def test_every_entry_reads_and_keeps_the_rules(env: str) -> None:
    for folder in list_entries(ROOT):
        if folder.parent.name != env:
            continue
        try:
            found = rules(read_entry(folder))
        except DatasetError as error:
            pytest.skip(str(error))
        assert found and [rule for rule in found if not (rule.passed or rule.is_flag)] == [], folder.name


@pytest.mark.parametrize(
    "env", ["BuildingSiteDrift-v1", pytest.param("PhoneHandling-v1", marks=pytest.mark.long(seconds=3))]
)
def test_scores_of_an_entry_recompute(env: str) -> None:
    checked = check(SMALLEST[env])
    assert checked.passed and len(checked.entries) == 1, checked.findings


@pytest.mark.long(seconds=60)
def test_every_entry_and_every_table_passes(data_root: Path) -> None:
    findings = list(check_boards(ROOT))
    assert len(findings) > len(list_entries(ROOT))
    assert [finding for finding in findings if not (finding.passed or finding.is_flag)] == []
