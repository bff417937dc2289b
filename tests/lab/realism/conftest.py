"""Toy blocks on the path, of this process and of those that it starts."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

SOURCE = Path(__file__).parent / "toy_blocks.py"


@pytest.fixture
def toys(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of `toy_blocks`; recordings are taken to be available there."""
    site, data = tmp_path / "site", tmp_path / "data" / "ilc20"
    site.mkdir()
    data.mkdir(parents=True)
    (data / "manifest.json").write_text("{}")
    shutil.copy(SOURCE, site)
    monkeypatch.syspath_prepend(str(site))
    monkeypatch.setenv("PDRBENCH_DATA", str(data.parent))
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    monkeypatch.chdir(tmp_path)
    return site
