"""The files of the site: required and forbidden content, and cards with hostile text."""

from __future__ import annotations

import csv
import dataclasses
import gzip
import io
import json
import re
import threading
import urllib.request
import zipfile
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from pdrbench.errors import ResultError
from pdrbench.registry import localizers
from pdrbench_leaderboard import downloads, overview, page_data, site
from pdrbench_leaderboard.leaderboard_command import make_server
from pdrbench_leaderboard.plausibility import Finding
from pdrbench_leaderboard.ranking import RANKING, Board
from pdrbench_leaderboard.site import write_site

EVIL = '<script>alert(1)</script>"onmouseover="alert(2)" \'><img src=x onerror=alert(3)>`{{ 7*7 }}'


def evil_card(card: Any, **changes: Any) -> Any:
    """A card with markup in every field, past its own checks."""
    fields = dict.fromkeys(("licence", "training_data", "contact", "paper", "notes"), EVIL)
    return msgspec.structs.replace(
        card, **(fields | {"authors": (EVIL, EVIL), "sensors_used": (EVIL,), "url": "javascript:alert(4)"} | changes)
    )


class Tags(HTMLParser):
    """Every tag of a page with its attributes."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))


def content_of(path: Path) -> str:
    """The text of a file, that of a compressed one unpacked."""
    content = path.read_bytes()
    return (gzip.decompress(content) if path.suffix == ".gz" else content).decode()


def received(path: Path) -> Any:
    """The data of a page's numbers file."""
    match = re.fullmatch(r'pdrbench\.receive\("[^"]+",(.*)\);\n', path.read_text(), re.S)
    assert match is not None, path
    return json.loads(match[1])


def test_every_page_is_there_and_every_link_leads_somewhere(five: Board, tmp_path: Path) -> None:
    written = write_site([five], tmp_path)
    assert tmp_path / "index.html" in written and all(path.is_file() for path in written)
    pages = [path for path in written if path.suffix == ".html"]
    assert len(pages) == 1 + 1 + 5 + 2 + 5  # index, suite, localizers, board and comparison, entries
    for page in pages:
        for tag, attributes in Tags(page.read_text()).found:
            link = attributes.get("href" if tag in ("a", "link") else "src") or ""
            if not link or link.startswith(("#", "data:")):
                continue
            assert (page.parent / link.partition("?")[0]).is_file(), f"{page}: {link}"


