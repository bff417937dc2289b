"""`pdrbench error-model`: a table, a file, JSON, and the error without data."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from pdrbench.registry import registered_task
from pdrbench_lab.stride_errors import stride_errors
from pdrbench_lab.stride_errors.error_file import ErrorFile, read_error_file, read_errors

Command = Callable[..., Any]


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, tuple[str, ...]]]:
    """Records the requested measurements; each returns the packaged file."""
    calls: list[tuple[str, tuple[str, ...]]] = []

    def measured(filter_name: str, envs: list[str]) -> ErrorFile:
        calls.append((filter_name, tuple(envs)))
        return read_error_file()

    monkeypatch.setattr(stride_errors, "measure_errors", measured)
    return calls


def test_a_table_beside_the_figures_of_note_1(command: Command, asked: list[object]) -> None:
    done = command("error-model")
    assert done.code == 0
    assert asked == [("literal", ("FootVicon-v1", "FootWalks-v1"))]
    line = next(line for line in done.out.splitlines() if line.strip().startswith("length_bias "))
    assert line.split()[-3:] == ["635", "-1.9", "%"]
    assert "test-9538f964 left out: fewer than 8" in done.err


def test_json_is_the_file(command: Command, asked: list[object], tmp_path: Path) -> None:
    file = tmp_path / "errors.json"
    done = command("error-model", "--json", "--filter", "adaptive", "--env", "FootWalks-v1", "--out", file)
    assert done.code == 0
    assert asked == [("adaptive", ("FootWalks-v1",))]
    assert done.json["errors"]["length_bias"] == read_errors(file).length_bias
    assert [row["name"] for row in done.json["statistics"]] == [row.name for row in read_error_file(file).statistics]
    assert str(tmp_path) not in file.read_text("utf-8")


@pytest.mark.usefixtures("asked")
def test_a_place_that_cannot_be_written_is_an_error(command: Command, tmp_path: Path) -> None:
    done = command("error-model", "--out", tmp_path / "none" / "errors.json")
    assert done.code == 1
    assert "cannot write" in done.err


def test_an_unknown_filter(command: Command) -> None:
    done = command("error-model", "--filter", "adaptiv")
    assert done.code == 1
    assert "did you mean 'adaptive'?" in done.err
    assert not done.out


def test_without_data(command: Command, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("PDRBENCH_DATA", raising=False)
    monkeypatch.setenv("PDRBENCH_CACHE", str(tmp_path / "cache"))
    registered_task.cache_clear()
    done = command("error-model", "--json")
    assert done.code == 1
    assert "PDRBENCH_DATA" in done.err and "Traceback" not in done.err
    assert not done.out


def test_the_same_bytes_twice(command: Command, data_root: Path, tmp_path: Path) -> None:
    if not (data_root / "foot_stride_gcp").is_dir():
        pytest.skip("foot_stride_gcp is not under PDRBENCH_DATA")
    registered_task.cache_clear()
    files = [tmp_path / "one.json", tmp_path / "two.json"]
    for file in files:
        assert command("error-model", "--env", "FootWalks-v1", "--out", file).code == 0
    assert files[0].read_bytes() == files[1].read_bytes()
