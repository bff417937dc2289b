"""Fetching from a server on loopback: files arrive whole and verified, or not at all."""

from __future__ import annotations

import gzip
import hashlib
import os
import socket
import subprocess
import sys
import textwrap
from pathlib import Path
from typing import Any

import msgspec
import pytest

from pdrbench import datasets as registry
from pdrbench.datasets import Dataset, download, integrity
from pdrbench.datasets.download import fetch_into
from pdrbench.errors import DatasetError

PATHS = {"LICENSE", "map.json", "floor/walk.txt.gz", "floor/survey.txt.gz"}


def files_below(folder: Path) -> set[str]:
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


def problems(small: Dataset, folder: Path) -> list[Any]:
    found = (integrity.difference(file, folder / file.path) for file in small.files if file.is_required)
    return [problem for problem in found if problem is not None]


def change(small: Dataset, path: str, **fields: Any) -> Dataset:
    """The set with one row changed."""
    rows = [msgspec.structs.replace(row, **fields) if row.path == path else row for row in small.files]
    return msgspec.structs.replace(small, files=tuple(rows))


def test_everything_arrives_as_registered_and_nothing_else(small: Dataset, tmp_path: Path) -> None:
    seen: list[tuple[int, int, str]] = []
    came = fetch_into(small, tmp_path / "small", progress=lambda *step: seen.append(step))
    assert files_below(tmp_path / "small") == PATHS
    assert problems(small, tmp_path / "small") == []
    assert set(came.fetched) == PATHS and came.recompressed == ()
    assert came.fetched[0] == "LICENSE"  # a licence comes before what it covers
    assert [done for done, _, _ in seen] == [0, 1, 2, 3, 4] and {total for _, total, _ in seen} == {4}


def test_only_missing_or_damaged_files_are_fetched_again(small: Dataset, server: Any, tmp_path: Path) -> None:
    fetch_into(small, tmp_path)
    (tmp_path / "map.json").write_bytes(b"{ }")
    (tmp_path / "floor/walk.txt.gz").unlink()
    server.sent.clear()
    assert set(fetch_into(small, tmp_path).fetched) == {"map.json", "floor/walk.txt.gz"}
    assert {path for path, _ in server.sent} == {"map.json", "walk.txt"}
    assert problems(small, tmp_path) == []


def test_an_interrupted_transfer_is_continued_with_the_rest_only(small: Dataset, server: Any, tmp_path: Path) -> None:
    whole = len(server.files["walk.txt"])
    server.break_after["walk.txt"] = 300_000
    with pytest.raises(DatasetError, match=rf"walk.txt broke off after 300000 of {whole} bytes; run the same"):
        fetch_into(small, tmp_path)
    assert not (tmp_path / "floor/walk.txt.gz").exists()
    fetch_into(small, tmp_path)
    assert server.requests_of("walk.txt") == [300_000, whole - 300_000]
    assert problems(small, tmp_path) == []


@pytest.mark.parametrize("path", ["map.json", "floor/walk.txt.gz"])
def test_a_wrong_hash_keeps_nothing_and_says_so(path: str, small: Dataset, server: Any, tmp_path: Path) -> None:
    source = Path(path).name.removesuffix(".gz")
    right = server.files[source]
    server.files[source] = b"x" + right[1:]
    with pytest.raises(DatasetError, match=rf"{source} is not the registered {path} \(its hash differs\)"):
        fetch_into(small, tmp_path)
    assert not (tmp_path / path).exists()
    server.files[source] = right
    fetch_into(small, tmp_path)  # what was wrong is not continued
    assert problems(small, tmp_path) == []


def test_a_source_that_does_not_end_is_cut_at_the_registered_size(small: Dataset, server: Any, tmp_path: Path) -> None:
    row = next(row for row in small.files if row.path == "map.json")
    server.files["map.json"] = bytes(60_000_000)
    with pytest.raises(DatasetError, match=f"map.json sends more than the {row.bytes} bytes"):
        fetch_into(small, tmp_path)
    assert not (tmp_path / "map.json").exists()
    assert sum(path.stat().st_size for path in tmp_path.rglob("*") if path.is_file()) < 5_000_000, "nothing was kept"


def test_a_recipe_that_makes_another_file_keeps_nothing(small: Dataset, tmp_path: Path) -> None:
    wrong = change(small, "floor/survey.txt.gz", recipe="gzip")
    with pytest.raises(DatasetError, match=r"floor/survey.txt.gz, as made from .*: sha256 .* was expected"):
        fetch_into(wrong, tmp_path)
    assert not (tmp_path / "floor/survey.txt.gz").exists()


