"""Canaries: what depends on the future is refused, what comes from memory is held, honest localizers are neither."""

from __future__ import annotations

import dataclasses
import datetime
import sys
from pathlib import Path

import msgspec
import numpy as np
import pytest
from typer.testing import CliRunner

from pdrbench.registry import make_task
from pdrbench_leaderboard import leaderboard_command, record
from pdrbench_leaderboard.boards import Board
from pdrbench_leaderboard.canaries import MIN_CANARIES, Canary, crossed, cut_short, examine, judge, plan
from pdrbench_leaderboard.card import card_toml
from pdrbench_leaderboard.draw import draw, drawn_task, read_truth
from pdrbench_leaderboard.run import Settings, run
from pdrbench_leaderboard.signing import new_key
from pdrbench_leaderboard.standings import read_tables

from .conftest import ENV, ONE, SECRET, STAY, card_named

MEMORISERS = '''
import numpy as np

from pdrbench import Estimate

WALKS = @


class ByVertex:
    """Knows each walk by the length of its building."""

    walk = None

    def reset(self, briefing, rng):
        briefing.require(sensors=("position",))
        length_m = max(polygon.outline_xy_m[:, 0].max() for polygon in briefing.building.polygons)
        self.walk = min(WALKS, key=lambda walk: abs(walk["length_m"] - length_m))

    def know(self, rows):
        pass

    def step(self, observation):
        self.know(observation["position"])
        walk = self.walk or WALKS[0]
        x_m, y_m = walk["xy_m"][int(np.searchsorted(walk["t_s"], observation.now_s).clip(0, len(walk["t_s"]) - 1))]
        return Estimate(np.array([x_m, y_m]), 0)


class Flees(ByVertex):
    """Fails where the sensors are not those of the walk that it knows."""

    def reset(self, briefing, rng):
        super().reset(briefing, rng)
        self.before = None

    def know(self, rows):
        for row in rows:
            if self.before is not None and np.hypot(*(row[1:3] - self.before)) > 4.0:
                raise ValueError("another walk")
            self.before = row[1:3]


class Revises(ByVertex):
    """Answers by its sensors, and remembers the walk when it is over."""

    def reset(self, briefing, rng):
        super().reset(briefing, rng)
        self.track = []

    def step(self, observation):
        self.track.append([observation.now_s, *super().step(observation).xy_m, 0.0])
        return Estimate(observation["position"][-1:, 1:3].sum(axis=0), 0)

    def revise(self):
        return np.array(self.track)


class BySteps(ByVertex):
    """Knows each walk by how far the sensors say that it went in its first seconds."""

    def reset(self, briefing, rng):
        briefing.require(sensors=("position",))
        self.walk, self.rows = None, []

    def know(self, rows):
        self.rows += rows.tolist()
        if self.walk is None and len(self.rows) >= 10:
            gone = np.diff(np.array(self.rows)[:10, 1:3], axis=0)
            self.walk = min(WALKS, key=lambda walk: np.abs(np.array(walk["gone"]) - gone).sum())


class ByRadio(BySteps):
    """Knows each walk by its first measured place, as by a scan."""

    def know(self, rows):
        self.rows += rows.tolist()
        if self.walk is None and len(self.rows) >= 3:
            scan = np.array(self.rows)[:3, 1:3]
            self.walk = min(WALKS, key=lambda walk: np.abs(np.array(walk["scan"]) - scan).sum())

'''


