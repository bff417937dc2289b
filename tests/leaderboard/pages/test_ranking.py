"""Ranking: order, ties, divisions, entries without a rank, and significant differences."""

from __future__ import annotations

import dataclasses
from typing import Any

import msgspec
import numpy as np
import pytest

from pdrbench.errors import ResultError
from pdrbench.evaluation.tables import Results
from pdrbench.result import FAILED
from pdrbench_leaderboard.ranking import LOOP_RANKING, RANKING, Board, make_board, ranking_metric


def places(board: Board) -> list[tuple[str, str]]:
    return [(standing.label, standing.name) for standing in board.standings]


def test_ranks_each_division_by_value_without_entries_that_chose_their_walks(five: Board) -> None:
    assert places(five) == [
        ("o1", "smooth"),
        ("1", "near"),
        ("2", "far"),
        ("3", "alike"),
        ("–", "choosy"),
    ]
    assert five.standings[-1].why_unranked == "declined 6 of 12 walks"
    assert five.metric == RANKING and len(five.walks) == 12


def test_equal_values_have_equal_ranks_and_the_next_one_is_skipped(world: Any) -> None:
    values = {"d": 3.0, "c": 2.0, "b": 2.0, "a": 1.0}
    board = world.board(*(world.entry(name, [value] * 12) for name, value in values.items()))
    assert places(board) == [("1", "a"), ("2", "b"), ("2", "c"), ("4", "d")]


def test_a_failed_walk_is_scored_and_ranked(world: Any) -> None:
    results = [world.result("brave-v0", walk, 1.0) for walk in world.task.walks["test"]]
    results[0] = dataclasses.replace(results[0], status=FAILED, failure="it broke")
    board = world.board(world.entry("brave-v0", [], results=tuple(results)))
    assert places(board) == [("1", "brave-v0")] and board.standings[0].row["failed"] == 1


def test_tests_are_those_of_the_results_themselves(five: Board) -> None:
    ranked = [standing for standing in five.standings if standing.rank is not None]
    pairs = Results(tuple(result for standing in ranked for result in standing.entry.results)).pairs(RANKING)
    for row in pairs.itertuples():
        pair = five.pair(row.first, row.second)
        assert pair is not None
        assert pair.p == pytest.approx(row.p)
        assert abs(pair.effect) == pytest.approx(abs(row.effect))
    assert len(pairs) == 3 and len(five.pairs) == 6, "the board tests across divisions, too"


def test_only_significant_differences_put_an_entry_ahead(five: Board) -> None:
    assert five.beaten_by("near") == ("far", "alike")
    assert five.beaten_by("far") == ()  # 1 mm of difference, 10 cm of noise
    pair = five.pair("alike", "far")
    assert pair is not None and pair.first == "far" and pair.p_holm > 0.05
    assert five.pair("near", "choosy") is None


def test_seeds_are_averaged_within_walks(world: Any) -> None:
    walks = world.task.walks["test"]
    drawn = tuple(
        world.result("drawn-v0", walk, offset, seed=seed) for walk in walks for seed, offset in enumerate((1, 3))
    )
    board = world.board(world.entry("drawn-v0", [], results=drawn), world.entry("fixed-v0", [2.5] * 12))
    np.testing.assert_allclose(board.values["drawn-v0"], 2.0)
    pair = board.pair("drawn-v0", "fixed-v0")
    assert pair is not None and pair.num_walks == 12 and pair.effect == pytest.approx(-0.5)


def test_too_few_walks_for_so_many_pairs_are_reported(world: Any) -> None:
    board = world.board(*(world.entry(f"e{i}-v0", [1.0 + i] * 6) for i in range(4)))
    assert len(board.pairs) == 6 and board.is_too_small  # 6 * 2 / 2^6 = 0.19
    assert all(board.beaten_by(standing.name) == () for standing in board.standings)
    assert not world.board(world.entry("a-v0", [1.0] * 12), world.entry("b-v0", [2.0] * 12)).is_too_small


def test_two_entries_of_one_name_are_refused(world: Any) -> None:
    with pytest.raises(ResultError, match="two entries of Corridor-v0 are called 'one-v0'"):
        make_board([world.entry("one-v0", [1.0] * 12), world.entry("one-v0", [2.0] * 12)])


