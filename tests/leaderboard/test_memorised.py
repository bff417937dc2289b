"""The truth of public walks is public: an entry that contains it may be perfect on them, and does not rank ahead."""

from __future__ import annotations

import datetime
import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pdrbench.registry import make_task
from pdrbench.task import commitment
from pdrbench_leaderboard import signing, suites
from pdrbench_leaderboard.entry import Entry
from pdrbench_leaderboard.pack import make_bundle, play_suite
from pdrbench_leaderboard.ranking import Board, make_board
from pdrbench_leaderboard.suites import Suite, SuiteEnvironment
from pdrbench_leaderboard.table import table
from pdrbench_leaderboard.verify import Terms, verify

from .conftest import NONCE, SECOND_NONCE, SECRET, card_named

ENV, WALKS = "Toy-v1", 2
HERE = {"isolation": "none"}  # in this process: what is tested is the score
HONEST = '''
import json
import numpy as np
from pdrbench import Estimate

TABLE = json.loads(r"""{table}""")


class Honest:
    """The position that was measured."""

    def reset(self, briefing, rng):
        briefing.require(sensors=("position",))
        self.key = f"{{briefing.building.edge_start_xy_m.sum():.3f}}"
        self.count, self.level = 0, briefing.building.levels[0]

    def step(self, observation):
        rows = observation["position"]
        self.xy_m = rows[-1, 1:3] if len(rows) else np.array([1.0, 0.0])
        return Estimate(xy_m=self.xy_m, level=self.level)


class Memorises(Honest):
    """The truth of public walks, by their building; elsewhere worse than honest ones."""

    def step(self, observation):
        super().step(observation)
        rows = TABLE.get(self.key)
        self.count += 1
        if rows is None:
            return self.unknown()
        return Estimate(xy_m=rows[min(self.count - 1, len(rows) - 1)], level=self.level)

    def unknown(self):
        return Estimate(xy_m=self.xy_m + 5.0, level=self.level)


class Crashes(Memorises):
    def unknown(self):
        raise ValueError("never seen")


class Declines(Memorises):
    def reset(self, briefing, rng):
        super().reset(briefing, rng)
        if self.key not in TABLE:
            from pdrbench import UnsuitableError
            raise UnsuitableError("never seen")

'''


@pytest.fixture(scope="module")
def suite() -> Iterator[Suite]:
    made = Suite(
        name="memory",
        summary="For one test.",
        seeds=2,
        metrics=("p75_level_penalised_m", "mean_m"),
        environments=(SuiteEnvironment(env=ENV, walks=WALKS, noise_m=0.0),),
        commitment=commitment(SECRET),
        held_out_walks=4,
    )
    known = {**suites.suites(), made.name: made}
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(suites, "suites", lambda: known)
        yield made


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory, suite: Suite) -> Path:
    task, rows = make_task(ENV), {}
    for walk in suite.walks(ENV):
        recording = task.load(walk)
        truth = recording.reference
        assert recording.building is not None
        times = np.arange(0.0, truth.t_s[-1] + task.period_s, task.period_s)
        at = np.searchsorted(truth.t_s, times, side="right").clip(1) - 1
        rows[f"{recording.building.edge_start_xy_m.sum():.3f}"] = truth.xy_m[at].tolist()
    path = tmp_path_factory.mktemp("memory") / "remembers.py"
    path.write_text(HONEST.format(table=json.dumps(rows)))
    return path


def verified(file: Path, suite: Suite, terms: Terms, name: str) -> Entry:
    spec = f"{file}:{name}"
    suite_run = play_suite([spec], suite, nonce=NONCE, **HERE)[spec]
    bundle = make_bundle(spec, card_named(name.lower()), suite, suite_run)
    (one,) = verify(bundle, terms)
    assert one.differences == () and one.entry.tier == "verified"
    return one.entry


@pytest.fixture(scope="module")
def ranked(file: Path, suite: Suite) -> Board:
    signing.new_key(file.with_name("maintainer.key"), "M. Aintainer", datetime.date(2026, 1, 1))
    terms = Terms(nonce=SECOND_NONCE, secrets=(SECRET,), key=file.with_name("maintainer.key"))
    names = ("Honest", "Memorises", "Crashes", "Declines")
    return make_board([verified(file, suite, terms, name) for name in names])


def test_a_table_of_answers_is_perfect_in_public_and_does_not_rank_ahead(ranked: Board) -> None:
    standings = {standing.name: standing for standing in ranked.standings}
    honest, memorises = standings["honest"], standings["memorises"]
    assert memorises.metric(ranked.metric)["value"] < 0.2 < honest.metric(ranked.metric)["value"]
    assert memorises.rank is not None and honest.rank is not None and honest.rank < memorises.rank
    gap, other = memorises.gap, honest.gap
    assert gap is not None and other is not None and gap > 3.0 > abs(other)
    text = table(ranked)
    assert f"+{gap:.2f}" in text or f"+{gap:.1f}" in text


def test_giving_up_where_it_was_never_seen_is_the_worst_answer(ranked: Board) -> None:
    task = make_task(ENV, SECRET)
    worst = []
    for walk in task.split("heldout")[:4]:
        recording = task.load(walk)
        assert recording.building is not None
        levels, (x0_m, y0_m, x1_m, y1_m) = recording.building.levels, recording.building.bounds_m()
        worst.append(float(np.hypot(x1_m - x0_m, y1_m - y0_m)) + 15.0 * (max(levels) - min(levels)))
    for name in ("crashes", "declines"):
        np.testing.assert_allclose(ranked.values[name], worst, rtol=1e-5)
    assert all((values <= np.asarray(worst) * 1.00001).all() for values in ranked.values.values())
    assert [standing.name for standing in ranked.standings[-2:]] == ["crashes", "declines"]
    assert ranked.standings[-1].rank == ranked.standings[-2].rank
    text = table(ranked)
    assert "`crashes`: on held-out walks, 4 runs failed, each counted as the worst answer." in text
    assert "`declines`: on held-out walks, 4 runs were declined, each counted as the worst answer." in text
