"""Splits of the malls: whole outings, apart in time, drawn and not chosen."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import numpy as np
import pytest

from pdrbench.datasets import datasets
from pdrbench_envs.malls.splits import (
    KNOWN,
    LATER,
    NUM_FOLDS,
    SURVEY_ENDS_S,
    TEST_DRAW,
    UNSEEN,
    UNSEEN_FLOORS,
    Outing,
    Session,
    Walk,
    drawn,
    is_new,
    known_and_other_outings,
    num_walks,
    outings_of,
    splits,
    walks,
)
from pdrbench_formats.outings import GUARD_S

SURVEYED_AS = ("val", "test", *range(NUM_FOLDS))


def walks_of(of: str | int) -> list[Walk]:
    made = splits()
    outings = made.train[of] if isinstance(of, int) else {"val": made.val, "test": made.test}[of]
    return [walk for outing in outings for session in outing for walk in session.walks]


def test_every_walk_of_the_set_is_in_one_split() -> None:
    every = [walk.path for of in SURVEYED_AS for walk in walks_of(of)]
    assert sorted(every) == [walk.path for walk in walks()]
    assert set(every) == {file.path for file in datasets()["ilc20_full"].files if file.role == "path"}
    assert [len(walks_of(of)) for of in ("val", "test")] == [87, 161]


def test_no_session_stands_on_both_sides() -> None:
    """Names of sessions are given; whoever sorts walks by them finds no name twice."""
    sides = Counter(session for of in SURVEYED_AS for session in {walk.session for walk in walks_of(of)})
    assert set(sides.values()) == {1}


@pytest.mark.parametrize("of", SURVEYED_AS)
def test_the_nearest_scan_in_time_is_more_than_ten_minutes_away(of: str | int) -> None:
    """A classifier that is given the times of walks finds none of the survey in the session of a played walk."""
    survey, played = splits().survey(of), walks_of(of)
    assert not {walk.session for walk in survey} & {walk.session for walk in played}
    for site in ("site1", "site2"):
        surveyed = np.array([(walk.start_s, walk.end_s) for walk in survey if walk.site == site])
        for walk in (walk for walk in played if walk.site == site):
            gap_s = np.maximum(surveyed[:, 0] - walk.end_s, walk.start_s - surveyed[:, 1])
            assert gap_s.min() > GUARD_S
        assert len(surveyed) > 90  # of 411 and 287 walks: the survey covers what is left


def test_surveys_are_of_train_walks_only() -> None:
    train = {walk.path for fold in range(NUM_FOLDS) for walk in walks_of(fold)}
    for of in SURVEYED_AS:
        assert {walk.path for walk in splits().survey(of)} < train


def test_unseen_floors_are_the_smallest_and_occur_in_test_only() -> None:
    count = Counter((walk.site, walk.floor) for walk in walks())
    smallest = sorted(count, key=lambda floor: count[floor])
    assert set(smallest[:2]) == set(UNSEEN_FLOORS)
    assert count[smallest[0]] < 30 <= count[smallest[0]] + count[smallest[1]]
    elsewhere = {(walk.site, walk.floor) for of in ("val", *range(NUM_FOLDS)) for walk in walks_of(of)}
    assert elsewhere == set(count) - set(UNSEEN_FLOORS)


def test_groups_of_test_are_known_floors_unseen_floors_and_december() -> None:
    groups = Counter(walk.group for walk in walks_of("test") if is_new(walk))
    assert groups == {KNOWN: 87, UNSEEN: 35, LATER: 28}
    last_scan_s = max(walk.end_s for walk in splits().survey("test"))
    assert last_scan_s < SURVEY_ENDS_S
    assert min(w.start_s for w in walks_of("test") if w.group == LATER) - last_scan_s > 9 * 86400
    known = {(walk.site, walk.floor) for walk in splits().survey("test")}
    assert {(w.site, w.floor) for w in walks_of("test") if w.group != UNSEEN} <= known


def test_walks_of_the_first_version_are_not_tested() -> None:
    assert sum(not is_new(walk) for walk in walks()) == 62
    assert 0 < sum(not is_new(walk) for walk in walks_of("test")) < 15


def session(name: str, start_min: float, minutes: float = 1.0, floor: str = "F1", num: int = 1) -> Session:
    path = f"site1/{floor}/path_data_files/{name}"
    start_s = 1574500000.0 + 60 * start_min
    return Session(name, tuple(Walk(f"{path}-{k}", name, start_s, start_s + 60 * minutes) for k in range(num)))


def names(outings: list[Outing]) -> list[list[str]]:
    return [[session.name for session in outing] for outing in outings]


def test_sessions_within_ten_minutes_are_one_outing_over_floors() -> None:
    given = [session("a", 0), session("b", 10.9, floor="F2"), session("c", 22.0), session("d", 30.0)]
    assert names(list(outings_of(given))) == [["a", "b"], ["c", "d"]]


def test_a_long_outing_is_cut_between_sessions() -> None:
    given = [session(f"s{k:02}", 5.0 * k, minutes=4.0) for k in range(12)]  # 59 minutes: three parts
    parts = list(outings_of(given))
    assert [len(part) for part in parts] == [4, 4, 4]
    assert all(a[-1].end_s < b[0].start_s for a, b in pairwise(parts))
    (one,) = outings_of([session("whole", 0, minutes=90.0, num=30)])
    assert len(one) == 1


def test_a_draw_depends_on_its_name_and_not_on_the_order_of_outings() -> None:
    known, _ = known_and_other_outings()
    first = drawn(known, 80, "test 3")
    assert drawn(known[::-1], 80, "test 3") == first
    assert {outing[0].name for outing in drawn(known, 80, "test 4")} != {outing[0].name for outing in first}
    taken = sum((num_walks(outing) for outing in first), Counter())
    assert 60 <= taken.total() <= 130
    assert max(taken.values()) <= 0.4 * taken.total()  # no floor has it all


def test_validation_is_kept_off_only_where_it_is_drawn() -> None:
    without, made = splits(TEST_DRAW, None), splits()
    assert without.val == () and without.test == made.test
    assert {walk.path for walk in made.survey("test")} < {walk.path for walk in without.survey("test")}
