"""Tables and pages of a board that was played."""

from __future__ import annotations

import json
import re
import shutil
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from pdrbench.cli import main
from pdrbench_leaderboard import record, table
from pdrbench_leaderboard.boards import Board
from pdrbench_leaderboard.card import CARD_FILE, card_toml, read_card
from pdrbench_leaderboard.checking import check_board, separability
from pdrbench_leaderboard.record import DivisionRecord
from pdrbench_leaderboard.run import Settings
from pdrbench_leaderboard.score import QUANTILES
from pdrbench_leaderboard.site import write_site
from pdrbench_leaderboard.standings import Table, pooled, read_tables

EVIL = '<script>window.hit=1</script>"onmouseover="window.hit=2" \'><img src=x onerror="window.hit=3">`{{ 7*7 }}'
SHOWN = "[...document.querySelectorAll('tbody tr')].filter(row => row.offsetParent).map(row => row.cells[1].innerText)"
LAST_MOMENT = """(slider => { slider.value = slider.max; slider.dispatchEvent(new Event('input')); })(
    document.querySelector('.replay input'))"""


@pytest.fixture(scope="module")
def tables(played: Settings, toy_board: Board) -> list[Table]:
    return read_tables(played.root, toy_board)


@pytest.fixture
def root(played: Settings, tmp_path: Path) -> Path:
    """A copy of the folder of boards, to be changed."""
    return Path(shutil.copytree(played.root, tmp_path / "boards"))