@pytest.mark.parametrize(("places", "loops", "wanted"), [(1, 7, LOOP_RANKING), (1, 0, RANKING), (20, 7, RANKING)])
def test_where_only_the_return_is_scored_the_loop_ranks(places: float, loops: int, wanted: str) -> None:
    metrics = {"n": {"value": places, "n": 7}, LOOP_RANKING: {"value": 0.1 if loops else None, "n": loops}}
    still = {"n": {"value": places, "n": 7}, LOOP_RANKING: {"value": None, "n": 0}}
    assert ranking_metric([{"metrics": metrics}, {"metrics": still}, {"metrics": {}}]) == wanted


def test_a_localizer_that_never_moves_has_no_rank_on_loops(world: Any) -> None:
    def loop(walk: str) -> Any:
        recording = world.recording(walk)
        xy_m = recording.reference.xy_m.copy()
        xy_m[-1] = xy_m[0]
        ends = np.isin(np.arange(len(xy_m)), [0, len(xy_m) - 1])
        surveyed = ends & (recording.reference.t_s > 0)
        reference = dataclasses.replace(recording.reference, xy_m=xy_m, level=np.zeros(len(xy_m)), surveyed=surveyed)
        return dataclasses.replace(recording, reference=reference.rows(ends))

    world.task = dataclasses.replace(world.task, load=loop)
    moved = [world.result("moved-v0", walk, 0.0) for walk in world.task.walks["test"]]
    nowhere = dataclasses.replace(moved[0].estimates, xy_m=0 * moved[0].estimates.xy_m)
    still = [dataclasses.replace(result, localizer="still-v0", estimates=nowhere) for result in moved]
    entries = [world.entry(name, [], results=tuple(of)) for name, of in (("still-v0", still), ("moved-v0", moved))]
    board = world.board(*entries)
    assert board.metric == LOOP_RANKING
    assert places(board)[0] == ("1", "moved-v0") and places(board)[1] == ("–", "still-v0")
    assert board.standings[1].why_unranked == "loop_closure_pct does not apply to 12 of 12 walks"
    assert set(board.values) == {"moved-v0"}


def seen(entry: Any, **changes: Any) -> Any:
    """The entry with other results on held-out walks."""
    held_out = msgspec.structs.replace(entry.verification.held_out, **changes)
    return dataclasses.replace(entry, verification=msgspec.structs.replace(entry.verification, held_out=held_out))


def test_the_held_out_score_ranks_and_the_public_one_does_not(world: Any) -> None:
    entries = [world.entry("honest", [2.0] * 12), world.entry("knows-v0", [0.1] * 12)]
    entries[1] = seen(entries[1], values={RANKING: (9.0,) * 12})
    board = world.board(*entries)
    assert places(board) == [("1", "honest"), ("2", "knows-v0")]
    assert board.standings[1].gap == pytest.approx(8.9)
    assert board.beaten_by("honest") == ("knows-v0",)


def test_nothing_but_verified_entries_is_ranked(world: Any) -> None:
    tiers = ("self-reported", "spot-checked", "reproduced")
    better = [world.entry(tier, [0.1] * 12, tier=tier) for tier in tiers]
    board = world.board(*better, world.entry("two-v0", [5.0] * 12))
    assert places(board)[0] == ("1", "two-v0") and {label for label, _ in places(board)[1:]} == {"–"}
    assert {standing.name: standing.why_unranked for standing in board.standings[1:]} == {
        tier: f"{tier}, and only held-out walks rank" for tier in tiers
    }


def test_held_out_walks_of_another_round_or_number_do_not_rank(world: Any) -> None:
    entries = [world.entry(name, [1.0] * 12) for name in ("now-v0", "before-v0", "few-v0", "partly-v0")]
    entries[1] = seen(entries[1], round="9" * 64)
    entries[2] = seen(entries[2], units=(0, 1), values={RANKING: (0.1, 0.1)})
    entries[3] = seen(entries[3], values={RANKING: (None, *[0.1] * 11)})
    board = world.board(*entries)
    assert {standing.name: standing.why_unranked for standing in board.standings} == {
        "now-v0": "",
        "before-v0": "verified in an earlier round, whose held-out walks are public by now",
        "few-v0": "verified on 2 held-out walks, others on 12",
        "partly-v0": "p75_level_penalised_m does not apply to its held-out walks",
    }
