"""Bundles and entries: what was packed is read back, and arbitrary bytes are refused."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pdrbench.errors import BundleError
from pdrbench_leaderboard.bundle import Bundle, read_bundle, write_bundle
from pdrbench_leaderboard.entry import list_entries, read_entry, walk_record, write_entry

from .conftest import ENV


@pytest.fixture
def bundle(packed: dict[str, Bundle]) -> Bundle:
    return packed["Wanders"]


def test_a_bundle_is_read_as_it_was_written(bundle: Bundle) -> None:
    content = write_bundle(bundle)
    again = read_bundle(content)
    assert again == bundle and again.content_sha256 == bundle.content_sha256
    assert write_bundle(again) == content
    other = dataclasses.replace(bundle, manifest=msgspec.structs.replace(bundle.manifest, seeds=7))
    assert other.content_sha256 != bundle.content_sha256


@settings(max_examples=100, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_any_bytes_are_a_bundle_or_a_bundle_error(bundle: Bundle, data: st.DataObject) -> None:
    raw = bytearray(write_bundle(bundle))
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    cut = raw[: data.draw(st.integers(0, len(raw)))] if data.draw(st.booleans()) else raw
    try:
        read_bundle(bytes(cut)).entries()
    except BundleError as error:
        assert "\n" not in str(error)


def test_an_entry_is_written_and_read(bundle: Bundle, tmp_path: Path) -> None:
    (entry,) = bundle.entries()
    folder = write_entry(tmp_path, entry)
    assert folder == tmp_path / ENV / "wanders"
    assert list_entries(tmp_path) == [folder]
    again = read_entry(folder)
    assert again.manifest == entry.manifest and again.sha256 == entry.sha256
    assert (again.tier, again.division, again.suite) == ("self-reported", "online", "small-v1")
    assert [result.walk for result in again.results] == [walk.walk for walk in entry.record.walks]
    np.testing.assert_array_equal(again.results[0].estimates.xy_m, entry.results[0].estimates.xy_m)


def test_an_entry_with_settings_lies_in_a_folder_that_every_system_takes(bundle: Bundle, tmp_path: Path) -> None:
    name = "mine?map=false"
    card = msgspec.structs.replace(bundle.card, name=name)
    manifest = msgspec.structs.replace(bundle.manifest, localizer=name)
    (entry,) = dataclasses.replace(bundle, card=card, manifest=manifest).entries()
    assert write_entry(tmp_path, entry).name == "mine@map=false"


@pytest.mark.parametrize("file", ["estimates.bin", "card.toml", "submission.json"])
def test_an_entry_that_was_changed_is_refused(bundle: Bundle, tmp_path: Path, file: str) -> None:
    folder = write_entry(tmp_path, bundle.entries()[0])
    raw = bytearray((folder / file).read_bytes())
    raw[len(raw) // 2] ^= 128
    (folder / file).write_bytes(bytes(raw))
    with pytest.raises(BundleError):
        read_entry(folder)


def test_an_entry_lies_where_it_belongs(bundle: Bundle, tmp_path: Path) -> None:
    folder = write_entry(tmp_path, bundle.entries()[0])
    moved = folder.rename(folder.with_name("better"))
    with pytest.raises(BundleError, match="lies in"):
        read_entry(moved)
    with pytest.raises(BundleError, match="cannot read"):
        read_entry(folder)


def test_why_a_walk_failed_is_one_line_without_folders(bundle: Bundle) -> None:
    (entry,) = bundle.entries()
    traceback = 'Traceback (most recent call last):\n  File "/somewhere/secret/mine.py", line 3\nValueError: no idea\n'
    failed = dataclasses.replace(entry.results[0], status="failed", failure=traceback)
    assert walk_record(failed).failure == "ValueError: no idea"
    assert walk_record(entry.results[0]).failure == ""