@pytest.fixture(scope="module")
def site(tables: list[Table], toy_board: Board, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    write_site({toy_board: tables}, folder)
    return folder


def run_command(*arguments: str | Path) -> int:
    """The exit status of a command."""
    with pytest.raises(SystemExit) as stop:
        main(["leaderboard", *map(str, arguments)])
    assert isinstance(stop.value.code, int)
    return stop.value.code


def test_entries_are_in_their_order_with_columns_beside_the_score(tables: list[Table]) -> None:
    online, offline = tables
    assert [row.name for row in online.rows] == ["mine", "wanders", "lags", "stay"]
    assert online.ranking is not None and online.ranking.unranked == ("broken",)
    assert online.rows[0].standing.rank == (1, 1) and online.rows[-1].standing.rank == (4, 4)
    assert online.num_apart == online.num_pairs == 6
    assert [row.name for row in offline.rows] == ["lags"]
    assert online.agreement == (1.0, 1.0)
    mine, _, lags, stay = tables[0].rows
    assert mine.lost == 0.0 and stay.lost == lags.lost == 1.0
    assert mine.p75_m < mine.p95_m and mine.mean_m < lags.mean_m < stay.mean_m
    assert mine.standing.score_m == pytest.approx(mine.public_m, rel=0.2)


def test_pooled_quantiles_of_parts_are_those_of_all_moments() -> None:
    rng = np.random.default_rng(0)
    parts = [rng.gamma(2.0, 1.0, 4000), rng.gamma(2.0, 4.0, 1000)]
    records = [
        DivisionRecord(
            division="online",
            statuses="c",
            failures={},
            values={},
            moments=len(of),
            quantiles_m=tuple(np.quantile(of, QUANTILES).tolist()),
            begin=0,
        )
        for of in parts
    ]
    wanted = np.quantile(np.concatenate(parts), [0.75, 0.95])
    assert pooled(records, [0.75, 0.95]) == pytest.approx(wanted.tolist(), rel=0.02)


def test_the_table_says_what_was_found_and_is_checked(root: Path, toy_board: Board, tmp_path: Path) -> None:
    assert run_command("build", "--root", root, "--out", tmp_path / "site") == 0
    text = (root / "toy" / table.FILE_NAME).read_text()
    assert "| 1 | `mine` |" in text and "6 of 6 pairs are separated" in text
    assert "whose secret is published" in text
    assert all(found.passed for found in check_board(root, toy_board))
    (root / "toy" / table.FILE_NAME).write_text(text.replace("| 1 | `mine` |", "| 2 | `mine` |"))
    (wrong,) = [found for found in check_board(root, toy_board) if not found.passed]
    assert wrong.name == "toy/README.md" and "`mine`" in wrong.why


def test_scores_that_do_not_come_out_of_the_answers_are_found(root: Path, toy_board: Board) -> None:
    path = root / "toy" / "mine" / record.ENTRY_FILE
    plain = json.loads(path.read_text())
    for part in plain["parts"]:
        values = part["divisions"][0]["values"]
        values["p75_m"] = [value / 10 for value in values["p75_m"]]
    path.write_text(json.dumps(plain))
    wrong = [found for found in check_board(root, toy_board) if not found.passed and "README" not in found.name]
    assert wrong and all("p75_m of walk" in found.why for found in wrong)


def test_check_prints_how_much_a_board_tells(
    root: Path, toy_board: Board, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    run_command("build", "--root", root, "--out", tmp_path / "site")
    capfd.readouterr()
    assert run_command("check", "--root", root, "--json") == 0
    printed = json.loads(capfd.readouterr().out)
    assert printed["boards"] == [{"board": "toy", "entries": 4, "pairs": 6, "significant": 6}]
    assert {"name", "pass", "why"} == set(printed["checks"][0])


def test_boards_without_entries_say_so(toy_board: Board, tmp_path: Path) -> None:
    assert run_command("build", "--root", tmp_path / "none", "--out", tmp_path / "site") == 0
    assert "Nothing was played yet" in (tmp_path / "site" / "index.html").read_text()
    assert separability(toy_board, []).pairs == 0


class Tags(HTMLParser):
    """Every tag of a page with its attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


def test_every_link_leads_somewhere_and_nothing_is_fetched(site: Path) -> None:
    for page in site.glob("*.html"):
        for tag, attributes in Tags(page.read_text()).found:
            link = attributes.get("href" if tag in ("a", "link") else "src") or ""
            if link and not link.startswith(("#", "data:")):
                assert (page.parent / link).is_file(), f"{page}: {link}"


def test_a_board_has_its_picture_and_keeps_its_replays(
    site: Path, tables: list[Table], toy_board: Board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pdrbench_leaderboard.site._replay", None)
    write_site({toy_board: tables}, tmp_path)
    text = (tmp_path / "toy.html").read_text()
    assert text == (site / "toy.html").read_text()
    assert text.count('<svg class="order"') == 2 and text.count('class="replay"') == 3
    rows = json.loads((site / "toy.json").read_text())["rows"]
    assert [(row["division"], row["name"]) for row in rows][:2] == [("online", "mine"), ("online", "wanders")]
    track = json.loads(unescape(re.findall(r'data-track="([^"]*)"', text)[0]))
    assert len(track["real"]) == len(track["a"]) == len(track["t_s"])


def test_hostile_cards_are_text(root: Path, toy_board: Board, tmp_path: Path, browser: Any) -> None:
    path = root / "toy" / "mine" / CARD_FILE
    fields = dict.fromkeys(("licence", "training_data", "paper", "notes"), EVIL)
    path.write_bytes(card_toml(msgspec.structs.replace(read_card(path.read_bytes()), authors=(EVIL,), **fields)))
    write_site({toy_board: read_tables(root, toy_board)}, tmp_path / "site")
    for name in ("index.html", "toy.html"):
        browser.open(tmp_path / "site" / name)
        assert browser.run("window.hit === undefined && document.querySelectorAll('img').length === 0")
    assert browser.complaints() == []


def test_the_index_shows_what_is_possible_with_what_is_given(browser: Any, site: Path) -> None:
    browser.size(1200, 900)
    browser.open(site / "index.html")
    assert browser.run(SHOWN) == ["mine", "wanders", "lags", "stay"]
    browser.click("input[value=position]")
    assert browser.run(SHOWN) == ["stay"]
    browser.click("input[name=start]")
    assert browser.run(SHOWN) == []


def test_a_slider_moves_spots_along_the_tracks(browser: Any, site: Path) -> None:
    browser.open(site / "toy.html")
    place = "document.querySelector('.replay .spot.a').getAttribute('cx')"
    before = browser.run(place)
    browser.run(LAST_MOMENT)
    assert float(browser.run(place)) != float(before)


@pytest.mark.parametrize("name", ["index.html", "toy.html"])
def test_pages_fit_a_phone_in_light_and_dark(browser: Any, site: Path, name: str) -> None:
    browser.size(390, 844, mobile=True)
    colours = []
    for scheme in ("light", "dark"):
        browser.media(prefers_color_scheme=scheme)
        browser.open(site / name)
        assert browser.run("document.documentElement.scrollWidth") <= 390
        colours.append(browser.run("getComputedStyle(document.body).backgroundColor"))
        cell = "document.querySelector('tbody .number').getBoundingClientRect().right"
        assert browser.run(cell) <= 390  # rank, name and score
    assert colours[0] != colours[1]
    browser.size(1280, 900)
    browser.media(prefers_color_scheme="light")
