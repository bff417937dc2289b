"""Verification: a good bundle gives the same bytes, one with a single estimate changed is refused by name."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import msgspec
import numpy as np
import pytest

from pdrbench.errors import BundleError
from pdrbench_leaderboard import coding
from pdrbench_leaderboard.bundle import Bundle
from pdrbench_leaderboard.checking import check_bundle, code_remark
from pdrbench_leaderboard.entry import read_entry, write_entry
from pdrbench_leaderboard.pack import make_bundle, play_suite
from pdrbench_leaderboard.suites import Suite
from pdrbench_leaderboard.verify import first_difference, verify

from .conftest import SECRET, card_named


def tampered(bundle: Bundle, run: int, row: int, change: int) -> Bundle:
    """The bundle with one estimate moved by some 0.1 mm, and every digest made to fit."""
    estimates = [whole.copy() for whole in bundle.estimates]
    estimates[run][0, row] += change
    record = bundle.manifest.environments[0]
    walks = list(record.walks)
    walks[run] = msgspec.structs.replace(walks[run], sha256=coding.digest(estimates[run]))
    records = (msgspec.structs.replace(record, walks=tuple(walks)),)
    manifest = msgspec.structs.replace(bundle.manifest, environments=records)
    return dataclasses.replace(bundle, manifest=manifest, estimates=tuple(estimates))


def test_a_good_bundle_is_reproduced(packed: dict[str, Bundle], rng: np.random.Generator, tmp_path: Path) -> None:
    differences, entries = verify(packed["Wanders"], rng, share=0.5)
    assert differences == []
    (entry,) = entries
    found = entry.submission.verification
    assert entry.tier == "reproduced"
    assert found is not None and found.held_out is None
    assert (found.reran, found.of, found.is_deterministic) == (2, 4, True)
    assert read_entry(write_entry(tmp_path, entry)).tier == "reproduced"


def test_one_changed_estimate_is_refused_by_name(packed: dict[str, Bundle], rng: np.random.Generator) -> None:
    differences, entries = verify(tampered(packed["Wanders"], run=3, row=5, change=1), rng, share=1.0)
    (difference,) = differences
    walk = packed["Wanders"].manifest.environments[0].walks[3]
    assert f"walk {walk.walk}, seed 1: 1 of" in difference and "at 5 s: x_m was" in difference
    assert entries[0].tier == "self-reported"


def test_with_the_secret_it_walks_unseen_walks(
    packed: dict[str, Bundle], rng: np.random.Generator, tmp_path: Path
) -> None:
    _, entries = verify(packed["Mine"], rng, secret=SECRET)
    (entry,) = entries
    assert entry.tier == "verified"
    found = entry.submission.verification
    assert found is not None and found.held_out is not None
    assert found.held_out.walks == 2
    value = found.held_out.metrics["mean_m"][0]
    assert value is not None and value > 0.0
    assert {result.split for result in entry.results} == {"test"}
    folder = write_entry(tmp_path, entry)
    assert all(SECRET.encode() not in path.read_bytes() for path in folder.iterdir())


def test_another_secret_is_refused(packed: dict[str, Bundle], rng: np.random.Generator) -> None:
    with pytest.raises(BundleError, match="sha256 differs"):
        verify(packed["Mine"], rng, secret="another" * 8)


def test_answers_that_change_from_run_to_run_are_found(
    small_suite: Suite, submitted: Path, rng: np.random.Generator
) -> None:
    spec = f"{submitted}:Unsteady"
    suite_run = play_suite([spec], small_suite, seeds=1, envs=["BuildingSite-v0"])[spec]
    bundle = make_bundle(spec, card_named("unsteady-v0"), small_suite, suite_run, seeds=1)
    assert len(verify(bundle, rng, share=1.0)[0]) == 2


def test_without_its_source_only_its_authors_can_run_it(packed: dict[str, Bundle], rng: np.random.Generator) -> None:
    bundle = packed["Mine"]
    manifest = msgspec.structs.replace(bundle.manifest, source={})
    with pytest.raises(BundleError, match="without its source"):
        verify(dataclasses.replace(bundle, manifest=manifest, source={}), rng)


def test_other_code_refuses_nothing(packed: dict[str, Bundle], rng: np.random.Generator) -> None:
    bundle = packed["Wanders"]
    assert code_remark(bundle.manifest) == ""
    changed = dataclasses.replace(bundle, manifest=msgspec.structs.replace(bundle.manifest, core_sha256="0" * 64))
    assert "code of pdrbench" in code_remark(changed.manifest)
    assert verify(changed, rng)[0] == []
    checked = check_bundle(changed)
    assert checked.passed
    assert [finding.passed for finding in checked.findings if finding.name == "code"] == [False]
    registered = msgspec.structs.replace(bundle.manifest, source={}, localizer="stay-v0", spec="stay-v0")
    assert "code of stay-v0" in code_remark(registered)


def test_the_file_that_is_run_is_in_the_bundle(packed: dict[str, Bundle], rng: np.random.Generator) -> None:
    manifest = msgspec.structs.replace(packed["Mine"].manifest, spec="other.py:Mine")
    with pytest.raises(BundleError, match="not in its source"):
        verify(dataclasses.replace(packed["Mine"], manifest=manifest), rng)


@pytest.mark.parametrize("share", [0.0, -1.0, 1.5, float("nan")])
def test_fractions_outside_0_to_1_are_errors(packed: dict[str, Bundle], rng: np.random.Generator, share: float) -> None:
    with pytest.raises(BundleError, match="share"):
        verify(packed["Mine"], rng, share=share)


def test_the_first_difference_in_closed_form() -> None:
    packed = np.zeros((6, 4), dtype=np.int64)
    again = packed.copy()
    again[1, 2], again[0, 3] = 12, 1
    assert first_difference(packed, again, 0.5) == ("2 of 4 estimates differ, the first at 1 s: y_m was 0, is 0.0012")
    assert first_difference(packed, packed[:, :3], 0.5) == "4 estimates were packed, 3 came"