@pytest.fixture(scope="module")
def memorisers(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file of localizers, and what they have by heart: all held-out walks."""
    folder = tmp_path_factory.mktemp("memorisers")
    drawn = draw(ONE.environment(ENV), "held-out", SECRET, folder / "drawn")
    task, known = make_task(ENV, SECRET), []
    for name in drawn.walks:
        recording = task.load(read_truth(drawn, name).walk)
        assert recording.building is not None
        rows, reference = recording.streams["position"].rows, recording.reference
        known.append(
            {
                "length_m": float(recording.building.polygons[0].outline_xy_m[:, 0].max()),
                "gone": np.diff(rows[:10, 1:3], axis=0).tolist(),
                "scan": rows[:3, 1:3].tolist(),
                "t_s": reference.t_s.tolist(),
                "xy_m": reference.xy_m.tolist(),
            }
        )
    (folder / "mine.py").write_text(MEMORISERS.replace("@", repr(known)))
    return folder / "mine.py"


def play(settings: Settings, spec: str, name: str, tmp_path: Path) -> record.PartRecord:
    """What came of an entry on held-out walks."""
    card = tmp_path / f"{name}.toml"
    card.write_bytes(card_toml(card_named(name)))
    list(run([ONE], [spec], dataclasses.replace(settings, parts=("held-out",)), card=card))
    return record.read_entry(settings.root / "toy" / name)[0].parts[0]


@pytest.mark.parametrize("kind", ["ByVertex", "BySteps", "ByRadio", "Flees", "Revises"])
def test_what_answers_from_memory_is_first_and_held_for_a_person(
    settings: Settings, memorisers: Path, toy_board: Board, tmp_path: Path, kind: str
) -> None:
    part = play(settings, f"{memorisers}:{kind}", "remembers", tmp_path)
    assert part.canaries is not None
    assert (part.canaries.crossed, part.canaries.moved_m, part.canaries.response) == (MIN_CANARIES, 0.0, 0.0)
    assert max(record.numbers(part.divisions[-1].values["p75_m"])) < 0.05, "it would be first"
    folder = settings.root / "toy" / "remembers"
    entry, _ = record.read_entry(folder)
    assert "a person looks at it" in record.held(entry)
    assert not record.is_verified(folder, entry)
    assert not any(row.name == "remembers" for table in read_tables(settings.root, ONE) for row in table.rows)


@pytest.mark.parametrize("kind", ["Mine", "Wanders", "Lags"])
def test_honest_localizers_move_with_their_sensors(played: Settings, kind: str) -> None:
    part = record.read_entry(played.root / "toy" / kind.lower())[0].parts[0]
    assert part.canaries is not None and part.canaries.response is not None
    assert part.canaries.compared == MIN_CANARIES
    assert (part.canaries.held, part.canaries.response > 0.2) == ("", True)


def test_one_that_stays_says_nothing_and_is_not_held(played: Settings) -> None:
    canaries = record.read_entry(played.root / "toy" / STAY)[0].parts[0].canaries
    assert canaries is not None
    assert (canaries.crossed, canaries.response, canaries.held) == (0, None, "")


@pytest.mark.skipif(sys.platform != "linux", reason="confinement is Linux's")
def test_a_held_entry_is_not_signed_by_a_run(
    settings: Settings, memorisers: Path, submitted: Path, tmp_path: Path
) -> None:
    key = tmp_path / "key"
    settings.root.mkdir()
    (settings.root / "keys.toml").write_text(new_key(key, "a maintainer", datetime.date(2026, 1, 1)))
    signing = dataclasses.replace(settings, isolation=None, key=key)
    for name, spec in (("remembers", f"{memorisers}:ByVertex"), ("honest", f"{submitted}:Mine")):
        play(signing, spec, name, tmp_path)
        folder = settings.root / "toy" / name
        assert (folder / record.SIGNATURE_FILE).exists() == (name == "honest")
    folder = settings.root / "toy" / "remembers"
    options = ["release", str(folder), "--key", str(key), "--work"]
    assert "not by this host" in str(CliRunner().invoke(leaderboard_command.app, [*options, str(tmp_path)]).exception)
    released = CliRunner().invoke(leaderboard_command.app, [*options, str(settings.work)])
    assert released.exit_code == 0 and "it was held" in released.output
    assert record.is_verified(folder, record.read_entry(folder)[0]), "a person has signed it"


def test_answers_that_depend_on_more_than_walk_and_randomness_are_refused(
    settings: Settings, toy_board: Board, tmp_path: Path
) -> None:
    file, card = tmp_path / "peeks.py", tmp_path / "card.toml"
    file.write_text(
        "import numpy as np\nfrom pdrbench import Estimate\n\n\nclass Peeks:\n    def reset(self, briefing, rng):\n"
        "        self.rng = np.random.default_rng()\n\n    def step(self, observation):\n"
        "        return Estimate(self.rng.normal(size=2), 0)\n"
    )
    card.write_bytes(card_toml(card_named("peeks")))
    outcomes = list(run([ONE], [f"{file}:Peeks"], settings, card=card))
    (why,) = outcomes[1].refused.values()
    assert "a walk that was cut short was answered otherwise" in why


def test_canaries_are_walks_like_others_and_begin_as_theirs(tmp_path: Path) -> None:
    drawn = draw(ONE.environment(ENV), "held-out", SECRET, tmp_path)
    task, canaries = drawn_task(drawn.observations), drawn.canaries
    assert sorted([*drawn.walks, *canaries]) == sorted(task.split("test"))
    assert {len(name) for name in task.split("test")} == {16}
    kinds = [of.kind for of in canaries.values()]
    assert kinds.count("cut") == kinds.count("crossed") == MIN_CANARIES
    for name, canary in canaries.items():
        whole, begun = (task.load(of).streams["position"].rows for of in (canary.of, name))
        same = begun[:, 0] <= canary.since_s
        assert np.array_equal(begun[same], whole[: same.sum()])
        assert (np.diff(begun[:, 0]) > 0).all(), "the clock goes on"
        assert (~same).any() == (canary.kind == "crossed")
        assert task.random_as[name] == canary.of
    again = draw(ONE.environment(ENV), "held-out", SECRET, tmp_path / "again")
    assert again.canaries == canaries
    assert draw(ONE.environment(ENV), "public", SECRET, tmp_path).canaries == {}


def test_few_walks_have_few_canaries_whose_other_rows_go_on_with_the_clock() -> None:
    rows = {"a": np.column_stack([np.arange(10.0), np.zeros(10)]), "b": np.zeros((0, 2))}
    others = {"a": np.column_stack([np.arange(20.0), np.ones(20)])}
    found = crossed(rows, others, Canary("crossed", "x", 4.0, "y", 12.0))
    assert found["a"][:, 0].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0]
    assert found["a"][:, 1].tolist() == [0.0] * 5 + [1.0] * 7
    assert len(found["b"]) == 0
    assert cut_short(rows, 3.0)["a"][:, 0].tolist() == [0.0, 1.0, 2.0, 3.0]
    rng = np.random.default_rng(0)
    assert [of.kind for of in plan({"a": 10.0}, 1.0, rng)] == ["cut"]
    assert len(plan({str(number): 10.0 for number in range(200)}, 1.0, rng)) == 20


def test_the_least_honest_entry_says_who_is_held(settings: Settings) -> None:
    found = examine({}, []).record
    assert judge(found, []) == found
    slow = msgspec.structs.replace(found, crossed=3, moved_m=0.3, path_m=10.0, response=0.03)
    assert judge(slow, []).held and judge(slow, [0.4, 2.0]).held
    assert not judge(slow, [0.2, 2.0]).held
