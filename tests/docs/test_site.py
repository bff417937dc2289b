"""The built documentation: no warning, no dead link, pages that fit a phone and can be read and reached."""

from __future__ import annotations

import re
import sys
import urllib.parse
from pathlib import Path
from typing import Any, Final

import pytest
from click.testing import CliRunner

from pdrbench import building, evaluation, filters, inertial, metrics, picture, radio

ROOT: Final = Path(__file__).resolve().parents[2]
KINDS: Final = (  # a page of each kind
    *("index", "choose", "tutorial", "results", "threats", "metrics", "fields", "networks", "train"),
    *("api/filters", "environments/CampusStride-v1", "datasets/foot_vicon"),
)
PHONE: Final = (390, 844)
SCHEMES: Final = {"light": "default", "dark": "slate"}  # colours of the reader's system, and their name in a page
CONTRAST: Final = """(() => {
  const parse = (text) => { const n = text.match(/[\\d.]+/g).map(Number); return [n[0], n[1], n[2], n[3] ?? 1]; };
  const over = (a, b) => [0, 1, 2].map((i) => a[3] * a[i] + (1 - a[3]) * b[i]);
  const linear = (v) => v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4;
  const light = (c) => 0.2126 * linear(c[0]) + 0.7152 * linear(c[1]) + 0.0722 * linear(c[2]);
  const poor = {};
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const node = walker.currentNode, element = node.parentElement;
    if (!node.textContent.trim()) continue;
    if (!element.checkVisibility({opacityProperty: true, visibilityProperty: true})) continue;
    if (element.closest('script, style, noscript, svg, [hidden]')) continue;
    const box = element.getBoundingClientRect();
    if (box.width < 2 || box.height < 2) continue;
    const style = getComputedStyle(element), stack = [];
    let alpha = 1;
    for (let at = element; at; at = at.parentElement) {
      const own = getComputedStyle(at);
      alpha *= Number(own.opacity);
      stack.push(parse(own.backgroundColor));
    }
    let behind = [255, 255, 255];
    for (const colour of stack.reverse()) behind = over(colour, behind);
    const ink = parse(style.color);
    ink[3] *= alpha;
    const a = light(over(ink, behind)), b = light(behind), size = parseFloat(style.fontSize);
    const isLarge = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
    const ratio = (Math.max(a, b) + 0.05) / (Math.min(a, b) + 0.05);
    if (ratio < (isLarge ? 3 : 4.5)) {
      const name = element.tagName.toLowerCase() + (element.className ? '.' + element.className : '');
      poor[`${name}: ${ratio.toFixed(2)}`] ??= node.textContent.trim().slice(0, 30);
    }
  }
  return poor;
})()"""
FOCUS: Final = """(() => {
  const at = document.activeElement, style = getComputedStyle(at), box = at.getBoundingClientRect();
  const ring = style.outlineStyle !== 'none' && parseFloat(style.outlineWidth) > 0;
  return [at.tagName + ' ' + at.textContent.trim().slice(0, 20), ring, box.bottom > 0 && box.top < innerHeight];
})()"""

pytestmark = pytest.mark.skipif(not (ROOT / "docs").is_dir(), reason="documentation is not part of a wheel")


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Built once, in this process, which has imported most of what is described; a warning is an error."""
    from mkdocs.__main__ import cli as mkdocs

    folder = tmp_path_factory.mktemp("site")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(ROOT)
        patch.setattr(sys, "path", [*sys.path])
        done = CliRunner().invoke(mkdocs, ["build", "--strict", "--site-dir", str(folder)])
    assert done.exit_code == 0, done.output
    return folder


@pytest.fixture(scope="module")
def texts(site: Path) -> dict[str, str]:
    """Every page by its path."""
    return {str(page.relative_to(site)): page.read_text(encoding="utf-8") for page in sorted(site.rglob("*.html"))}


def test_pages_load_nothing_from_elsewhere(texts: dict[str, str]) -> None:
    assert {"index.html", "metrics.html", "api.html", "environments/CampusStride-v1.html"} <= set(texts)
    for name, text in texts.items():
        loaded = re.findall(r'<(?:script|img|iframe)[^>]+src="([^"]+)"', text)
        loaded += re.findall(r'<link[^>]+rel="(?:stylesheet|preconnect)"[^>]+href="([^"]+)"', text)
        assert not [url for url in loaded if url.startswith(("http", "//"))], name


def test_the_api_has_every_public_name(texts: dict[str, str]) -> None:
    for room in (building, evaluation, filters, inertial, metrics, picture, radio):
        shown = re.findall(r'<h2 id="([^"]+)"', texts[f"api/{room.__name__.rpartition('.')[2]}.html"])
        # Of two names that differ in case the second has a number behind its id.
        assert [re.sub(r"_\d$", "", name) for name in shown] == [name.lower() for name in room.__all__]


def test_no_link_is_dead(site: Path, texts: dict[str, str]) -> None:
    """Files and places in them; `mkdocs build --strict` sees those in Markdown only, and none in generated HTML."""
    ids = {name: set(re.findall(r'\bid="([^"]+)"', text)) for name, text in texts.items()}
    dead = []
    for name, text in texts.items():
        for link in set(re.findall(r'\b(?:href|src)="([^"]+)"', text)):
            target = urllib.parse.urlsplit(link.replace("&amp;", "&"))
            if target.scheme or target.netloc or name == "404.html":
                continue
            path = (site / name).parent / urllib.parse.unquote(target.path) if target.path else site / name
            path = (path / "index.html" if path.is_dir() else path).resolve()
            place = urllib.parse.unquote(target.fragment)
            of = str(path.relative_to(site)) if path.is_relative_to(site) else ""
            if not path.is_file() or (place and place != "__skip" and of in ids and place not in ids[of]):
                dead.append(f"{name}: {link}")
    assert dead == []


def choose_colours(browser: Any, scheme: str) -> None:
    """As a reader does whose system changes its colours; the page follows without being loaded again."""
    browser.media(prefers_color_scheme=scheme)
    browser.wait(f"document.body.dataset.mdColorScheme === '{SCHEMES[scheme]}'")
    browser.wait("document.getAnimations().every((one) => !(one instanceof CSSTransition))")


def test_pages_fit_a_phone_and_can_be_read(site: Path, browser: Any) -> None:
    """No page scrolls sideways at 390 px, and text has the contrast of WCAG AA: 4.5, large text 3."""
    browser.size(*PHONE, mobile=True)
    written = {page.stem for page in (ROOT / "docs").glob("*.md")}
    wide = []
    for page in sorted(written | set(KINDS)):  # generated pages are like those of their kind
        browser.call("Emulation.setScriptExecutionDisabled", value=page not in KINDS)  # scripts make no page wider
        browser.open(site / f"{page}.html")
        for scheme in SCHEMES if page in KINDS else ():
            choose_colours(browser, scheme)
            assert browser.run(CONTRAST) == {}, (page, scheme)
        if browser.run("document.scrollingElement.scrollWidth") > PHONE[0]:
            wide.append(page)
    browser.call("Emulation.setScriptExecutionDisabled", value=False)
    assert wide == []


def test_the_keyboard_shows_where_it_is(site: Path, browser: Any) -> None:
    browser.size(1280, 900)
    browser.open(site / "index.html")
    for scheme in SCHEMES:
        choose_colours(browser, scheme)
        places = set()
        for _ in range(25):
            browser.key("Tab")
            place, has_ring, is_seen = browser.run(FOCUS)
            places.add(place)
            assert has_ring and is_seen, place
        assert len(places) > 15
