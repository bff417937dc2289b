"""Verification: a good bundle comes to the same, one with changed estimates is refused by name."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import msgspec
import numpy as np
import pytest

from pdrbench.errors import BundleError
from pdrbench.evaluation import answers
from pdrbench.task import commitment
from pdrbench_leaderboard import suites
from pdrbench_leaderboard import verify as verifying
from pdrbench_leaderboard.bundle import Bundle
from pdrbench_leaderboard.checking import check, check_bundle
from pdrbench_leaderboard.entry import encode_results, read_entry, write_entry
from pdrbench_leaderboard.pack import make_bundle, play_suite
from pdrbench_leaderboard.suites import OtherSecretError, Suite
from pdrbench_leaderboard.verify import Terms, verify

from .conftest import NONCE, SECOND_NONCE, SECRET, STAY, card_named, signed_again

MakeTerms = Callable[..., Terms]


def tampered(bundle: Bundle, run: int, change_m: float) -> Bundle:
    """The bundle with one walk moved, and every digest made to fit."""
    (record,) = bundle.manifest.environments
    content, blocks, begin = bundle.estimates[record.env], [], 0
    for _ in record.walks:
        whole, begin = answers.decode(content, record.env, begin)
        blocks.append(whole.copy())
    blocks[run][0] += round(change_m * 1e4)
    content = b"".join(map(answers.encode, blocks))
    sha256 = hashlib.sha256(content).hexdigest()
    records = (msgspec.structs.replace(record, estimates_sha256=sha256),)
    manifest = msgspec.structs.replace(bundle.manifest, environments=records)
    return dataclasses.replace(bundle, manifest=manifest, estimates={record.env: content})


def test_everything_is_run_again_and_with_a_second_nonce(
    packed: dict[str, Bundle], terms: MakeTerms, board: Path
) -> None:
    (one,) = verify(packed["Wanders"], terms())
    record, entry = one.record, one.entry
    assert one.differences == () and record is not None
    assert (entry.tier, record.reran, record.of) == ("reproduced", 6, 6)
    assert (record.nonce, entry.manifest.nonce) == (SECOND_NONCE, NONCE)
    again = read_entry(write_entry(board, entry))
    assert again.tier == "reproduced" and again.verification == record
    for sent, published in zip(again.sent, again.results, strict=True):
        assert np.array_equal(sent.estimates.t_s, published.estimates.t_s)
        assert not np.array_equal(sent.estimates.xy_m, published.estimates.xy_m)
    assert all(walk.cpu_s and walk.cpu_s > 0 for walk in record.walks)  # times are those of the second run
    assert "seccomp" in entry.isolation_modes[0], "strangers' code is confined"


def one_seed_of(bundle: Bundle) -> Bundle:
    """A bundle that says its localizer draws nothing: the luckiest of its seeds."""
    (record,), (entry,) = bundle.manifest.environments, bundle.entries()
    content = encode_results([result for result in entry.sent if result.seed == 0])
    walks = tuple(walk for walk in record.walks if walk.seed == 0)
    sha256 = hashlib.sha256(content).hexdigest()
    record = msgspec.structs.replace(record, deterministic=True, walks=walks, estimates_sha256=sha256)
    manifest = msgspec.structs.replace(bundle.manifest, environments=(record,))
    return dataclasses.replace(bundle, manifest=manifest, estimates={record.env: content})


def test_the_luckiest_seed_does_not_stand(packed: dict[str, Bundle], terms: MakeTerms) -> None:
    lucky = one_seed_of(packed["Wanders"])
    assert check_bundle(lucky).passed  # it looks like one that draws nothing
    (one,) = verify(lucky, terms())
    assert "it says that it draws no random numbers" in one.differences[-1] and one.record is None


def test_an_environment_that_goes_badly_cannot_be_left_out(small_suite: Suite, terms: MakeTerms) -> None:
    suite_run = play_suite([STAY], small_suite, nonce=NONCE, isolation="none")[STAY]
    del suite_run.results["ToyDeaf-v1"]
    suite_run.unsuitable["ToyDeaf-v1"] = "no such sensor"
    bundle = make_bundle(STAY, card_named(STAY), small_suite, suite_run)
    (one,) = verify(bundle, terms())
    assert one.differences == ("ToyDeaf-v1: declined according to the bundle, complete when it is run",)


def test_a_spot_check_is_a_tier_of_its_own(
    packed: dict[str, Bundle], terms: MakeTerms, rng: np.random.Generator, board: Path
) -> None:
    (one,) = verify(packed["Wanders"], terms(share=0.5, draw=rng))
    assert one.record is not None and (one.record.reran, one.record.of) == (4, 6)
    again = read_entry(write_entry(board, one.entry))
    assert again.tier == "spot-checked" and again.results == again.sent


def test_with_the_secret_it_walks_unseen_walks(
    packed: dict[str, Bundle], terms: MakeTerms, board: Path, tmp_path: Path, small_suite: Suite
) -> None:
    results = tmp_path / "walks"
    results.mkdir()
    (one,) = verify(packed["Mine"], terms(secrets=(SECRET,), results=results))
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
    with pytest.raises(BundleError, match="digest is another"):
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
    with pytest.raises(OtherSecretError, match=f"small-v1 in {second.env}"):
        suite.secret_of(second.env, (SECRET,))


def test_answers_that_change_from_run_to_run_on_unseen_walks_are_found(
    small_suite: Suite, submitted: Path, terms: MakeTerms
) -> None:
    spec = f"{submitted}:UnsteadyElsewhere"
    suite_run = play_suite([spec], small_suite, seeds=1, envs=["Toy-v1"], nonce=NONCE, isolation="none")[spec]
    bundle = make_bundle(spec, card_named("unsteady"), small_suite, suite_run, seeds=1)
    (one,) = verify(bundle, terms(secrets=(SECRET,)))
    assert one.differences and all("not the same twice" in what for what in one.differences)
    assert not any("heldout" in what for what in one.differences), "names of held-out walks are secret"


def test_one_that_knows_the_future_is_refused(
    packed: dict[str, Bundle], terms: MakeTerms, monkeypatch: pytest.MonkeyPatch
) -> None:
    walks = []

    def foresees(result: object, *_: object, secret: str | None) -> SimpleNamespace:
        walks.append(secret)
        return SimpleNamespace(difference="of 9 observations: the answer at 3 s is another")

    monkeypatch.setattr(verifying, "check_prefixes", foresees)
    (one,) = verify(packed["Mine"], terms(secrets=(SECRET,)))
    assert walks == [SECRET, None] and all("it knows the future" in what for what in one.differences)
    assert one.record is None


def test_without_its_source_only_its_authors_can_run_it(packed: dict[str, Bundle], terms: MakeTerms) -> None:
    bundle = packed["Mine"]
    manifest = msgspec.structs.replace(bundle.manifest, source={})
    with pytest.raises(BundleError, match="without its source"):
        verify(dataclasses.replace(bundle, manifest=manifest, source={}), terms())


def test_the_file_that_is_run_is_in_the_bundle(packed: dict[str, Bundle], terms: MakeTerms) -> None:
    manifest = msgspec.structs.replace(packed["Mine"].manifest, spec="other.py:Mine")
    with pytest.raises(BundleError, match="not in its source"):
        verify(dataclasses.replace(packed["Mine"], manifest=manifest), terms())


@pytest.mark.parametrize("share", [0.0, -1.0, 1.5, float("nan")])
def test_fractions_outside_0_to_1_are_errors(packed: dict[str, Bundle], terms: MakeTerms, share: float) -> None:
    with pytest.raises(BundleError, match="share"):
        verify(packed["Mine"], terms(share=share))
