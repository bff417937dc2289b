"""Digests of code: statements of a localizer and its imports count, comments and docstrings do not."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from pdrbench.evaluation import code
from pdrbench.evaluation.sources import target_sha256

FILES = {
    "__init__.py": 'LOCALIZERS = {"a-v0": "strange.a:A"}\n',
    "a.py": "from strange.shared import step\n\nclass A:\n    'Steps.'\n    def step(self):\n        return step()\n",
    "b.py": "def b():\n    return 1\n",
    "shared.py": "def step():\n    from .lazy.inner import turn\n\n    return turn() + 1\n",
    "lazy/__init__.py": '"""Turns."""\n',
    "lazy/inner.py": "from .. import constants\n\n\ndef turn():\n    return constants.TURN\n",
    "lazy/weights.bin": "1234",
    "constants.py": "TURN = 2\n",
    "cards.toml": "[a-v0]\n",
}


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in FILES.items():
        (tmp_path / "strange" / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / "strange" / name).write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    return tmp_path / "strange"


def digest() -> str:
    return target_sha256("strange.a:A")


def replace(name: str, old: str, new: str) -> Callable[[Path], None]:
    def change(package: Path) -> None:
        path = package / name
        assert old in path.read_text()
        path.write_text(path.read_text().replace(old, new))

    return change


@pytest.mark.parametrize(
    "change",
    [
        replace("a.py", "class A", "# first of its kind\nclass A"),
        replace("a.py", "Steps.", "Walks."),
        replace("shared.py", "turn() + 1", "(turn()   + 1)"),
        replace("lazy/__init__.py", "Turns.", "Turns and more."),
        replace("b.py", "return 1", "return 2"),
        replace("__init__.py", "}", ', "b-v0": "strange.b:B"}'),
        replace("cards.toml", "a-v0", "b-v0"),
        lambda package: (package / "README.py").write_text("nonsense ("),
    ],
)
def test_comments_and_docstrings_do_not_count(package: Path, change: Callable[[Path], None]) -> None:
    before = digest()
    change(package)
    assert digest() == before


@pytest.mark.parametrize(
    "change",
    [
        replace("a.py", "return step()", "return 2 * step()"),
        replace("shared.py", "+ 1", "+ 2"),
        replace("lazy/inner.py", "constants.TURN", "-constants.TURN"),
        replace("lazy/weights.bin", "1234", "1235"),
        replace("constants.py", "2", "3"),
        replace("lazy/__init__.py", '"""Turns."""', "import random"),
        replace("__init__.py", "LOCALIZERS", "import sys\nLOCALIZERS"),
    ],
)
def test_imported_modules_count(package: Path, change: Callable[[Path], None]) -> None:
    before = digest()
    change(package)
    assert digest() != before


def test_a_whole_package_counts_but_for_cards(package: Path) -> None:
    before = target_sha256("strange")
    replace("cards.toml", "a-v0", "b-v0")(package)
    replace("b.py", "def b", "# a comment\ndef b")(package)
    assert target_sha256("strange") == before
    replace("b.py", "return 1", "return 2")(package)
    assert target_sha256("strange") != before


def test_parsed_digests_are_cached_for_the_next_process(package: Path) -> None:
    code._cache.cache_clear()
    before = digest()
    kept = package.parent / "cache" / f"code-{sys.version_info.major}.{sys.version_info.minor}.json"
    assert kept.is_file()
    code._cache.cache_clear()
    try:
        assert digest() == before
        kept.write_bytes(b"{damaged")
        code._cache.cache_clear()
        assert digest() == before
    finally:
        code._cache.cache_clear()
