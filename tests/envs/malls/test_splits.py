"""Parts of the malls: whole outings, apart in time; tests of the laboratory draw them again."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from pdrbench.datasets import datasets
from pdrbench_envs.malls.splits import (
    KNOWN,
    LATER,
    NUM_FOLDS,
    SURVEY_ENDS_S,
    UNSEEN,
    UNSEEN_FLOORS,
    Walk,
    survey_of,
    walks,
)
from pdrbench_formats.outings import GUARD_S

SURVEYED_AS = ("val", "test", *range(NUM_FOLDS))


def walks_of(part: str | int) -> list[Walk]:
    return [walk for walk in walks() if walk.part == part]


def test_every_walk_of_the_set_is_in_one_split() -> None:
    every = [walk.path for of in SURVEYED_AS for walk in walks_of(of)]
    assert sorted(every) == [walk.path for walk in walks()]
    assert set(every) == {file.path for file in datasets()["ilc20_full"].files if file.role == "path"}
    assert [len(walks_of(of)) for of in ("val", "test")] == [87, 161]


def test_no_session_stands_on_both_sides_and_surveys_are_of_train_walks_only() -> None:
    """Names of sessions are given; whoever sorts walks by them finds no name twice."""
    sides = Counter(session for of in SURVEYED_AS for session in {walk.session for walk in walks_of(of)})
    assert set(sides.values()) == {1}
    train = {walk.path for fold in range(NUM_FOLDS) for walk in walks_of(fold)}
    for of in SURVEYED_AS:
        assert {walk.path for walk in survey_of(of)} < train


@pytest.mark.parametrize("of", SURVEYED_AS)
def test_the_nearest_scan_in_time_is_more_than_ten_minutes_away(of: str | int) -> None:
    """A classifier that is given the times of walks finds none of the survey in the session of a played walk."""
    survey, played = survey_of(of), walks_of(of)
    assert not {walk.session for walk in survey} & {walk.session for walk in played}
    for site in ("site1", "site2"):
        surveyed = np.array([(walk.start_s, walk.end_s) for walk in survey if walk.site == site])
        for walk in (walk for walk in played if walk.site == site):
            gap_s = np.maximum(surveyed[:, 0] - walk.end_s, walk.start_s - surveyed[:, 1])
            assert gap_s.min() > GUARD_S
        assert len(surveyed) > 90  # of 411 and 287 walks: the survey covers what is left


def test_unseen_floors_are_the_smallest_and_occur_in_test_only() -> None:
    count = Counter((walk.site, walk.floor) for walk in walks())
    smallest = sorted(count, key=lambda floor: count[floor])
    assert set(smallest[:2]) == set(UNSEEN_FLOORS)
    assert count[smallest[0]] < 30 <= count[smallest[0]] + count[smallest[1]]
    elsewhere = {(walk.site, walk.floor) for of in ("val", *range(NUM_FOLDS)) for walk in walks_of(of)}
    assert elsewhere == set(count) - set(UNSEEN_FLOORS)


def test_groups_of_test_are_known_floors_unseen_floors_and_december() -> None:
    groups = Counter(walk.group for walk in walks_of("test") if walk.is_new)
    assert groups == {KNOWN: 87, UNSEEN: 35, LATER: 28}
    last_scan_s = max(walk.end_s for walk in survey_of("test"))
    assert last_scan_s < SURVEY_ENDS_S
    assert min(w.start_s for w in walks_of("test") if w.group == LATER) - last_scan_s > 9 * 86400
    known = {(walk.site, walk.floor) for walk in survey_of("test")}
    assert {(w.site, w.floor) for w in walks_of("test") if w.group != UNSEEN} <= known


def test_walks_of_the_first_version_are_not_tested() -> None:
    assert sum(not walk.is_new for walk in walks()) == 62
    assert 0 < sum(not walk.is_new for walk in walks_of("test")) < 15
