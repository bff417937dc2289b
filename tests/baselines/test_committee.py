"""Displacements of several networks as one."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest

from pdrbench.geometry import FloatArray
from pdrbench_baselines.fusion.committee import Committee, mean_move
from pdrbench_baselines.learned.reckoning import Move


def second(end_s: float, x_m: float, *, variance_m2: float = 0.04, stands: bool = False, doubt: float = 0.0) -> Move:
    return Move(end_s, np.array([x_m, 0.0]), variance_m2 * np.eye(2), stands, False, doubt)


class Member:
    """Gives its seconds so many at a time."""

    rise_m = 0.5

    def __init__(self, moves: list[Move], at_once: int) -> None:
        self._moves, self._at_once = moves, at_once

    def update(self, rows: Mapping[str, FloatArray]) -> Iterator[Move]:
        given, self._moves = self._moves[: self._at_once], self._moves[self._at_once :]
        yield from given


def committee(*members: Any) -> Committee:
    return Committee(list(members))


def test_one_member_is_reported_as_it_is() -> None:
    moves = [second(1.0, 1.2), second(2.0, -0.0)]
    together = committee(Member(moves, 2))
    assert [id(move) for move in together.update({})] == [id(move) for move in moves]
    assert together.rise_m == 0.5


def test_a_displacement_is_the_mean_of_the_members_and_as_wide_as_theirs() -> None:
    move = mean_move([second(1.0, 1.0, variance_m2=0.02, stands=True), second(1.0, 1.4, variance_m2=0.06)])
    np.testing.assert_allclose(move.move_m, (1.2, 0.0))
    np.testing.assert_allclose(move.covariance_m2, 0.04 * np.eye(2))
    assert move.end_s == 1.0 and not move.stands and not move.is_guess


@pytest.mark.parametrize(("doubt", "x_m"), [(0.0, 1.2), (0.5, 1.0 + 0.4 / 3.0), (1.0, 1.0)])
def test_the_more_the_first_doubts_the_less_the_others_count(doubt: float, x_m: float) -> None:
    move = mean_move([second(1.0, 1.0, doubt=doubt), second(1.0, 1.4)])
    assert move.move_m[0] == pytest.approx(x_m) and move.doubt == doubt


def test_a_second_waits_until_every_member_has_given_it() -> None:
    one = [second(float(k), 1.0) for k in range(1, 5)]
    other = [second(float(k), 1.4) for k in range(1, 5)]
    together = committee(Member(one, 2), Member(other, 1))
    ends_s = [[move.end_s for move in together.update({})] for _ in range(4)]
    assert ends_s == [[1.0], [2.0], [3.0], [4.0]]
