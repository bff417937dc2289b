"""A toy package with environments, a small suite, a file of submitted localizers, and a bundle of one of them."""

from __future__ import annotations

import datetime
import importlib
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from pdrbench import registry
from pdrbench.registry import make_task
from pdrbench.task import commitment
from pdrbench_leaderboard import signing, suites
from pdrbench_leaderboard.bundle import Bundle
from pdrbench_leaderboard.card import EXAMPLE, Card
from pdrbench_leaderboard.pack import make_bundle, play_suite
from pdrbench_leaderboard.suites import Suite, SuiteEnvironment
from pdrbench_leaderboard.verify import Terms

ENV, DEAF = "Toy-v1", "ToyDeaf-v1"  # submitted localizers decline the second
STAY = "stay"  # a registered localizer
SECRET = "5ec2e7" * 8
NONCE, SECOND_NONCE = "0123456789abcdef" * 2, "fedcba9876543210" * 2
SUBMITTED = '''
import os

import numpy as np

from pdrbench import Estimate


class Mine:
    """Answers where the inertial system believes to be; a stray number makes it wander."""

    spread_m = 0.0

    def reset(self, briefing, rng):
        briefing.require(sensors=("position",))
        self.rng, self.xy_m, self.level = rng, briefing.start.xy_m, 0

    def step(self, observation):
        for row in observation["position"]:
            self.xy_m = row[1:3]
        return Estimate(xy_m=self.xy_m + self.rng.normal(0.0, self.spread_m, 2), level=self.level)


class Wanders(Mine):
    spread_m = 0.5


class UnsteadyElsewhere(Mine):
    """Answers differ from process to process on walks that it does not know."""

    def step(self, observation):
        estimate = super().step(observation)
        noise_m = 1e-3 * int.from_bytes(os.urandom(2), "big") if self.is_elsewhere else 0.0
        return Estimate(xy_m=estimate.xy_m + noise_m, level=self.level)

    def reset(self, briefing, rng):
        super().reset(briefing, rng)
        self.is_elsewhere = round(float(briefing.building.edge_start_xy_m.sum()), 3) not in KNOWN_M


class Broken(Mine):
    def step(self, observation):
        raise ValueError("no idea")


class Smooths(Mine):
    def revise(self):
        return np.array([[0.0, *self.xy_m, self.level]])
'''


def clear_registry() -> None:
    registry._scan.cache_clear()
    registry.registered_task.cache_clear()
    importlib.invalidate_caches()


@pytest.fixture(scope="session", autouse=True)
def toy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The toy package is installed, as pip leaves it: a module, and the entry points of its distribution."""
    root = tmp_path_factory.mktemp("site")
    shutil.copy(Path(__file__).parent / "toy" / "toy_boards.py", root)
    about = root / "toy_boards-0.1.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: toy-boards\nVersion: 0.1\n")
    (about / "entry_points.txt").write_text("[pdrbench.environments]\nx = toy_boards:ENVIRONMENTS\n")
    sys.path.insert(0, str(root))
    clear_registry()
    yield
    sys.path.remove(str(root))
    clear_registry()


@pytest.fixture(scope="session")
def submitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """File with the classes above."""
    path = tmp_path_factory.mktemp("elsewhere") / "submitted.py"
    task = make_task(ENV)
    buildings = [task.load(walk).building for walk in task.split("test")[:3]]
    known_m = [round(float(building.edge_start_xy_m.sum()), 3) for building in buildings if building is not None]
    path.write_text(f"KNOWN_M = {known_m}\n{SUBMITTED}")
    return path


@pytest.fixture(scope="session")
def small_suite() -> Iterator[Suite]:
    """Walks of two environments, one of which the submitted ones decline; one suite more."""
    suite = Suite(
        name="small-v1",
        summary="For tests.",
        seeds=2,
        metrics=("p75_level_penalised_m", "mean_m", "availability"),
        environments=(
            SuiteEnvironment(env=ENV, walks=3, noise_m=0.05),
            SuiteEnvironment(env=DEAF, walks=1, noise_m=0.05),
        ),
        commitment=commitment(SECRET),
        held_out_walks=2,
    )
    known = {**suites.suites(), suite.name: suite}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(suites, "suites", lambda: known)
        yield suite


def card_named(name: str, **changes: object) -> Card:
    return msgspec.structs.replace(EXAMPLE, name=name, **{"sensors_used": ("position",), **changes})


@pytest.fixture(scope="session")
def packed(small_suite: Suite, submitted: Path) -> dict[str, Bundle]:
    """Bundles of `Mine` and `Wanders`, by class."""
    specs = {name: f"{submitted}:{name}" for name in ("Mine", "Wanders")}
    suite_runs = play_suite(list(specs.values()), small_suite, nonce=NONCE, isolation="none")
    return {
        name: make_bundle(spec, card_named(name.lower()), small_suite, suite_runs[spec]) for name, spec in specs.items()
    }


@pytest.fixture
def board(tmp_path: Path) -> Path:
    """A folder of leaderboards that trusts one key."""
    root = tmp_path / "leaderboards"
    root.mkdir()
    table = signing.new_key(tmp_path / "maintainer.key", "M. Aintainer", datetime.date(2026, 1, 1))
    (root / signing.KEYS_FILE).write_text(table)
    return root


@pytest.fixture
def key(board: Path) -> Path:
    """The private key of a maintainer whom that folder trusts."""
    return board.parent / "maintainer.key"


@pytest.fixture
def terms(key: Path) -> Callable[..., Terms]:
    """How maintainers run an entry again."""
    return lambda **changes: Terms(**({"nonce": SECOND_NONCE, "key": key} | changes))


def signed_again(folder: Path, key: Path, **changes: Any) -> None:
    """Signs another record in place of the one in the folder of an entry."""
    import json

    from pdrbench_leaderboard.verification import VERIFICATION_FILE, Verification

    record = json.loads(json.loads((folder / VERIFICATION_FILE).read_text())["body"]) | changes
    (folder / VERIFICATION_FILE).write_bytes(signing.sign(msgspec.convert(record, Verification), key))
