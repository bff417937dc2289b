"""Draws of the parts of the malls: outings, in an order of chance, and the table that the environment has of them."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

from pdrbench_envs.malls.splits import NUM_FOLDS, Session, Walk, survey_of, walks
from pdrbench_lab.malls.draw import TEST_DRAW, Outing, drawn, known_and_other_outings, num_walks, outings_of, splits


def test_the_table_has_what_was_drawn() -> None:
    made = splits()
    found = {}
    for part, outings in {"val": made.val, "test": made.test, **dict(enumerate(made.train))}.items():
        for outing in outings:
            found |= {walk.path: (part, outing[0].walks[0].session) for session in outing for walk in session.walks}
    assert found == {walk.path: (walk.part, walk.outing) for walk in walks()}
    for part in ("val", "test", *range(NUM_FOLDS)):
        assert survey_of(part) == made.survey(part)


def session(name: str, start_min: float, minutes: float = 1.0, floor: str = "F1", num: int = 1) -> Session:
    path = f"site1/{floor}/path_data_files/{name}"
    start_s = 1574500000.0 + 60 * start_min
    return Session(tuple(Walk(f"{path}-{k}", name, start_s, start_s + 60 * minutes, 0, name) for k in range(num)))


def names(outings: list[Outing]) -> list[list[str]]:
    return [[session.walks[0].session for session in outing] for outing in outings]


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
    assert {outing[0].walks[0].session for outing in drawn(known, 80, "test 4")} != {
        outing[0].walks[0].session for outing in first
    }
    taken = sum((num_walks(outing) for outing in first), Counter())
    assert 60 <= taken.total() <= 130
    assert max(taken.values()) <= 0.4 * taken.total()  # no floor has it all


def test_validation_is_kept_off_only_where_it_is_drawn() -> None:
    without, made = splits(TEST_DRAW, None), splits()
    assert without.val == () and without.test == made.test
    assert {walk.path for walk in made.survey("test")} < {walk.path for walk in without.survey("test")}
