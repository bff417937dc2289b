"""The pages in headless Chromium: sorting, filters, comparison, replay, keyboard, themes, phones, many entries."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pdrbench_leaderboard.site import write_site

NAMES = """[...document.querySelectorAll('#board tbody tr')].filter(row => !row.hidden)
    .map(row => row.cells[2].querySelector('a').textContent)"""
SORT = """Object.fromEntries([...document.querySelectorAll('th[aria-sort]')]
    .map(head => [head.cellIndex, head.getAttribute('aria-sort')]))"""
FOCUS = """(here => here.id || here.textContent || here.getAttribute('aria-label'))(document.activeElement)"""
OUTLINE = """(style => style.outlineStyle + ' ' + style.outlineWidth)(getComputedStyle(document.activeElement))"""
BOX = """(box => [box.x, box.y, box.width, box.height])(document.querySelector('#cdf svg').getBoundingClientRect())"""
NAMELESS = """[...document.querySelectorAll('button, a, select, input, [role=region]')]
    .filter(e => !(e.textContent.trim() || e.getAttribute('aria-label') || (e.labels && e.labels.length)))
    .map(e => e.outerHTML)"""
LOOSE_TABLES = "[...document.querySelectorAll('table')].filter(table => !table.closest('.scroll')).length"
CHOOSE = """(() => {
    const field = document.querySelector(%s);
    field.value = %s;
    for (const kind of ['input', 'change']) field.dispatchEvent(new Event(kind, {bubbles: true}));
})()"""


@pytest.fixture
def site(built: Path) -> Path:
    return built / "Corridor-v0"


@pytest.fixture(autouse=True)
def as_found(browser: Any) -> Iterator[None]:
    """Every test begins with the same window, and ends without a complaint from the console."""
    browser.size(1280, 900)
    browser.media(prefers_color_scheme="light", prefers_reduced_motion="no-preference")
    yield
    assert browser.complaints() == []
    assert [url for url in browser.asked_for() if not url.startswith(("file:", "data:"))] == []


def choose(page: Any, selector: str, value: str) -> None:
    """As a reader chooses from a list."""
    page.run(CHOOSE % (json.dumps(selector), json.dumps(value)))


def test_sorts_by_mouse_and_says_so(browser: Any, site: Path) -> None:
    browser.open(site / "index.html")
    ranked = ["smooth", "near", "far", "alike", "choosy"]
    assert browser.run(NAMES) == ranked and browser.run(SORT) == {"1": "ascending"}
    browser.click("#board thead th:nth-child(3) button")
    assert browser.run(NAMES) == sorted(ranked) and browser.run(SORT) == {"2": "ascending"}
    browser.click("#board thead th:nth-child(3) button")
    assert browser.run(NAMES) == sorted(ranked, reverse=True) and browser.run(SORT) == {"2": "descending"}
    browser.click("#board thead th:nth-child(4) button")
    assert browser.run(NAMES) == ranked  # by held-out score; what has none comes last
    for wanted in (ranked, ranked[::-1]):  # by public score, where declined walks count as the worst answer
        browser.click("#board thead th:nth-child(6) button")
        assert browser.run(NAMES) == wanted


def test_sorts_filters_and_opens_by_keyboard_alone(browser: Any, site: Path) -> None:
    browser.open(site / "index.html")
    browser.key("Tab")
    assert browser.run(FOCUS) == "Skip to the content"
    browser.key("Enter")
    seen = []
    while len(seen) < 30 and browser.run(FOCUS) != "localizer":
        browser.key("Tab")
        seen.append(browser.run(FOCUS))
        if seen[-1] == "text":
            browser.type("author")
    assert "text" in seen and browser.run(FOCUS) == "localizer"
    assert browser.run(OUTLINE) == "solid 3px"  # keyboard focus is visible
    browser.key("Enter")
    browser.key(" ")
    assert browser.run(SORT) == {"2": "descending"} and browser.run(NAMES)[0] == "smooth"
    browser.run("document.querySelector('#board tbody a').focus()")
    browser.key("Enter")
    browser.wait("document.querySelector('h1') && document.querySelector('h1').textContent === 'smooth'")


def test_filters_by_sensor_map_survey_tier_division_and_text(browser: Any, site: Path) -> None:
    browser.open(site / "index.html")
    browser.click("input[value=wifi]")
    assert browser.run(NAMES) == ["smooth", "near", "choosy"]
    assert browser.run("document.getElementById('count').textContent") == "3 of 5 entries"
    assert browser.run("document.getElementById('count').getAttribute('role')") == "status"
    browser.click("#filters button[type=reset]")
    browser.wait(f"({NAMES}).length === 5")
    for selector, value, wanted in (
        ("#map", "yes", ["near"]),
        ("#survey", "yes", ["far"]),
        ("#tier", "self-reported", ["choosy"]),
        ("#division", "offline", ["smooth"]),
        ("#text", "ALIKE author", ["alike"]),
        ("#text", "missing", []),
    ):
        choose(browser, selector, value)
        assert browser.run(NAMES) == wanted, selector
        choose(browser, selector, "")
    assert len(browser.run(NAMES)) == 5


def test_two_entries_are_chosen_and_compared(browser: Any, site: Path) -> None:
    browser.open(site / "index.html")
    for name in ("far", "near", "alike"):
        browser.click(f".pick[value={name}]")
    ticked = "[...document.querySelectorAll('.pick:checked')].map(b => b.value)"
    assert browser.run(ticked) == ["near", "alike"]  # a third takes the place of the first
    browser.click("#compare")
    browser.wait("document.querySelector('#tiles .tile')")
    assert browser.run("[a.value, b.value]") == ["near", "alike"]
    assert browser.run("verdict.textContent") == "near is better, and significantly so."
    tiles = browser.run("[...document.querySelectorAll('#tiles dd b')].map(b => b.textContent)")
    assert tiles[0] == "−8.00 m" and tiles[3] == "100 %"
    assert browser.run("document.querySelectorAll('#scatter circle').length") == 12
    assert browser.run("document.querySelectorAll('#difference rect').length") == 12
    assert browser.run("document.querySelectorAll('#cdf path.line').length") == 2
    browser.click("#swap")
    browser.wait("document.querySelector('#tiles dd b').textContent === '8.00 m'")
    assert browser.run("verdict.textContent") == "near is better, and significantly so."
    assert "a=alike&b=near" in browser.run("location.search")
    choose(browser, "#b", "far")
    browser.wait("verdict.textContent.startsWith('No significant difference: far has the better mean')")
    choose(browser, "#b", "choosy")
    browser.wait("verdict.textContent.includes('not tested')")
    assert browser.run("document.querySelectorAll('#scatter circle').length") == 6
    choose(browser, "#b", "alike")
    browser.wait("verdict.textContent === 'Choose two different entries.'")


def test_an_entry_shows_its_card_distribution_and_walks(browser: Any, site: Path) -> None:
    browser.open(site / "entries" / "near.html")
    browser.wait("document.querySelector('#cdf path.line')")
    assert browser.run("document.querySelectorAll('#cdf path.band').length") == 1
    label = browser.run("document.querySelector('#cdf svg').getAttribute('aria-label')")
    assert label.startswith("Distribution of errors. near: median 0.98 m, 95 %")
    assert browser.run("document.querySelectorAll('#walks rect').length") == 12
    assert browser.run("document.querySelectorAll('#walks-table tbody tr').length") == 12
    against = browser.run("[...document.querySelectorAll('#against-title + div tbody th')].map(c => c.textContent)")
    assert against == ["smooth", "far", "alike"]
    # numbers appear under the pointer, and the key comes back
    box = browser.run(BOX)
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=box[0] + 0.9 * box[2], y=box[1] + 60)
    browser.wait("document.querySelector('#cdf figcaption').textContent.startsWith('at most')")
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=1, y=1)
    browser.wait("document.querySelector('#cdf figcaption').textContent.includes('median')")


def test_a_walk_is_replayed_on_every_level(browser: Any, site: Path) -> None:
    browser.open(site / "entries" / "near.html")
    browser.run("document.getElementById('replay').scrollIntoView()")
    browser.wait("document.querySelectorAll('#replay .level').length === 2")
    choose(browser, "#replay-walk", "walk-01")
    visible = "[...document.querySelectorAll('.here')].map(d => d.getAttribute('visibility') === 'visible')"
    browser.wait("document.getElementById('told').textContent.startsWith('20 s')")
    assert browser.run(visible) == [False, False, True, True]  # on level 1: where the walker was, and the estimate
    browser.run("(() => { scrubber.value = 4; scrubber.dispatchEvent(new Event('input')); })()")
    assert browser.run(visible) == [True, True, False, False]
    shown = browser.run("document.getElementById('told').textContent")
    assert shown.startswith("4 s · estimate on level 0 · about 0.98") and shown.endswith("m off")
    assert browser.run("scrubber.getAttribute('aria-valuetext')") == shown
    length = "document.querySelector('.trail.a').getTotalLength()"
    assert browser.run(length) == pytest.approx(4.0, abs=1e-3)
    browser.click("#play")
    browser.wait("document.getElementById('play').textContent === 'Play' && Number(scrubber.value) === 20")
    assert browser.run(length) == pytest.approx(9.0, abs=1e-3)  # up to the change of level


def test_the_index_is_searched(browser: Any, site: Path) -> None:
    browser.open((site / "../index.html").resolve())
    found = "[...document.querySelectorAll('[data-search]')].filter(e => !e.hidden)"
    shown = f"{found}.map(e => e.querySelector('a').textContent)"
    assert len(browser.run(shown)) == 1 + 5
    choose(browser, "#text", "NEAR")
    assert browser.run(shown) == ["Corridor-v0", "near"]  # an environment is found by who entered it
    assert browser.run("count.textContent") == "1 environment, 1 localizer"
    choose(browser, "#text", "nothing")
    assert browser.run(shown) == []


def test_light_and_dark_by_the_system_and_by_the_switch(browser: Any, site: Path) -> None:
    paper = "getComputedStyle(document.body).backgroundColor"
    browser.open(site / "index.html")
    light = browser.run(paper)
    browser.media(prefers_color_scheme="dark")
    dark = browser.run(paper)
    assert light == "rgb(255, 255, 255)" and dark != light
    browser.click("#theme")
    assert browser.run(paper) == light
    browser.open(site / "compare.html")
    assert browser.run(paper) == light  # the switch is remembered
    browser.wait("document.querySelector('#tiles .tile')")
    browser.click("#theme")
    assert browser.run(paper) == dark
    browser.run("localStorage.clear()")


@pytest.mark.parametrize(
    "name",
    [
        *("index.html", "compare.html", "entries/near.html"),
        *("../index.html", "../suites/corridors-v1.html", "../localizers/near.html"),
    ],
)
def test_pages_fit_a_phone(browser: Any, site: Path, name: str) -> None:
    browser.size(390, 844, mobile=True)
    browser.open((site / name).resolve())
    if name in ("compare.html", "entries/near.html"):
        browser.wait("document.querySelector('#cdf svg')")
    assert browser.run("document.documentElement.scrollWidth") <= 390
    # every table scrolls inside a frame of its own
    assert browser.run(LOOSE_TABLES) == 0


def test_labels_for_screen_readers_are_present(browser: Any, site: Path) -> None:
    for name in ("index.html", "compare.html", "entries/near.html"):
        browser.open(site / name)
        assert browser.run(NAMELESS) == []
        assert browser.run("document.querySelectorAll('h1').length") == 1
        assert browser.run("document.documentElement.lang") == "en"
        assert browser.run("[...document.querySelectorAll('thead th')].every(h => h.scope === 'col')")
        if name != "index.html":
            browser.wait("document.querySelector('#cdf svg')")


def test_a_hostile_card_runs_nothing(browser: Any, world: Any, tmp_path: Path) -> None:
    import msgspec

    evil = '<img src=x onerror="window.hit=1"><script>window.hit=1</script>'
    entries = [world.entry(name, [1.0 + i] * 12) for i, name in enumerate(("one-v0", "two-v0"))]
    for entry in entries:
        card = msgspec.structs.replace(entry.card, authors=(evil,), paper=evil, notes=evil, url=f"javascript:{evil}")
        object.__setattr__(entry, "card", card)
    write_site([world.board(*entries)], tmp_path)
    for name in ("index.html", "compare.html", "entries/one-v0.html"):
        browser.open(tmp_path / "Corridor-v0" / name)
        if name != "index.html":
            browser.wait("document.querySelector('#cdf svg')")
        assert browser.run("window.hit === undefined && document.querySelectorAll('img').length === 0")
    assert browser.run("document.body.textContent.includes('<script>window.hit=1')")