def test_costly_files_are_made_again_where_something_has_changed(
    five: Board, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []
    plain = downloads.estimates_csv
    monkeypatch.setattr(downloads, "estimates_csv", lambda of: (made.append(of.name), plain(of))[1])
    written = {path: path.read_bytes() for path in write_site([five], tmp_path)}
    assert len(made) == len(five) == 5
    assert {path: path.read_bytes() for path in write_site([five], tmp_path)} == written
    assert len(made) == 5
    damaged = next(path for path in written if path.suffix == ".gz")
    damaged.write_bytes(b"damaged")
    one = five.standings[0]
    results = one.entry.results
    moved = dataclasses.replace(results[0].estimates, xy_m=results[0].estimates.xy_m + 1.0)
    entry = dataclasses.replace(one.entry, results=(dataclasses.replace(results[0], estimates=moved), *results[1:]))
    standings = (dataclasses.replace(one, entry=entry), *five.standings[1:])
    write_site([dataclasses.replace(five, standings=standings)], tmp_path)
    assert sorted(set(made[5:])) == sorted({one.name, damaged.name.removesuffix(".csv.gz")})
    assert damaged.read_bytes() == written[damaged] or damaged.name.startswith(one.name)


def test_no_page_speaks_of_another_host(built: Path) -> None:
    files = [path for path in built.rglob("*") if path.is_file()]
    assert len(files) > 20
    for path in files:
        hosts = set(re.findall(r"(?:https?:)?//[a-z0-9.-]+\.[a-z]{2,}", content_of(path)))
        assert hosts <= {"http://www.w3.org"}, path  # the name space of SVG is no address


def test_a_hostile_card_stays_text(world: Any, tmp_path: Path) -> None:
    entry = world.entry("one-v0", [1.0] * 12)
    object.__setattr__(entry, "card", evil_card(entry.card))
    for path in write_site([world.board(entry)], tmp_path):
        if path.suffix != ".html":
            continue
        text = path.read_text()
        assert "alert" not in text or "&lt;script&gt;alert(1)" in text
        for tag, attributes in Tags(text).found:
            assert tag not in ("img", "iframe", "object", "base"), path
            assert not [name for name in attributes if name.startswith("on")], path
            assert tag != "script" or attributes.get("src") or attributes.get("type") == "application/json"
            assert not (attributes.get("href") or "").startswith("javascript"), path
        assert "49" not in re.sub(r"[0-9.]*49[0-9.]+|[0-9.]+49", "", text.split("<h2")[0])  # no template ran in it


def test_addresses_are_links_only_where_they_lead_to_the_web(world: Any, tmp_path: Path) -> None:
    entry = world.entry("one-v0", [1.0] * 12, {"url": "https://example.org/a?b=1&c=2"})
    write_site([world.board(entry)], tmp_path)
    page = (tmp_path / "Corridor-v0" / "entries" / "one-v0.html").read_text()
    links = [
        attributes for tag, attributes in Tags(page).found if tag == "a" and "example" in (attributes["href"] or "")
    ]
    assert [link["href"] for link in links] == ["https://example.org/a?b=1&c=2"]
    assert "noopener" in (links[0]["rel"] or "")


def test_no_address_is_published(world: Any, tmp_path: Path) -> None:
    entry = world.entry("one-v0", [1.0] * 12, {"contact": "me@example.org"})
    assert not [path for path in write_site([world.board(entry)], tmp_path) if "me@example" in content_of(path)]


def test_flags_and_what_a_maintainer_found_are_shown(
    world: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flag = Finding("Corridor-v0: keeps moving", False, "90% of walks <stand> still", is_flag=True)
    monkeypatch.setattr(site, "flags_of", lambda _: [flag, Finding("fine", True, "", is_flag=True)])
    entry = world.entry("one-v0", [1.0] * 12)
    values = {RANKING: (1.0, 1.5, 1.0, 1.5)}
    held_out = msgspec.structs.replace(entry.verification.held_out, values=values, units=(0, 1, 2, 3), statuses="cccf")
    verification = msgspec.structs.replace(entry.verification, held_out=held_out)
    write_site([world.board(dataclasses.replace(entry, verification=verification))], tmp_path)
    page = (tmp_path / "Corridor-v0" / "entries" / "one-v0.html").read_text()
    assert "keeps moving: 90% of walks &lt;stand&gt; still" in page and "<li>fine" not in page
    assert "12 of 12 runs came to the same" in page and f"<code>{'0' * 16}</code>" in page
    assert re.search(r"1\.25 \(0\.\d\d–1\.\d\d\) m over 4 walks, \+0\.25 to the public ones", page)
    assert "1 run failed" in page and "1.00 (1.00–1.00) m on public ones" in page


def test_truth_is_published_for_generated_walks_only(make_world: Any, office: Any, tmp_path: Path) -> None:
    for dataset in (None, "ilc20"):
        world = make_world(office, dataset=dataset)
        board = world.board(world.entry("one-v0", [1.0] * 12))
        write_site([board], tmp_path)
        plans = received(tmp_path / "Corridor-v0" / "plans.js")
        assert {"reference" in walk for walk in plans["walks"].values()} == {dataset is None}
        text = (tmp_path / "Corridor-v0" / "entries" / "one-v0.html").read_text()
        assert ("its test walks stay a test" in text) == (dataset is not None)
    # the true position is 1 m beside the estimate, and is in none of the fetched files
    y_m = world.recording("walk-00").reference.xy_m[0, 1]
    tracks = received(tmp_path / "Corridor-v0" / "entries" / "one-v0.tracks.js")
    assert set(tracks["walk-00"]["y_m"]) == {round(y_m + 1, 2)}
    assert set(received(tmp_path / "Corridor-v0" / "entries" / "one-v0.js")) == {"name", "cdf", "walks"}


def test_numbers_of_an_entry_are_those_of_its_scores(five: Board, built: Path) -> None:
    data = received(built / "Corridor-v0" / "entries" / "near.js")
    shown = [walk["values"][RANKING] for walk in data["walks"]]
    np.testing.assert_allclose(shown, five.values["near"], atol=1e-6)
    cdf = data["cdf"]
    assert cdf["share"] == sorted(cdf["share"]) and len(cdf["low"]) == len(cdf["share"]) == len(cdf["error_m"])
    assert all(low <= share <= high for low, share, high in zip(cdf["low"], cdf["share"], cdf["high"], strict=True))
    below_m = np.concatenate([scored.errors_m for scored in five.standings[1].scored])
    at = len(cdf["share"]) // 2
    assert cdf["share"][at] == pytest.approx(np.mean(below_m <= cdf["error_m"][at] + 1e-4), abs=0.02)
    declined = received(built / "Corridor-v0" / "entries" / "choosy.js")["walks"]
    assert [walk["values"][RANKING] is None for walk in declined] == [False] * 6 + [True] * 6
    pairs = received(built / "Corridor-v0" / "pairs.js")
    assert len(pairs["rows"]) == len(five.pairs)


def test_floor_plans_have_every_level_and_wall(five: Board, office: Any) -> None:
    plans = page_data.plans_data(five)
    (plan,) = plans["buildings"].values()
    assert [level["level"] for level in plan["levels"]] == list(office.levels)
    walls = sum(len(level["walls"]) // 4 for level in plan["levels"])
    assert walls == int((office.edge_neighbour == -1).sum())
    assert all(level["floor"] for level in plan["levels"])


def test_downloads_hold_what_the_table_shows(five: Board, built: Path) -> None:
    board = json.loads((built / "Corridor-v0" / "board.json").read_text())
    assert [entry["localizer"] for entry in board["entries"]] == [standing.name for standing in five.standings]
    assert board["entries"][1]["ahead_of"] == ["far", "alike"] and board["entries"][1]["rank"] == 1
    assert board["entries"][1]["metrics"][RANKING]["value"] == pytest.approx(1.0)
    rows = list(csv.DictReader(io.StringIO((built / "Corridor-v0" / "board.csv").read_text())))
    assert [row["localizer"] for row in rows] == [standing.name for standing in five.standings]
    assert rows[-1]["rank"] == "" and rows[0]["division"] == "offline"
    assert float(rows[1][RANKING]) == pytest.approx(1.0) and rows[2]["sensors"] == "stride wifi"


def test_every_estimate_can_be_downloaded(five: Board, built: Path) -> None:
    text = content_of(built / "Corridor-v0" / "entries" / "near.csv.gz")
    rows = list(csv.DictReader(io.StringIO(text)))
    (standing,) = [standing for standing in five.standings if standing.name == "near"]
    assert len(rows) == sum(len(result.estimates) for result in standing.entry.results)
    first = standing.entry.results[0]
    assert rows[0]["walk"] == first.walk and rows[0]["sigma_m"] == "" and float(rows[3]["t_s"]) == 3.0
    assert float(rows[3]["y_m"]) == pytest.approx(first.estimates.xy_m[3, 1], abs=1e-9)
    names = [path.name for path in (built / "localizers").iterdir()]
    assert not [name for name in names if name.endswith(".zip")]  # the source of a stranger's file is not here


def test_the_source_of_our_own_localizers_can_be_downloaded() -> None:
    content = overview.source_archive("koeping2012")
    assert content is not None and content == overview.source_archive("koeping2012")  # the same bytes
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        names = archive.namelist()
        sources = [archive.read(name).decode() for name in names]
    assert names and all(name.startswith("pdrbench_baselines/") for name in names)
    target = localizers()["koeping2012"].target.partition(":")[2]
    assert any(f"class {target}" in source for source in sources)
    assert overview.source_archive("file.py:Mine") is None and overview.source_archive("nobody") is None


def test_a_suite_shows_every_localizer_on_every_environment(built: Path) -> None:
    page = (built / "suites" / "corridors-v1.html").read_text()
    cells = re.findall(r'<td class="rank" style="--ahead:([0-9.]+)"><a href="../(\S+)" aria-label="([^"]+)"', page)
    assert [float(ahead) for ahead, _, _ in cells] == [0.0, 0.0, 0.5, 1.0]
    assert [label for _, _, label in cells] == [
        "near on Corridor-v0: rank 1 of 3",
        "smooth on Corridor-v0: rank o1 of 1",
        "far on Corridor-v0: rank 2 of 3",
        "alike on Corridor-v0: rank 3 of 3",
    ]
    assert page.index("alike") < page.index("choosy") and "not ranked: declined 6 of 12 walks" in page
    page = (built / "localizers" / "near.html").read_text()
    assert "1 of 3" in page and "1.00" in page and "../Corridor-v0/entries/near.html" in page


def test_the_index_names_the_best_of_each_division(built: Path) -> None:
    cells = re.findall(
        r"<td><a href=\"localizers/(\S+)\.html\">\1</a><span class=\"under\">(\S+)",
        (built / "index.html").read_text(),
    )
    assert cells == [("near", "1.00"), ("smooth", "0.50")]


def test_no_cell_is_a_formula(world: Any, tmp_path: Path) -> None:
    write_site([world.board(world.entry("=1+1", [1.0] * 12))], tmp_path)
    (row,) = csv.DictReader(io.StringIO((tmp_path / "Corridor-v0" / "board.csv").read_text()))
    assert row["localizer"] == "'=1+1"


def test_names_that_differ_in_case_alone_have_files_of_their_own(world: Any, tmp_path: Path) -> None:
    names = ("A/../b", "a/../B", "..")
    write_site([world.board(*(world.entry(name, [1.0 + i] * 12) for i, name in enumerate(names)))], tmp_path)
    pages = sorted(path.name for path in (tmp_path / "Corridor-v0" / "entries").glob("*.html"))
    assert len({page.lower() for page in pages}) == 3
    assert not list(tmp_path.glob("*.js"))


def test_the_server_shows_the_site_to_this_machine_alone(five: Board, tmp_path: Path) -> None:
    with pytest.raises(ResultError, match="no site in"):
        make_server(tmp_path, 0)
    write_site([five], tmp_path)
    with make_server(tmp_path, 0) as server:
        assert server.server_address[0] == "127.0.0.1"
        threading.Thread(target=server.serve_forever, daemon=True).start()
        with urllib.request.urlopen(f"http://127.0.0.1:{server.server_port}/Corridor-v0/index.html") as answer:
            assert b"near" in answer.read()
        with pytest.raises(ResultError, match=r"cannot listen on port .*--port"):
            make_server(tmp_path, server.server_port)
        server.shutdown()


def test_a_board_without_ranked_entries_has_pages_too(world: Any, tmp_path: Path) -> None:
    some, none = [1.0] * 3 + [np.nan] * 9, [np.nan] * 12
    board = world.board(world.entry("some-v0", some), world.entry("none-v0", none))
    assert board.ranked == () and board.pairs == {} and not board.is_too_small
    write_site([board], tmp_path)
    assert "declined 12 of 12 walks" in (tmp_path / "Corridor-v0" / "entries" / "none-v0.html").read_text()
    assert received(tmp_path / "Corridor-v0" / "entries" / "none-v0.js")["cdf"]["error_m"] == []
    assert "<td>–</td>" in (tmp_path / "index.html").read_text()
