"""Packing: runs, seeds where they matter, and the same bytes each time."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import BundleError
from pdrbench.registry import environments, make_task
from pdrbench.task import HELD_OUT, commitment
from pdrbench_leaderboard import pack
from pdrbench_leaderboard.bundle import Bundle, write_bundle
from pdrbench_leaderboard.pack import make_bundle, play_suite
from pdrbench_leaderboard.suites import Suite, suites

from .conftest import SECRET, STAY, card_named

HERE = {"isolation": "none"}  # in this process, where isolation is not what is tested


def test_seeds_are_kept_where_they_matter(packed: dict[str, Bundle]) -> None:
    mine, wanders = (packed[name].manifest.environments for name in ("Mine", "Wanders"))
    assert [record.env for record in mine] == ["Toy-v1"]
    assert mine[0].deterministic
    assert [walk.seed for walk in mine[0].walks] == [0, 0, 0]
    assert not wanders[0].deterministic
    assert [walk.seed for walk in wanders[0].walks] == [0, 1] * 3


def test_no_path_of_the_submitter_is_packed(packed: dict[str, Bundle], submitted: Path) -> None:
    content = write_bundle(packed["Mine"])
    assert str(submitted.parent).encode() not in content
    assert packed["Mine"].manifest.spec == "submitted.py:Mine"
    assert packed["Mine"].source["submitted.py"] == submitted.read_bytes()


def test_scores_are_those_of_the_rounded_estimates(packed: dict[str, Bundle]) -> None:
    (entry,) = packed["Wanders"].entries()
    xy_m = entry.results[0].estimates.xy_m
    np.testing.assert_allclose(xy_m * 1e4, np.rint(xy_m * 1e4), atol=1e-6)
    period_s = make_task(entry.env).period_s
    np.testing.assert_array_equal(entry.results[0].estimates.t_s, np.arange(len(xy_m)) * period_s)


def test_a_localizer_that_fails_everywhere_or_suits_nothing_is_not_packed(small_suite: Suite, submitted: Path) -> None:
    spec = f"{submitted}:Broken"
    suite_run = play_suite([spec], small_suite, envs=["Toy-v1"], **HERE)[spec]
    with pytest.raises(BundleError, match="ValueError: no idea"):
        make_bundle(spec, card_named("broken"), small_suite, suite_run)
    suite_run = play_suite([spec], small_suite, envs=["ToyDeaf-v1"], **HERE)[spec]
    with pytest.raises(BundleError, match="answers no available environment"):
        make_bundle(spec, card_named("broken"), small_suite, suite_run)


def test_an_entry_is_of_the_division_of_its_card(small_suite: Suite, submitted: Path) -> None:
    spec = f"{submitted}:Smooths"
    suite_run = play_suite([spec], small_suite, envs=["Toy-v1"], **HERE)[spec]
    for division in ("online", "offline"):
        bundle = make_bundle(spec, card_named("smooths", division=division), small_suite, suite_run)
        assert [entry.division for entry in bundle.entries()] == [division]
    spec = f"{submitted}:Mine"
    suite_run = play_suite([spec], small_suite, envs=["Toy-v1"], **HERE)[spec]
    with pytest.raises(BundleError, match="'online'"):
        make_bundle(spec, card_named("mine", division="offline"), small_suite, suite_run)


def test_data_that_is_not_available_is_reported(small_suite: Suite, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pack, "has_data", lambda env: env != "Toy-v1")
    suite_run = play_suite([STAY], small_suite, seeds=1, **HERE)[STAY]
    bundle = make_bundle(STAY, card_named(STAY), small_suite, suite_run, seeds=1)
    assert bundle.manifest.absent == ("Toy-v1",)
    assert [record.env for record in bundle.manifest.environments] == ["ToyDeaf-v1"]


def test_the_suites_together_are_the_environments_of_the_product() -> None:
    chosen = [listed.env for suite in suites().values() for listed in suite.environments if suite.name != "small-v1"]
    assert len(chosen) == len(set(chosen))
    assert set(chosen) == {name for name, entry in environments().items() if entry.package == "pdrbench"}
    core = {listed.env for listed in suites()["pdr-core-v3"].environments}
    assert core == {name for name in chosen if make_task(name).dataset is None}


def test_boards_rest_on_eight_held_out_walks_or_more() -> None:
    for suite in (suite for suite in suites().values() if suite.name != "small-v1"):
        for listed in suite.environments:
            task = make_task(listed.env, SECRET)
            assert min(suite.held_out_walks, len(task.split(HELD_OUT))) >= 8, listed.env
            assert min(listed.walks, len(task.split("test"))) >= 6, listed.env
            assert suite.round_of(listed.env) not in map(commitment, suite.published)
