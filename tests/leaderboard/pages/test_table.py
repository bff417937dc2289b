"""TABLE.md: its content, and that submitted text cannot change its markup."""

from __future__ import annotations

import re
from typing import Any

import pytest

from pdrbench.errors import BundleError
from pdrbench.task import no_survey
from pdrbench_leaderboard import collection, table
from pdrbench_leaderboard.plausibility import Finding
from pdrbench_leaderboard.ranking import Board


def cells(text: str) -> dict[str, list[str]]:
    """Cells of each row by name of the entry."""
    rows = [line for line in text.splitlines() if line.startswith("| ")][2:]
    split = [[cell.strip() for cell in re.split(r"(?<!\\)\|", row)[1:-1]] for row in rows]
    return {row[1].strip("`"): row for row in split}


def test_every_entry_has_a_row_in_order_with_its_facts(five: Board) -> None:
    text = table.table(five)
    rows = cells(text)
    assert list(rows) == ["smooth", "near", "far", "alike", "choosy"]
    assert rows["near"][-5:] == ["verified", "online", "stride", "yes", "no"]
    assert rows["far"][-5:] == ["verified", "online", "stride, wifi", "no", "yes"]
    assert rows["smooth"][0] == "o1" and rows["smooth"][-4] == "offline"
    assert rows["choosy"][0] == "–" and "`choosy` is not ranked: declined 6 of 12 walks." in text


def test_values_have_intervals_and_distances_to_the_first_of_the_division(five: Board) -> None:
    rows = cells(table.table(five))
    assert re.fullmatch(r"1\.00 \(0\.9\d–1\.0\d\)", rows["near"][2])
    assert rows["near"][3] == rows["near"][2] and rows["choosy"][2] == table.NOTHING != rows["choosy"][3]
    assert rows["near"][5] == rows["smooth"][5] == table.NOTHING
    behind = re.fullmatch(r"(\d\.\d\d) \((\d\.\d\d)–(\d\.\d\d)\)", rows["far"][5])
    assert behind is not None
    effect, low, high = map(float, behind.groups())
    assert low < effect < high and effect == 8.0
    assert rows["near"][6] == "2, 3" and rows["far"][6] == table.NOTHING


def test_below_four_units_there_are_no_intervals(world: Any) -> None:
    text = table.table(world.board(world.entry("one-v0", [1.0] * 3), world.entry("two-v0", [2.0] * 3)))
    assert cells(text)["two-v0"][2:6] == ["2.00", "2.00", "0.00", "1.00"]
    assert "No intervals: 3 walks, and fewer than 4 are too few for any." in text


def test_the_same_entries_in_any_order_give_the_same_bytes(world: Any) -> None:
    entries = [world.entry(f"e{i}-v0", [1.0 + i, 2.0, *[1.5 * i] * 10]) for i in range(4)]
    assert table.table(world.board(*entries)) == table.table(world.board(*reversed(entries)))


def test_text_of_submitters_stays_text(world: Any) -> None:
    nasty = "a|b\n| x | [y](http://z) <script>"
    assert table.plain(nasty) == r"a\|b \| x \| \[y\](http://z) \<script\>"
    named = world.entry(nasty.replace("\n", " "), [1.0] * 12, {"sensors_used": (nasty, "stride")})
    (row,) = cells(table.table(world.board(named))).values()
    assert len(row) == 16 and row[-3] == "stride"


def test_sensors_missing_in_an_environment_are_not_used_there(make_world: Any) -> None:
    card = {"sensors_used": ("accel", "stride"), "map_used": True, "survey_used": True}
    world = make_world(None, radio_map=no_survey)
    (row,) = cells(table.table(world.board(world.entry("one-v0", [1.0] * 12, card)))).values()
    assert row[-3:] == ["stride", "no", "no"]


def test_changed_estimates_a_new_or_a_lost_entry_are_found(folder: Any, world: Any) -> None:
    collection.write_tables(collection.read_boards(folder.root)[0], folder.root)
    folder.entries["Corridor-v0/far"] = world.entry("far", [2.0] * 11 + [2.5])
    assert "`far`" in folder.check()["Corridor-v0/TABLE.md"]
    del folder.entries["Corridor-v0/far"]
    assert "Corridor-v0/TABLE.md" in folder.check()
    (folder.root / "Corridor-v0" / "TABLE.md").unlink()
    assert folder.check()["Corridor-v0/TABLE.md"].startswith("it is missing")


def test_a_damaged_entry_is_named_and_the_others_are_still_looked_at(folder: Any) -> None:
    folder.entries["Corridor-v0/far"] = BundleError("estimates.bin is not what was packed")
    assert folder.check() == {"Corridor-v0/far": "estimates.bin is not what was packed"}
    names = [check.name for check in collection.check_boards(folder.root)]
    assert names == ["Corridor-v0/far", "Corridor-v0/near"]
    with pytest.raises(BundleError, match="not what was packed"):
        collection.read_boards(folder.root)


def test_a_broken_rule_fails_and_a_flag_does_not(folder: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    collection.write_tables(collection.read_boards(folder.root)[0], folder.root)
    flag = Finding("can be run again", False, "only its authors can", is_flag=True)
    rule = Finding("every walk and seed", False, "lacks walk-03")
    found = {"near": [flag], "far": [flag, rule]}
    monkeypatch.setattr(collection, "rules", lambda entry: found[entry.localizer])
    assert folder.check() == {"Corridor-v0/far": "every walk and seed: lacks walk-03"}
    del found["far"][1]
    assert folder.check() == {}
