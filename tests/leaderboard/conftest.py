"""A toy package with environments, a board of them, a file of submitted localizers, and a folder that was played."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest
from installed import declare, importable

from pdrbench_leaderboard import boards
from pdrbench_leaderboard.boards import Board, BoardEnvironment, Round
from pdrbench_leaderboard.card import Card, card_toml
from pdrbench_leaderboard.run import Settings, run

ENV, DEAF = "Toy-v1", "ToyDeaf-v1"  # submitted localizers decline the second
STAY = "stay"  # a registered localizer
SECRET = "5ec2e7" * 8
TOY = Board(
    name="toy",
    title="Toy",
    summary="Corridors.",
    lost_m=2.0,
    environments=(BoardEnvironment(env=ENV, held_out_walks=12), BoardEnvironment(env=DEAF, held_out_walks=2)),
)
ONE = msgspec.structs.replace(TOY, environments=TOY.environments[:1])  # where no entry declines anything
ROUND = Round(number=0, secret=SECRET)
CLASSES = ("Mine", "Wanders", "Lags", "Broken")
SUBMITTED = '''
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


class Lags(Mine):
    """Far behind, and revises nothing but that."""

    def step(self, observation):
        estimate = super().step(observation)
        return Estimate(xy_m=estimate.xy_m - 3.0, level=self.level)

    def revise(self):
        return np.array([[0.0, *self.xy_m, self.level]])


class Broken(Mine):
    def step(self, observation):
        raise ValueError("no idea")
'''


@pytest.fixture(scope="package", autouse=True)
def toy(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """The toy package is installed, as pip leaves it: a module, and the entry points of its distribution."""
    root = tmp_path_factory.mktemp("site")
    shutil.copy(Path(__file__).parent / "toy" / "toy_boards.py", root)
    declare(root, "toy_boards", "[pdrbench.environments]\nx = toy_boards:ENVIRONMENTS\n")
    with importable(root):
        yield


@pytest.fixture(scope="package")
def submitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """File with the classes above."""
    path = tmp_path_factory.mktemp("elsewhere") / "submitted.py"
    path.write_text(SUBMITTED)
    return path


EXAMPLE = Card(
    name="mine",
    authors=("A. Author",),
    licence="MIT",
    sensors_used=("stride",),
    map_used=False,
    survey_used=False,
    training_data="none",
)


def card_named(name: str, **changes: object) -> Card:
    return msgspec.structs.replace(EXAMPLE, name=name, **{"sensors_used": ("position",), **changes})


@pytest.fixture(scope="package")
def toy_board(toy: None) -> Iterator[Board]:
    """The only board there is."""
    with pytest.MonkeyPatch.context() as patch:
        ours, read = boards._File({ONE.name: ONE}, (ROUND,)), boards._file
        patch.setattr(
            boards, "_file", lambda root: ours if boards.boards_file(root) == boards.boards_file() else read(root)
        )
        yield ONE


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    """Plays in this process."""
    return Settings(root=tmp_path / "leaderboards", work=tmp_path / "work", round=ROUND, isolation="none")


@pytest.fixture
def mine(submitted: Path, tmp_path: Path) -> tuple[str, Path]:
    """A localizer in a file, and its card."""
    card = tmp_path / "card.toml"
    card.write_bytes(card_toml(card_named("mine")))
    return f"{submitted}:Mine", card


@pytest.fixture(scope="package")
def played(toy_board: Board, submitted: Path, tmp_path_factory: pytest.TempPathFactory) -> Settings:
    """A folder with entries of the classes above and of `stay`; to be copied before it is changed."""
    place = tmp_path_factory.mktemp("played")
    found = Settings(root=place / "leaderboards", work=place / "work", round=ROUND, isolation="none")
    for name in CLASSES:
        card = place / f"{name}.toml"
        card.write_bytes(card_toml(card_named(name.lower())))
        list(run([toy_board], [f"{submitted}:{name}"], found, card=card))
    list(run([toy_board], [STAY], found))
    return found