def test_another_zlib_is_reported_and_accepted(small: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(download.RECIPES, "gzip", lambda source: gzip.compress(source, 1, mtime=0))
    came = fetch_into(small, tmp_path)
    assert came.recompressed == ("floor/walk.txt.gz",)
    assert [problem.kind for problem in problems(small, tmp_path)] == ["recompressed"]


def test_a_missing_file_names_its_address(small: Dataset, server: Any, tmp_path: Path) -> None:
    del server.files["survey.txt"]
    with pytest.raises(DatasetError, match=rf"{server.address}/survey.txt: the server answers 404 .*--mirror"):
        fetch_into(small, tmp_path)
    assert "floor/survey.txt.gz" not in files_below(tmp_path)


def test_without_a_server_the_error_says_what_to_check(small: Dataset, tmp_path: Path) -> None:
    with socket.socket() as unused:  # a port without a listener, as long as it is bound here
        unused.bind(("127.0.0.1", 0))
        address = f"127.0.0.1:{unused.getsockname()[1]}"
        away = change(small, "LICENSE", url=f"http://{address}/LICENSE")
        with pytest.raises(DatasetError, match=rf"cannot reach {address}: .*refused.*; check the network"):
            fetch_into(away, tmp_path)


def test_a_full_disk_is_reported_before_anything_is_fetched(small: Dataset, server: Any, tmp_path: Path) -> None:
    usage = os.statvfs(tmp_path)
    huge = change(small, "map.json", bytes=usage.f_bavail * usage.f_frsize + 10**9)
    with pytest.raises(DatasetError, match=r"MB free, .* MB are needed; free some space or set PDRBENCH_CACHE"):
        fetch_into(huge, tmp_path)
    assert server.sent == []


LIMITED = """
    import resource, sys
    from pathlib import Path
    from pdrbench.datasets.catalogue import read_table
    from pdrbench.datasets.download import fetch_into
    from pdrbench.errors import DatasetError

    limit = int(sys.argv[3])
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
    try:
        fetch_into(read_table(Path(sys.argv[1]).read_bytes(), "table"), Path(sys.argv[2]))
    except DatasetError as error:
        print(error)
"""


def run_fetch(small: Dataset, tmp_path: Path, limit_bytes: int) -> subprocess.Popen[str]:
    """A fetch in another process that can write files of so many bytes at most."""
    (tmp_path / "table.json").write_bytes(msgspec.json.encode(small))
    arguments = [str(tmp_path / "table.json"), str(tmp_path / "small"), str(limit_bytes)]
    return subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(LIMITED), *arguments], stdout=subprocess.PIPE, text=True
    )


def test_a_failing_write_names_the_folder_and_leaves_no_half_file(small: Dataset, tmp_path: Path) -> None:
    out, _ = run_fetch(small, tmp_path, 100_000).communicate(timeout=60)
    assert f"cannot write to {tmp_path / 'small'}: File too large; free some space" in out
    assert files_below(tmp_path / "small") >= {"LICENSE"}
    assert "floor/walk.txt.gz" not in files_below(tmp_path / "small")


def test_two_fetches_of_one_set_do_not_collide(small: Dataset, tmp_path: Path) -> None:
    def fetch_again(*_: object) -> None:
        with pytest.raises(DatasetError, match="another fetch is writing to"):
            fetch_into(small, tmp_path)

    assert set(fetch_into(small, tmp_path, progress=_once(fetch_again)).fetched) == PATHS


def _once(call: Any) -> Any:
    """Calls only while the fetch still runs: its last word of progress comes after it let go."""
    return lambda done, total, path: call() if done < total else None


def test_a_mirror_serves_the_files_as_they_are(
    server: Any, make_small: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = make_small(lambda name: "")  # no source of its own
    monkeypatch.setattr(download, "dataset", {"small": small}.__getitem__)
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    with pytest.raises(DatasetError, match="'small' has no source to fetch from"):
        download.fetch("small")
    source = fetch_into(make_small(lambda name: f"{server.address}/{name}"), tmp_path / "source").folder
    server.files = {f"data/small/{path}": (source / path).read_bytes() for path in PATHS}
    came = download.fetch("small", mirror=f"{server.address}/data/")
    assert came.folder == tmp_path / "cache" / "small"
    assert problems(small, came.folder) == []


def test_packaged_licences_are_the_registered_ones() -> None:
    licences = [file for each in registry.datasets().values() for file in each.files if "package:" in file.url]
    assert licences
    folder = Path(download.__file__).with_name("licences")
    for file in licences:
        assert hashlib.sha256((folder / file.url.removeprefix("package:")).read_bytes()).hexdigest() == file.sha256
