"""Names and texts from outside: forty hostile names at every door, and texts that reach a cell, a line or a page."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from pdrbench.datasets.catalogue import DataFile, datasets, read_table
from pdrbench.errors import DatasetError, PdrbenchError, plain_cell, quoted
from pdrbench.evaluation.store import result_name
from pdrbench.files import is_safe_name, safe_name
from pdrbench.localizer_folder import parse_settings
from pdrbench.report.pages import render
from pdrbench_formats.taskfile.pack import fetch_pack
from pdrbench_leaderboard.bundle import read_members
from pdrbench_leaderboard.card import card_of, card_toml, read_card
from pdrbench_leaderboard.folder_archive import read_archive
from pdrbench_leaderboard.schema import Name, read_json

HOSTILE = [
    *("..", ".", "", "../x", "../../.ssh/authorized_keys", "a/../../x", "./x", "a/./b", "a//b", "/etc/passwd"),
    *("//host/x", "a/", "..\\..\\x", "a\\b", "\\\\host\\share", "C:evil", "C:\\evil", "a:stream", "~", "~root/x"),
    *("$HOME", "%TEMP%", "%TEMP%", ".ssh", ".netrc", "a/.git/config", "con", "NUL.txt", "aux.py", "a/com1", "LPT9"),
    *("x.", "x ", " x", "-rf", "a\nb", "a\x01b", "a\x1b[2J", "a\u202ecsv.exe", "ｅtc", "a*", "a?", "a|b", '"a"'),
    *("<a>", "a" * 300, "/".join("a" * 9)),
]


def zipped(name: str) -> bytes:
    """A zip with a member of that name, as it stands there."""
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", zipfile.ZIP_STORED) as archive:
        archive.writestr("localizer.toml", 'entry = "a.py:A"')
        info = zipfile.ZipInfo("placeholder")
        info.filename = name
        archive.writestr(info, b"x = 1")
    return target.getvalue()


def in_settings(name: str) -> object:
    weights = f'entry = "a.py:A"\n[weights.{json.dumps(name)}]\nbytes = 1\nsha256 = "{"0" * 64}"\n'
    return parse_settings(weights.encode(), is_project=False)


def in_card(name: str) -> object:
    return read_card(card_toml(msgspec.structs.replace(card_of("stay"), name=name)))


DOORS: dict[str, Callable[[str], object]] = {
    "a file of a data set": lambda name: DataFile(path=name, sha256="0" * 64, bytes=1, role="data"),
    "a member of a bundle": lambda name: read_members(zipped(name)),
    "a file of a localizer's folder": lambda name: read_archive(zipped(name)),
    "weights of a localizer": in_settings,
    "an entry of a board": in_card,
    "a source in a manifest": lambda name: read_json(json.dumps({name: 1}).encode(), dict[Name, int], "a manifest"),
}


@pytest.mark.parametrize("door", DOORS)
def test_no_hostile_name_becomes_a_path(door: str) -> None:
    assert len(HOSTILE) >= 40
    for name in HOSTILE:
        with pytest.raises((ValueError, PdrbenchError)) as refused:
            DOORS[door](name)
        assert not isinstance(refused.value, PdrbenchError) or "\x1b" not in str(refused.value)


def test_texts_that_have_to_be_a_name_become_a_harmless_one() -> None:
    for text in HOSTILE:
        assert is_safe_name(safe_name(text))
        name = result_name("CampusFoot-v1", text, text, 0, "0" * 64)
        assert set(name).isdisjoint("/\\:\n") and name.isprintable() and name.startswith("CampusFoot-v1.")


@pytest.fixture
def served(serve: Callable[[Path], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, str]:
    """A folder, its address, and a cache of one's own."""
    folder = tmp_path / "served"
    folder.mkdir()
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "home" / "cache"))
    return folder, serve(folder)


def index_of(name: str, task: str, path: str = "task.toml") -> bytes:
    """The index of a packed folder with one file."""
    content = task.encode()
    file = {"path": path, "sha256": hashlib.sha256(content).hexdigest(), "bytes": len(content), "role": "task"}
    texts = dict.fromkeys(("summary", "licence", "licence_note", "source_url", "commit", "citation", "how_to_get"), "")
    return json.dumps({"name": name, **texts, "by_content": False, "files": [file]}).encode()


def fetch(served: tuple[Path, str], index: bytes, task: str = "") -> None:
    folder, address = served
    (folder / "dataset.json").write_bytes(index)
    (folder / "task.toml").write_text(task)
    fetch_pack(address, hashlib.sha256(index).hexdigest())


def test_a_packed_folder_writes_into_its_place_in_the_cache_or_nowhere(
    served: tuple[Path, str], tmp_path: Path
) -> None:
    before = {path for path in tmp_path.rglob("*") if served[0] not in path.parents}
    for name in HOSTILE:
        with pytest.raises(DatasetError):
            read_table(index_of(name, ""), "an index")
        with pytest.raises(DatasetError):
            read_table(index_of("Mine-v1", "", name), "an index")
    for index in (index_of("..", ""), index_of(next(iter(datasets())), ""), index_of("CampusFoot-v1", "", "walks")):
        with pytest.raises(DatasetError):
            fetch(served, index)
    for key in ('[[walk]]\nfile = "{}"', '[plan]\nfile = "{}"', 'columns = "{}"', '[[walk]]\nfile = "a"\ntruth = "{}"'):
        for name in ("../../.ssh/id_ed25519", "/etc/passwd", "~/.netrc"):
            task = key.format(name)
            with pytest.raises(DatasetError, match="no file of its folder"):
                fetch(served, index_of("Mine-v1", task), task)
    assert {path for path in tmp_path.rglob("*") if served[0] not in path.parents} == before
    task = '[[walk]]\nfile = "walks/one"'
    fetch(served, index_of("Mine-v1", task), task)
    assert (tmp_path / "home" / "cache" / "Mine-v1" / "task.toml").read_text() == task


def test_texts_become_harmless_in_cells_lines_and_pages() -> None:
    assert [plain_cell(text)[0] for text in ("=cmd()", "+1", "-1", "@x", "\t=1")] == ["'"] * 5
    assert "\n" not in plain_cell("a\r\n=b\u2028c")
    assert all(line.startswith("  | ") for line in quoted("ValueError\npdrbench: all passed\x85x").splitlines())
    text = "a\u202e<b>\x1b"
    page = render("comparison.html", tables=[(text, [text], [[text]])], notes=[text], pictures=[])
    assert not any(sign in page for sign in "\u202e\x1b")
    assert "<b>" not in page
