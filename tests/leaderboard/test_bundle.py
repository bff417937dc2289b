"""Bundles: packed bundles are read back, and arbitrary bytes are refused."""

from __future__ import annotations

import dataclasses
import io
import struct
import zipfile
import zlib
from pathlib import Path

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from pdrbench.errors import BundleError
from pdrbench.trajectory import Estimates
from pdrbench_leaderboard import bundle as bundles
from pdrbench_leaderboard import coding
from pdrbench_leaderboard.bundle import Bundle, read_bundle, write_bundle
from pdrbench_leaderboard.entry import list_entries, read_entry, walk_run, write_entry

from .example_bundle import ENV, example

NUMBERS = st.one_of(st.floats(), st.floats(-1e3, 1e3), st.sampled_from([0.0, -0.0, 1e308, float("nan"), float("inf")]))


@pytest.fixture(scope="module")
def bundle() -> Bundle:
    return example()


@pytest.fixture(scope="module")
def content(bundle: Bundle) -> bytes:
    return write_bundle(bundle)


def rezipped(content: bytes, change: dict[str, bytes | None], **options: int) -> bytes:
    """The zip with some members replaced, added, or left out."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        members = {name: archive.read(name) for name in archive.namelist()} | change
    target = io.BytesIO()
    with zipfile.ZipFile(target, "w", **options) as archive:
        for name, data in members.items():
            if data is not None:
                archive.writestr(name, data)
    return target.getvalue()


def test_a_packed_bundle_is_read_back(bundle: Bundle, content: bytes) -> None:
    again = read_bundle(content)
    assert again.manifest == bundle.manifest
    assert again.run == bundle.run
    assert again.card == bundle.card
    assert again.source == bundle.source
    assert all(np.array_equal(a, b) for a, b in zip(again.estimates, bundle.estimates, strict=True))
    assert write_bundle(again) == content
    assert len(content) < 12_000


def test_the_digest_is_that_of_all_but_the_run(bundle: Bundle) -> None:
    later = dataclasses.replace(bundle, run=msgspec.structs.replace(bundle.run, started_at="2027"))
    assert later.content_sha256 == bundle.content_sha256
    assert write_bundle(later) != write_bundle(bundle)
    other = dataclasses.replace(bundle, manifest=msgspec.structs.replace(bundle.manifest, seeds=7))
    assert other.content_sha256 != bundle.content_sha256


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"manifest.json": None}, "lacks manifest.json"),
        ({"manifest.json": b"{}"}, "is of format 1"),
        ({"manifest.json": b'{"schema": 2}'}, "suite"),
        ({"manifest.json": b'{"suite":' + b"[" * 100_000}, "str|malformed|truncated"),
        ({"manifest.json": b'{"parameters":{"a":' + b"[" * 100_000}, "deep"),
        ({"card.toml": b"name = 1\n"}, "not the one that was packed"),
        ({"run.json": b'{"started_at": "x", "machine": {}, "walks": {}, "more": 1}'}, "more"),
        ({"source/mine.py": b"import os\n"}, "not the one that was packed"),
        ({"source/more.py": b""}, "the manifest lists"),
        ({"estimates/more.bin": b"x"}, "does not list"),
        ({"../../etc/passwd": b"x"}, "named"),
        ({"/etc/passwd": b"x"}, "named"),
        ({"a/../b": b"x"}, "named"),
        ({"C:\\a": b"x"}, "named"),
        ({"folder/": b""}, "named"),
        ({"x" * 400: b""}, "named"),
        ({".hidden": b""}, "named"),
    ],
)
def test_other_members_are_refused(content: bytes, change: dict[str, bytes | None], why: str) -> None:
    with pytest.raises(BundleError, match=why):
        read_bundle(rezipped(content, change))


def test_a_single_estimate_that_is_changed_is_named(bundle: Bundle, content: bytes) -> None:
    walk = bundle.manifest.environments[0].walks[1].walk
    changed = bundle.estimates[1].copy()
    changed[0, 7] += 1
    member = f"estimates/{ENV}/{walk}.s0.bin"
    with pytest.raises(BundleError, match=f"{walk} with seed 0 are not those packed"):
        read_bundle(rezipped(content, {member: coding.encode(changed)}))


def test_compressed_members_are_refused_before_they_are_inflated(content: bytes) -> None:
    with pytest.raises(BundleError, match="compressed"):
        read_bundle(rezipped(content, {"bomb.bin": bytes(10_000_000)}, compression=zipfile.ZIP_DEFLATED))


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_doubles_links_and_encrypted_members_are_refused(content: bytes) -> None:
    double = io.BytesIO(content)
    with zipfile.ZipFile(double, "a") as archive:
        archive.writestr("card.toml", b"")
    with pytest.raises(BundleError, match="twice"):
        read_bundle(double.getvalue())
    link = io.BytesIO(content)
    with zipfile.ZipFile(link, "a") as archive:
        info = zipfile.ZipInfo("link")
        info.create_system, info.external_attr = 3, 0o120777 << 16
        archive.writestr(info, b"/etc/passwd")
    with pytest.raises(BundleError, match="link"):
        read_bundle(link.getvalue())
    central = content.index(b"PK\x01\x02")
    locked = bytearray(content)
    locked[central + 8] |= 1
    with pytest.raises(BundleError, match="encrypted"):
        read_bundle(bytes(locked))


def test_members_that_overlap_are_refused(content: bytes) -> None:
    """The bomb of many names for the same bytes."""
    first, second = content.index(b"PK\x01\x02"), 0
    second = content.index(b"PK\x01\x02", first + 4)
    same_place = bytearray(content)
    same_place[second + 42 : second + 46] = content[first + 42 : first + 46]
    with pytest.raises(BundleError):
        read_bundle(bytes(same_place))


def test_too_large_members_are_refused_unread(monkeypatch: pytest.MonkeyPatch, content: bytes) -> None:
    monkeypatch.setattr(bundles, "MAX_BUNDLE_BYTES", len(content) - 1)
    with pytest.raises(BundleError, match="bytes"):
        read_bundle(content)


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_any_bytes_are_a_bundle_or_a_bundle_error(content: bytes, data: st.DataObject) -> None:
    raw = bytearray(content)
    for _ in range(data.draw(st.integers(1, 4))):
        raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
    cut = raw[: data.draw(st.integers(0, len(raw)))] if data.draw(st.booleans()) else raw
    try:
        read_bundle(bytes(cut))
    except BundleError as error:
        assert "\n" not in str(error)


@settings(max_examples=200, deadline=None)
@given(
    arrays(np.float64, st.tuples(st.integers(0, 30), st.just(5)), elements=NUMBERS),
    st.lists(st.sampled_from([0.0, 1.0, np.nan]), min_size=30, max_size=30),
)
def test_estimates_come_back_rounded(columns: np.ndarray, converged: list[float]) -> None:
    count = len(columns)
    given_ = Estimates(
        t_s=np.arange(count) * 0.5,
        xy_m=columns[:, :2],
        level=np.clip(np.nan_to_num(np.rint(columns[:, 2])), -1e6, 1e6),
        heading_rad=columns[:, 3],
        sigma_m=columns[:, 4],
        converged=np.array(converged[:count]),
    )
    whole = coding.whole_numbers(given_)
    back, end = coding.decode(coding.encode(whole), "a walk")
    assert np.array_equal(back, whole)
    assert end == len(coding.encode(whole))
    kept = coding.rounded(given_, 0.5)
    assert np.array_equal(coding.whole_numbers(kept), whole)
    small = np.abs(given_.xy_m) < 1e6
    assert np.abs(kept.xy_m[small] - given_.xy_m[small]).max(initial=0.0) <= 0.5001e-4
    assert np.array_equal(np.isnan(kept.xy_m), np.isnan(given_.xy_m))
    assert np.array_equal(np.isinf(kept.sigma_m), np.isinf(given_.sigma_m))


def test_estimates_at_other_times_are_not_packed(bundle: Bundle) -> None:
    with pytest.raises(BundleError, match=r"every 0\.5 s"):
        coding.rounded(bundle.entries()[0].results[0].estimates, 0.5)


def block(rows: int, planes: tuple[int, ...], raw: bytes) -> bytes:
    body = zlib.compress(raw)
    return struct.pack("<4sII6B2x", b"PDE1", rows, len(body), *planes) + body


@pytest.mark.parametrize(
    ("content", "why"),
    [
        (b"", "cut off"),
        (b"PDE0" + bytes(100), "this version"),
        (block(10, (1,) * 6, bytes(10_000_000)), "does not inflate to the 60 bytes"),
        (block(10, (1,) * 6, bytes(59)), "does not inflate to the 60 bytes"),
        (block(2_000_000, (0,) * 6, b""), "this version"),
        (block(1, (9, 0, 0, 0, 0, 0), bytes(9)), "this version"),
        (block(1, (0, 0, 0, 0, 0, 1), b"\x04"), "no estimate is rounded to"),
        (block(1, (8, 0, 0, 0, 0, 0), b"\xff" * 8), "no estimate is rounded to"),
        (block(1, (1,) * 6, bytes(6))[:-1], "cut off"),
        (struct.pack("<4sII6B2x", b"PDE1", 1, 4, *([1] * 6)) + b"abcd", "inflated"),
    ],
)
def test_blocks_of_estimates_are_checked_before_they_grow(content: bytes, why: str) -> None:
    with pytest.raises(BundleError, match=why):
        coding.decode(content, "a walk")


def test_times_come_back_in_order_and_to_four_percent() -> None:
    step_s = np.random.default_rng(0).lognormal(-7.0, 1.0, 500)
    step_s[::50] = np.nan
    back = coding.times(coding.time_counts(step_s), 500)
    known = np.sort(step_s[np.isfinite(step_s)])
    assert np.abs(back[: len(known)] / known - 1.0).max() < 0.045
    assert np.isnan(back[len(known) :]).all()
    assert len(coding.times("0:9999999 1:9999999", 3)) == 3


def test_an_entry_is_written_and_read(bundle: Bundle, tmp_path: Path) -> None:
    (entry,) = bundle.entries()
    folder = write_entry(tmp_path, entry)
    assert folder == tmp_path / ENV / "mine-v0"
    assert list_entries(tmp_path) == [folder]
    again = read_entry(folder)
    assert again.submission == entry.submission and again.sha256 == entry.sha256
    assert (again.tier, again.division, again.suite) == ("self-reported", "online", "pdr-core-v2")
    assert [result.walk for result in again.results] == [walk.walk for walk in entry.record.walks]
    np.testing.assert_array_equal(again.results[0].estimates.xy_m, entry.results[0].estimates.xy_m)


@pytest.mark.parametrize("file", ["estimates.bin", "card.toml", "submission.json"])
def test_an_entry_that_was_changed_is_refused(bundle: Bundle, tmp_path: Path, file: str) -> None:
    folder = write_entry(tmp_path, bundle.entries()[0])
    raw = bytearray((folder / file).read_bytes())
    raw[len(raw) // 2] ^= 1
    (folder / file).write_bytes(bytes(raw))
    with pytest.raises(BundleError):
        read_entry(folder)


def test_an_entry_lies_where_it_belongs(bundle: Bundle, tmp_path: Path) -> None:
    folder = write_entry(tmp_path, bundle.entries()[0])
    moved = folder.rename(folder.with_name("better-v0"))
    with pytest.raises(BundleError, match="lies in"):
        read_entry(moved)
    with pytest.raises(BundleError, match="cannot read"):
        read_entry(folder)


def test_why_a_walk_failed_is_one_line_without_folders(bundle: Bundle) -> None:
    (entry,) = bundle.entries()
    traceback = 'Traceback (most recent call last):\n  File "/somewhere/secret/mine.py", line 3\nValueError: no idea\n'
    failed = dataclasses.replace(entry.results[0], status="failed", failure=traceback)
    assert walk_run(failed).failure == "ValueError: no idea"
    assert walk_run(entry.results[0]).failure == ""
