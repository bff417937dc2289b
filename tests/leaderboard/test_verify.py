"""Verification: a good bundle gives the same bytes, one with a single estimate changed is refused by name."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from pdrbench.errors import BundleError
from pdrbench.task import commitment
from pdrbench_leaderboard import coding, suites
from pdrbench_leaderboard import verify as verifying
from pdrbench_leaderboard.bundle import Bundle
from pdrbench_leaderboard.checking import check, check_bundle, code_remark
from pdrbench_leaderboard.entry import read_entry, write_entry
from pdrbench_leaderboard.pack import make_bundle, play_suite
from pdrbench_leaderboard.suites import OtherSecretError, Suite
from pdrbench_leaderboard.verify import Terms, first_difference, verify

from .conftest import NONCE, SECOND_NONCE, SECRET, card_named, signed_again

MakeTerms = Callable[..., Terms]
HERE = {"isolation": "none"}  # in this process, where isolation is not what is tested


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


def test_everything_is_run_again_and_with_a_second_nonce(
    packed: dict[str, Bundle], terms: MakeTerms, board: Path
) -> None:
    (one,) = verify(packed["Wanders"], terms())
    record, entry = one.record, one.entry
    assert one.differences == () and record is not None
    assert (entry.tier, record.reran, record.of, record.is_deterministic) == ("reproduced", 4, 4, False)
    assert (record.nonce, entry.submission.manifest.nonce) == (SECOND_NONCE, NONCE)
    again = read_entry(write_entry(board, entry))
    assert again.tier == "reproduced" and again.verification == record
    for sent, published in zip(again.sent, again.results, strict=True):
        assert np.array_equal(sent.estimates.t_s, published.estimates.t_s)
        assert not np.array_equal(sent.estimates.xy_m, published.estimates.xy_m)
    assert again.submission.run.walks["BuildingSite-v1"] != record.runs  # times are those of the second run
    assert all(run.cpu_s and run.cpu_s > 0 for run in record.runs)


def test_one_that_draws_nothing_is_run_once_for_both(packed: dict[str, Bundle], terms: MakeTerms, board: Path) -> None:
    (one,) = verify(packed["Mine"], terms(), **HERE)
    assert one.record is not None and one.record.is_deterministic and one.record.walks == ()
    folder = write_entry(board, one.entry)
    assert sorted(path.name for path in folder.iterdir()) == [
        "card.toml",
        "estimates.bin",
        "submission.json",
        "verification.json",
    ]
    assert read_entry(folder).tier == "reproduced"


def test_one_changed_estimate_is_refused_by_name(packed: dict[str, Bundle], terms: MakeTerms) -> None:
    (one,) = verify(tampered(packed["Wanders"], run=3, row=5, change=1), terms(), **HERE)
    (difference,) = one.differences
    walk = packed["Wanders"].manifest.environments[0].walks[3]
    assert f"walk {walk.walk}, seed 1: 1 of" in difference and "at 5 s: x_m was" in difference
    assert one.record is None and one.entry.tier == "self-reported"


def one_seed_of(bundle: Bundle) -> Bundle:
    """A bundle that says its localizer draws nothing: the luckiest of its seeds."""
    record = bundle.manifest.environments[0]
    kept = [index for index, walk in enumerate(record.walks) if walk.seed == 0]
    walks = tuple(record.walks[index] for index in kept)
    manifest = msgspec.structs.replace(
        bundle.manifest, environments=(msgspec.structs.replace(record, deterministic=True, walks=walks),)
    )
    run = bundle.run.walks[record.env]
    return dataclasses.replace(
        bundle,
        manifest=manifest,
        run=msgspec.structs.replace(bundle.run, walks={record.env: tuple(run[index] for index in kept)}),
        estimates=tuple(bundle.estimates[index] for index in kept),
    )


def test_the_luckiest_seed_does_not_stand(packed: dict[str, Bundle], terms: MakeTerms) -> None:
    lucky = one_seed_of(packed["Wanders"])
    assert check_bundle(lucky).passed  # it looks like one that draws nothing
    (one,) = verify(lucky, terms(), **HERE)
    assert "it says that it draws no random numbers" in one.differences[-1] and one.record is None


def test_an_environment_that_goes_badly_cannot_be_left_out(small_suite: Suite, terms: MakeTerms) -> None:
    suite_run = play_suite(["stay-v0"], small_suite, nonce=NONCE, **HERE)["stay-v0"]
    del suite_run.results["OfficeStride-v2"]
    suite_run.unsuitable["OfficeStride-v2"] = "no such sensor"
    bundle = make_bundle("stay-v0", card_named("stay-v0"), small_suite, suite_run)
    (one,) = verify(bundle, terms(), **HERE)
    assert one.differences == ("OfficeStride-v2: declined according to the bundle, complete when it is run",)


def test_a_spot_check_is_a_tier_of_its_own(
    packed: dict[str, Bundle], terms: MakeTerms, rng: np.random.Generator, board: Path
) -> None:
    (one,) = verify(packed["Wanders"], terms(share=0.5, draw=rng), **HERE)
    assert one.record is not None and (one.record.reran, one.record.of) == (2, 4)
    again = read_entry(write_entry(board, one.entry))
    assert again.tier == "spot-checked" and again.results == again.sent


def test_with_the_secret_it_walks_unseen_walks(
    packed: dict[str, Bundle], terms: MakeTerms, board: Path, tmp_path: Path, small_suite: Suite
) -> None:
    results = tmp_path / "walks"
    results.mkdir()
    (one,) = verify(packed["Mine"], terms(secrets=(SECRET,), results=results), **HERE)
    assert one.entry.tier == "verified" and one.record is not None
    found = one.record.held_out
    assert found is not None and (len(found.units), found.failed, found.declined) == (2, 0, 0)
    assert all(value is not None and value > 0.0 for value in found.values["p75_level_penalised_m"])
    assert {result.split for result in one.entry.results} == {"test"}
    folder = write_entry(board, one.entry)
    assert read_entry(folder).tier == "verified"
    estimates = next(results.glob("held_out/*/*/held_out.bin"))
    assert not list(folder.glob("held_out.bin"))  # they lie near the truth, and others are still to be verified
    assert all(SECRET.encode() not in path.read_bytes() for path in folder.iterdir())
    (folder / "held_out.bin").write_bytes(estimates.read_bytes())  # when the round is over
    assert read_entry(folder).tier == "verified"
    published = msgspec.structs.replace(small_suite, commitment="0" * 64, published=(SECRET,))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(suites, "suites", lambda: {published.name: published})
        (scores,) = [finding for finding in check(folder).findings if finding.name.endswith("held-out scores")]
        assert scores.passed
        better = {name: [0.5, *values[1:]] for name, values in found.values.items()}
        signed_again(folder, board.parent / "maintainer.key", held_out=msgspec.to_builtins(found) | {"values": better})
        (scores,) = [finding for finding in check(folder).findings if finding.name.endswith("held-out scores")]
        assert not scores.passed and "do not come out of the estimates" in scores.why
    (folder / "held_out.bin").write_bytes(estimates.read_bytes()[:-1])
    with pytest.raises(BundleError, match="not what came of the held-out walks"):
        read_entry(folder)


def test_another_secret_is_refused(packed: dict[str, Bundle], terms: MakeTerms) -> None:
    with pytest.raises(OtherSecretError, match="sha256 differs"):
        verify(packed["Mine"], terms(secrets=("another" * 8,)))


def test_leaderboards_of_a_suite_have_rounds_of_their_own(small_suite: Suite) -> None:
    first, second = small_suite.environments
    other = msgspec.structs.replace(second, commitment=commitment("other" * 8))
    suite = msgspec.structs.replace(small_suite, environments=(first, other))
    secrets = (SECRET, "other" * 8)
    assert [suite.secret_of(listed.env, secrets) for listed in suite.environments] == [*secrets]
    assert [suite.environments_of(secret) for secret in secrets] == [[first.env], [second.env]]
    assert suite.secret_of(first.env, ()) is None
    with pytest.raises(OtherSecretError, match=f"small-v0 in {second.env}"):
        suite.secret_of(second.env, (SECRET,))


@pytest.mark.parametrize("name", ["Unsteady", "UnsteadyElsewhere"])
def test_answers_that_change_from_run_to_run_are_found(
    small_suite: Suite, submitted: Path, terms: MakeTerms, name: str
) -> None:
    spec = f"{submitted}:{name}"
    suite_run = play_suite([spec], small_suite, seeds=1, envs=["BuildingSite-v1"], nonce=NONCE, **HERE)[spec]
    bundle = make_bundle(spec, card_named("unsteady-v0"), small_suite, suite_run, seeds=1)
    (one,) = verify(bundle, terms(secrets=(SECRET,)), **HERE)
    unseen = ["not the same twice" in what for what in one.differences]
    assert unseen == ([False, False, True, True] if name == "Unsteady" else [True, True])


def test_one_that_knows_the_future_is_refused(
    packed: dict[str, Bundle], terms: MakeTerms, monkeypatch: pytest.MonkeyPatch
) -> None:
    walks = []

    def foresees(result: object, *_: object, secret: str | None) -> SimpleNamespace:
        walks.append(secret)
        return SimpleNamespace(difference="of 9 observations: the answer at 3 s is another")

    monkeypatch.setattr(verifying, "check_prefixes", foresees)
    (one,) = verify(packed["Mine"], terms(secrets=(SECRET,)), isolation="process")
    assert walks == [SECRET, None] and all("it knows the future" in what for what in one.differences)
    assert one.record is None


def test_without_its_source_only_its_authors_can_run_it(packed: dict[str, Bundle], terms: MakeTerms) -> None:
    bundle = packed["Mine"]
    manifest = msgspec.structs.replace(bundle.manifest, source={})
    with pytest.raises(BundleError, match="without its source"):
        verify(dataclasses.replace(bundle, manifest=manifest, source={}), terms())


def test_other_code_refuses_nothing(packed: dict[str, Bundle], terms: MakeTerms) -> None:
    bundle = packed["Wanders"]
    assert code_remark(bundle.manifest) == ""
    other = "0123456789abcdef" * 4
    changed = dataclasses.replace(bundle, manifest=msgspec.structs.replace(bundle.manifest, core_sha256=other))
    assert "code of pdrbench" in code_remark(changed.manifest)
    (one,) = verify(changed, terms(), **HERE)
    assert one.differences == ()
    assert one.record is not None and one.record.core_sha256 == bundle.manifest.core_sha256  # what really ran
    checked = check_bundle(changed)
    assert checked.passed
    assert [finding.passed for finding in checked.findings if finding.name == "code"] == [False]
    registered = msgspec.structs.replace(bundle.manifest, source={}, localizer="stay-v0", spec="stay-v0")
    assert "code of stay-v0" in code_remark(registered)


def test_the_file_that_is_run_is_in_the_bundle(packed: dict[str, Bundle], terms: MakeTerms) -> None:
    manifest = msgspec.structs.replace(packed["Mine"].manifest, spec="other.py:Mine")
    with pytest.raises(BundleError, match="not in its source"):
        verify(dataclasses.replace(packed["Mine"], manifest=manifest), terms())


@pytest.mark.parametrize("share", [0.0, -1.0, 1.5, float("nan")])
def test_fractions_outside_0_to_1_are_errors(packed: dict[str, Bundle], terms: MakeTerms, share: float) -> None:
    with pytest.raises(BundleError, match="share"):
        verify(packed["Mine"], terms(share=share))


def test_the_first_difference_in_closed_form() -> None:
    packed = np.zeros((6, 4), dtype=np.int64)
    again = packed.copy()
    again[1, 2], again[0, 3] = 12, 1
    assert first_difference(packed, again, 0.5) == ("2 of 4 estimates differ, the first at 1 s: y_m was 0, is 0.0012")
    assert first_difference(packed, packed[:, :3], 0.5) == "4 estimates were packed, 3 came"
