"""Checking: rules that refuse, flags that do not, each with a submission that breaks it."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import pytest

from pdrbench.evaluation import answers
from pdrbench.trajectory import Estimates
from pdrbench_leaderboard import schema
from pdrbench_leaderboard.bundle import Bundle, write_bundle
from pdrbench_leaderboard.checking import check, check_bundle
from pdrbench_leaderboard.entry import Entry, write_entry
from pdrbench_leaderboard.plausibility import Finding, flags, is_fast
from pdrbench_leaderboard.suites import SuiteEnvironment

from .conftest import STAY, card_named

LISTED = SuiteEnvironment(env="Toy-v1", walks=3, noise_m=0.05)


def with_manifest(bundle: Bundle, **changes: Any) -> Bundle:
    return dataclasses.replace(bundle, manifest=msgspec.structs.replace(bundle.manifest, **changes))


def changed(entry: Entry, change: Callable[[answers.Whole], answers.Whole]) -> Entry:
    """The entry with other estimates."""
    results = tuple(
        dataclasses.replace(
            result,
            estimates=answers.from_whole_numbers(
                change(answers.whole_numbers(result.estimates)), np.array(result.estimates.t_s)
            ),
        )
        for result in entry.results
    )
    return dataclasses.replace(entry, results=results)


def flag(entry: Entry, name: str, listed: SuiteEnvironment = LISTED) -> Finding:
    (found,) = [finding for finding in flags(entry, listed) if name in finding.name]
    assert found.is_flag
    return found


def broken(findings: tuple[Finding, ...]) -> list[str]:
    return [f"{finding.name}: {finding.why}" for finding in findings if not finding.passed and not finding.is_flag]


def test_a_good_bundle_passes_and_scores(packed: dict[str, Bundle], tmp_path: Path) -> None:
    path = tmp_path / "mine.pdrz"
    path.write_bytes(write_bundle(packed["Mine"]))
    checked = check(path)
    assert checked.passed, broken(checked.findings)
    (scores,) = [finding.why for finding in checked.findings if finding.name.endswith("scores")]
    assert "mean_m" in scores and "availability 1" in scores
    folder = write_entry(tmp_path, checked.entries[0])
    assert check(folder).passed


@pytest.mark.parametrize("name", ["mine\n", "mine/..", ""])
def test_names_hold_nothing_but_their_signs(name: str) -> None:
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(name, schema.Name)
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert(f"{'0' * 64}\n", schema.Sha256)


@pytest.mark.parametrize("content", [b"", b"PK", b"\x00" * 1000])
def test_a_file_that_is_no_bundle_is_one_finding(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x.pdrz").write_bytes(content)
    checked = check(tmp_path / "x.pdrz")
    assert len(checked.findings) == 1 and not checked.passed
    assert not check(tmp_path / "nothing.pdrz").passed
    assert not check(tmp_path).passed


def test_a_registered_name_belongs_to_its_author(packed: dict[str, Bundle]) -> None:
    bundle = dataclasses.replace(packed["Mine"], card=card_named(STAY))
    found = broken(check_bundle(with_manifest(bundle, localizer=STAY)).findings)
    assert f"{STAY} is registered" in found[0]


def test_sensors_that_do_not_exist_are_refused(packed: dict[str, Bundle]) -> None:
    bundle = dataclasses.replace(packed["Mine"], card=card_named("mine", sensors_used=("sixth sense",)))
    assert "no sensor is named sixth sense" in broken(check_bundle(bundle).findings)[0]


def test_flags_of_a_correct_entry(packed: dict[str, Bundle]) -> None:
    (entry,) = packed["Mine"].entries()
    assert flag(entry, "better than the reference").passed
    assert flag(entry, "keeps moving").passed
    assert flag(entry, "3 m/s").passed
    assert flag(entry, "unsure").passed
    assert flag(entry, "claims").passed


def test_better_than_the_reference(packed: dict[str, Bundle]) -> None:
    (entry,) = packed["Mine"].entries()
    assert not flag(entry, "better than", msgspec.structs.replace(LISTED, noise_m=1000.0)).passed


def test_seeds_that_change_nothing(packed: dict[str, Bundle]) -> None:
    (entry,) = packed["Wanders"].entries()
    assert flag(entry, "seeds").passed
    first = {result.walk: result for result in entry.sent if result.seed == 0}
    same = tuple(dataclasses.replace(result, estimates=first[result.walk].estimates) for result in entry.sent)
    assert not flag(dataclasses.replace(entry, sent=same), "seeds").passed


def test_standing_still(packed: dict[str, Bundle]) -> None:
    (entry,) = packed["Mine"].entries()
    frozen = changed(entry, lambda whole: np.repeat(whole[:, :1], whole.shape[1], axis=1))
    assert not flag(frozen, "keeps moving").passed
    still = msgspec.structs.replace(LISTED, still=True)
    assert not [finding for finding in flags(frozen, still) if "keeps moving" in finding.name]


def test_outside_and_teleporting(packed: dict[str, Bundle]) -> None:
    (entry,) = packed["Mine"].entries()

    def away(whole: answers.Whole) -> answers.Whole:
        moved = whole.copy()
        moved[0, ::7] += 1_000_000
        return moved

    jumps = changed(entry, away)
    assert not flag(jumps, "inside").passed
    assert not flag(jumps, "3 m/s").passed


def test_missing_answers_when_unsure_are_flagged(packed: dict[str, Bundle]) -> None:
    (entry,) = packed["Mine"].entries()

    def silent(whole: answers.Whole) -> answers.Whole:
        changed = whole.copy()
        changed[:3, whole.shape[1] // 2 :] = answers.NAN
        return changed

    assert not flag(changed(entry, silent), "unsure").passed


@pytest.mark.parametrize("sigma", [0, -1, answers.PLUS])
def test_claims_that_make_no_sense(packed: dict[str, Bundle], sigma: int) -> None:
    (entry,) = packed["Mine"].entries()

    def claims(whole: answers.Whole) -> answers.Whole:
        changed = whole.copy()
        changed[4] = sigma
        return changed

    assert not flag(changed(entry, claims), "claims").passed


def test_unisolated_runs(packed: dict[str, Bundle]) -> None:
    (entry,) = packed["Mine"].entries()
    for way, passed in (({"mode": "none"}, False), ({"mode": "landlock+namespaces"}, True), ({}, False)):
        one = dataclasses.replace(entry, manifest=msgspec.structs.replace(entry.manifest, isolation=(way,)))
        assert flag(one, "isolated").passed == passed


def line(xy_m: np.ndarray) -> Estimates:
    nothing = np.full(len(xy_m), np.nan)
    level = np.where(np.isnan(xy_m[:, 0]), np.nan, 0.0)
    return Estimates(np.arange(len(xy_m)) * 1.0, xy_m, level, nothing, nothing, nothing)


def test_speed_in_closed_form() -> None:
    slow = np.column_stack([np.arange(20) * 2.9, np.zeros(20)])
    fast = np.column_stack([np.arange(20) * 3.1, np.zeros(20)])
    assert is_fast(line(slow)).tolist() == [0.0] * 15
    assert is_fast(line(fast)).tolist() == [1.0] * 15
    assert len(is_fast(line(np.full((9, 2), np.nan)))) == 0
