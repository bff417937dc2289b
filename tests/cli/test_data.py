"""`pdrbench data`."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pdrbench.datasets import DataFile, Dataset, catalogue

LICENCE, WALK = b"Do as you please.\n", b"0,1,2\n"


@pytest.fixture
def mirror(serve: Callable[[Path], str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    """The address of a mirror of a small set that is registered as well, and an empty cache."""
    rows = []
    for path, content, role in (("LICENSE", LICENCE, "licence"), ("data/walk-one.csv", WALK, "data")):
        place = tmp_path / "mirror/small" / path
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_bytes(content)
        sha256 = hashlib.sha256(content).hexdigest()
        rows.append(DataFile(path=path, sha256=sha256, bytes=len(content), role=role))
    small = Dataset(
        name="small", summary="A set for tests", licence="MIT", licence_note="Do as you please.", source_url="",
        commit="", citation="", how_to_get="ask its owner", by_content=False, files=tuple(rows),
    )  # fmt: skip
    known = {**catalogue.datasets(), "small": small}
    monkeypatch.setattr(catalogue, "datasets", lambda: known)
    monkeypatch.setattr("pdrbench.datasets.datasets", lambda: known)
    monkeypatch.delenv("PDRBENCH_DATA", raising=False)
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    return serve(tmp_path / "mirror")


def test_fetch_then_verify_then_fetch_nothing(mirror: str, command: Any, tmp_path: Path) -> None:
    fetched = command("data", "fetch", "small", "--mirror", mirror, "--json")
    assert fetched.code == 0
    folder = str(tmp_path / "cache/small")
    assert fetched.json == {
        "datasets": [{"id": "small", "folder": folder, "fetched": ["LICENSE", "data/walk-one.csv"], "recompressed": []}]
    }
    assert "small: licence MIT. Do as you please." in fetched.err  # a licence travels with its data
    again = command("data", "fetch", "small", "--mirror", mirror)
    assert (again.code, again.out) == (0, "") and "small: 0 files fetched" in again.err
    verified = command("data", "verify", "--json")
    assert verified.code == 0
    assert verified.json == {"datasets": [{"id": "small", "folder": folder, "files": 2, "pass": True, "problems": []}]}


def test_differences_are_reported_and_exit_1(mirror: str, command: Any, tmp_path: Path) -> None:
    command("data", "fetch", "small", "--mirror", mirror)
    walk = tmp_path / "cache/small/data/walk-one.csv"
    walk.write_bytes(b"9,9,9\n")
    (walk.parent / "more.csv").write_bytes(b"")
    outcome = command("data", "verify", "small")
    assert outcome.code == 1
    assert "small: NOT as registered" in outcome.out
    assert "differs: data/walk-one.csv: sha256 " in outcome.out and "extra: data/more.csv" in outcome.out
    answer = command("data", "verify", "small", "--json")
    assert answer.code == 1
    assert {p["path"]: p["kind"] for p in answer.json["datasets"][0]["problems"]} == {
        "data/walk-one.csv": "differs",
        "data/more.csv": "extra",
    }
    walk.write_bytes(WALK)
    assert command("data", "verify", "small").code == 0  # an extra file alone is reported and is no failure


def test_a_folder_elsewhere_can_be_verified(mirror: str, command: Any, tmp_path: Path) -> None:
    assert command("data", "verify", "small", "--path", tmp_path / "mirror/small").code == 0
    outcome = command("data", "verify", "small", "--path", tmp_path / "absent")
    assert outcome.code == 1 and "is not a folder" in outcome.err


def test_without_data_the_command_says_how_to_begin(mirror: str, command: Any) -> None:
    outcome = command("data", "verify")
    assert outcome.code == 1 and "no dataset is available; run `pdrbench data list`" in outcome.err
