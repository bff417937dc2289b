"""Displacements of several networks as one: what one misreads on a walk the others do not."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench_baselines.learned.reckoning import Move, Reckoner


class Committee:
    """Takes the rows of a phone and reports the mean displacement of its members, in the place of a `Reckoner`.

    Args:
        members: At least one, of the same briefing; the first reports the doubt of the input.
    """

    def __init__(self, members: Sequence[Reckoner]) -> None:
        self._members = members
        self._waiting: tuple[deque[Move], ...] = tuple(deque() for _ in members)

    def update(self, rows: Mapping[str, FloatArray]) -> Iterator[Move]:
        """Takes the next rows and gives the seconds that all members have given.

        Raises:
            RecordingError: As `Reckoner.update`.
        """
        for member, waiting in zip(self._members, self._waiting, strict=True):
            waiting.extend(member.update(rows))
        while all(self._waiting):
            yield mean_move([waiting.popleft() for waiting in self._waiting])


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
