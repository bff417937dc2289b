"""Displacements of several networks as one: what one misreads on a walk the others do not."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench_baselines.learned.reckoning import Move, Reckoner

MIN_SINCE_S: Final = 0.35  # between two questions to a network: at most two beside that of every second


class Committee:
    """Takes the rows of a phone and reports the mean displacement of its members, in the place of a `Reckoner`.

    Args:
        members: At least one, of the same briefing; the first reports the doubt of the input, the last of several,
            which should be quick, is asked between seconds as well.
        length_factor: On displacements.
    """

    def __init__(self, members: Sequence[Reckoner], length_factor: float = 1.0) -> None:
        self._members, self._length_factor = members, length_factor
        self._waiting: tuple[deque[Move], ...] = tuple(deque() for _ in members)
        self._since_s, self._change_m = 0.0, np.zeros(2)

    def update(self, rows: Mapping[str, FloatArray]) -> Iterator[Move]:
        """Takes the next rows and gives the seconds that all members have given.

        Raises:
            RecordingError: As `Reckoner.update`.
        """
        for member, waiting in zip(self._members, self._waiting, strict=True):
            waiting.extend(member.update(rows))
        while all(self._waiting):
            self._since_s, self._change_m = 0.0, np.zeros(2)
            move = mean_move([waiting.popleft() for waiting in self._waiting])
            yield move if self._length_factor == 1.0 else replace(move, move_m=self._length_factor * move.move_m)

    def turned_off_m(self, since_s: float) -> FloatArray:
        """(2,) how far the walker has come since the last second, less what its velocity gives.

        The velocity changes evenly from the middle of one second to that of another: where the second that ends f
        after the last one has a displacement larger by c, the way meanwhile is longer by c (1 + f) / 2.

        Args:
            since_s: Time since the last second.
        """
        if len(self._members) > 1 and since_s - self._since_s >= MIN_SINCE_S:
            latest = self._members[-1].latest_change_m()
            if latest is not None and MIN_SINCE_S / 2 <= latest[0] <= since_s + 1e-6:
                self._since_s, change_m = latest
                self._change_m = self._length_factor * change_m
        ahead_s = since_s - self._since_s
        way_m: FloatArray = self._change_m * ((1.0 + self._since_s) / 2 + ahead_s)
        return way_m


def mean_move(moves: Sequence[Move]) -> Move:
    """One second as the mean of what members report; the more the first doubts its input, the less the others count.

    Members err alike, so the covariance is the mean of theirs and not that of a mean.
    """
    first = moves[0]
    if len(moves) == 1:
        return first
    weight = np.array([1.0] + [1.0 - first.doubt] * (len(moves) - 1))
    weight /= weight.sum()
    return Move(
        first.end_s,
        np.einsum("m,mi->i", weight, [move.move_m for move in moves]),
        np.einsum("m,mij->ij", weight, [move.covariance_m2 for move in moves]),
        stands=all(move.stands for move in moves),
        is_guess=any(move.is_guess for move in moves),
        doubt=first.doubt,
    )
