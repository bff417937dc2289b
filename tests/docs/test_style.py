"""Pages for users are few, short and plain, and every link in the repository leads somewhere."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Final

import pytest
import yaml  # of mkdocs

ROOT: Final = Path(__file__).resolve().parents[2]
PAGES: Final = sorted((ROOT / "docs").glob("*.md"))
TEXTS: Final = sorted([*PAGES, *ROOT.glob("*.md"), *ROOT.glob("*/README.md"), *(ROOT / "lab").rglob("*.md")])
MAX_PAGES: Final = 30
MAX_WORDS: Final = 1500
MAX_SENTENCE_WORDS: Final = 25
MAX_NUMBERS_PER_WORD: Final = 0.05
MAX_COLUMNS: Final = 7
README_BYTES: Final = 5000
FIGURES_BYTES: Final = 2_000_000

pytestmark = pytest.mark.skipif(not (ROOT / "docs").is_dir(), reason="documentation is not part of a wheel")


def prose(text: str) -> Iterator[str]:
    """Paragraphs, items and headings, without code, tables, comments and targets of links; code in a line is a word.

    >>> list(prose("# A\\n\\nSee `b c` in\\n[d](e.md).\\n\\n| f |\\n\\n* g\\n* h"))
    ['A', 'See Code in d.', 'g', 'h']
    """
    text = re.sub(r"^ *```.*?^ *```$", "", text, flags=re.MULTILINE | re.DOTALL)
    text = re.sub(r"<!--.*?-->|^\|.*$|^!\[.*$|\{\{.*\}\}", "", text, flags=re.MULTILINE)
    text = re.sub(r"`[^`]*`", "Code", text)
    text = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", text).replace("**", "")
    for part in re.split(r"\n\s*\n|^ *(?:[*-]|\d+\.) |^(?=#)|(?<=\w)$(?=\n#)", text, flags=re.MULTILINE):
        if words := " ".join(part.split()).lstrip("# "):
            yield words


def sentences(text: str) -> list[str]:
    """Sentences of the prose of a page.

    >>> sentences("One `a.b` here, e.g. this. Two?\\n\\n* Three")
    ['One Code here, e.g. this.', 'Two?', 'Three']
    """
    return [sentence for part in prose(text) for sentence in re.split(r"(?<=[.!?])\s+(?=[A-Z*\"(])", part)]


def test_pages_are_few_and_readme_and_pictures_small() -> None:
    assert len(PAGES) <= MAX_PAGES
    assert len((ROOT / "README.md").read_bytes()) <= README_BYTES
    figures = list((ROOT / "docs" / "figures").iterdir())
    assert sum(figure.stat().st_size for figure in figures) <= FIGURES_BYTES
    shown = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "README.md", *PAGES))
    assert [figure.name for figure in figures if f"figures/{figure.name}" not in shown] == []


def test_pages_are_short_and_plain() -> None:
    for page in PAGES:
        text = page.read_text(encoding="utf-8")
        assert len(text.split()) <= MAX_WORDS, page.name
        assert [sentence for sentence in sentences(text) if len(sentence.split()) > MAX_SENTENCE_WORDS] == [], page.name
        words = " ".join(prose(text)).split()
        numbers = [word for word in words if re.fullmatch(r"\W*[\d.,:–-]*\d[\d.,:–-]*\W*", word)]
        assert len(numbers) <= max(MAX_NUMBERS_PER_WORD * len(words), 5), (page.name, numbers)
        heads = re.findall(r"^(\|.*\|)\n\|[-:| ]+\|$", text, flags=re.MULTILINE)
        assert [head for head in heads if head.count("|") > MAX_COLUMNS + 1] == [], page.name


def test_no_link_of_a_text_is_dead() -> None:
    """On GitHub, where no page of the site is; those, and places in pages, are looked for when it is built."""
    dead = []
    for path in TEXTS:
        text = re.sub(r"^ *```.*?^ *```$|`[^`]*`", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        for link in re.findall(r"\]\(([^)#\s]+)[^)]*\)", text):
            target = (path.parent / link).resolve()
            if not (link.startswith(("http", "mailto")) or target.exists()):
                dead.append(f"{path.relative_to(ROOT)}: {link}")
        assert "{{" not in text, f"{path.relative_to(ROOT)}: GitHub shows what a template leaves open"
    assert dead == []


def test_papers_have_the_same_gates_wherever_they_stand() -> None:
    """Gates that hold, in the README and in the table of reproductions."""
    page, readme = ((ROOT / name).read_text(encoding="utf-8") for name in ("docs/reproduce.md", "README.md"))
    gates = re.findall(r"\| (\d+ of \d+) \|$", page, flags=re.MULTILINE)
    assert len(gates) == 4
    assert [gate for gate in gates if gate not in " ".join(readme.split())] == []


def test_pages_that_code_cites_exist() -> None:
    """Of `docs/` and `lab/notebook/`, in modules, tests and errors."""
    cited = re.compile(r"\b(?:docs|lab/notebook)/[\w-]+\.md\b")
    rooms = ("pdrbench", "formats", "envs", "baselines", "leaderboards", "lab", "tests")
    texts = {path: path.read_text(encoding="utf-8") for room in rooms for path in (ROOT / room).rglob("*.py")}
    found = [(str(path.relative_to(ROOT)), name) for path, text in texts.items() for name in cited.findall(text)]
    assert len(found) > 5
    assert [(path, name) for path, name in found if not (ROOT / name).is_file()] == []


def test_a_release_is_published_after_the_whole_ci_and_no_token_is_stored() -> None:
    text, ci = (
        (ROOT / ".github" / "workflows" / name).read_text(encoding="utf-8") for name in ("release.yml", "ci.yml")
    )
    jobs = yaml.safe_load(text)["jobs"]
    assert jobs["ci"]["uses"] == "./.github/workflows/ci.yml" and "workflow_call" in yaml.safe_load(ci)[True]  # "on"
    assert (jobs["build"]["needs"], jobs["publish"]["needs"], jobs["notes"]["needs"]) == ("ci", "build", "publish")
    assert jobs["publish"]["permissions"] == {"id-token": "write"} and "secrets." not in text
