"""A small suite, a file of submitted localizers, and a bundle of one of them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from pdrbench.task import commitment
from pdrbench_leaderboard import suites
from pdrbench_leaderboard.bundle import Bundle
from pdrbench_leaderboard.card import EXAMPLE, Card
from pdrbench_leaderboard.pack import make_bundle, play_suite
from pdrbench_leaderboard.suites import Suite, SuiteEnvironment

SECRET = "5ec2e7" * 8
SUBMITTED = '''
import os

import numpy as np

from pdrbench import Estimate


class Mine:
    """Answers where the inertial system believes to be; a stray number makes it wander."""

    spread_m = 0.0

    def reset(self, briefing, rng):
        briefing.require(sensors=("position",))
        self.rng, self.xy_m, self.level = rng, np.zeros(2), 0

    def step(self, observation):
        for row in observation["position"]:
            self.xy_m = row[1:3]
        return Estimate(xy_m=self.xy_m + self.rng.normal(0.0, self.spread_m, 2), level=self.level)


class Wanders(Mine):
    spread_m = 0.5


class Unsteady(Mine):
    """Answers differ from process to process."""

    def step(self, observation):
        estimate = super().step(observation)
        return Estimate(xy_m=estimate.xy_m + 1e-3 * int.from_bytes(os.urandom(2), "big"), level=self.level)


class Broken(Mine):
    def step(self, observation):
        raise ValueError("no idea")


class Smooths(Mine):
    def revise(self):
        return np.array([[0.0, *self.xy_m, self.level]])
'''


@pytest.fixture(scope="session")
def submitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """File with the classes above."""
    path = tmp_path_factory.mktemp("elsewhere") / "submitted.py"
    path.write_text(SUBMITTED)
    return path


@pytest.fixture(scope="session")
def small_suite() -> Iterator[Suite]:
    """Two walks each of two environments, one of which the submitted ones decline; the only suite while in use."""
    suite = Suite(
        name="small-v0",
        summary="For tests.",
        seeds=2,
        metrics=("p75_level_penalised_m", "mean_m", "availability"),
        environments=(
            SuiteEnvironment(env="BuildingSite-v0", walks=2, noise_m=0.05),
            SuiteEnvironment(env="OfficeStride-v0", walks=1, noise_m=0.05),
        ),
        commitment=commitment(SECRET),
        held_out_walks=2,
    )
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(suites, "suites", lambda: {suite.name: suite})
        yield suite


def card_named(name: str, **changes: object) -> Card:
    return msgspec.structs.replace(EXAMPLE, name=name, **{"sensors_used": ("position",), **changes})


@pytest.fixture(scope="session")
def packed(small_suite: Suite, submitted: Path) -> dict[str, Bundle]:
    """Bundles of `Mine` and `Wanders`, by class."""
    specs = {name: f"{submitted}:{name}" for name in ("Mine", "Wanders")}
    suite_runs = play_suite(list(specs.values()), small_suite)
    return {
        name: make_bundle(spec, card_named(f"{name.lower()}-v0"), small_suite, suite_runs[spec])
        for name, spec in specs.items()
    }
