"""Displacements that go on between seconds, where the start is known."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from pdrbench.geometry import FloatArray
from pdrbench_baselines.learned.reckoning import Move, Reckoner

MIN_SINCE_S: Final = 0.5  # between two questions to a network: one beside that of every second, at five steps a second


class ContinuedReckoner(Reckoner):
    """A `Reckoner` that is asked between seconds as well."""

    _since_s = 0.0
    _change_m: FloatArray = np.zeros(2)

    def update(self, rows: Mapping[str, FloatArray]) -> Iterator[Move]:
        for move in super().update(rows):
            self._since_s, self._change_m = 0.0, np.zeros(2)
            yield move

    def turned_off_m(self, since_s: float) -> FloatArray:
        """(2,) how far the walker has come since the last second, less what its velocity gives.

        The velocity changes evenly from the middle of one second to that of another: where the second that ends f
        after the last one has a displacement larger by c, the way meanwhile is longer by c (1 + f) / 2.

        Args:
            since_s: Time since the last second.
        """
        if since_s - self._since_s >= MIN_SINCE_S:
            latest = self.latest_change_m()
            if latest is not None and MIN_SINCE_S / 2 <= latest[0] <= since_s + 1e-6:
                self._since_s, self._change_m = latest
        ahead_s = since_s - self._since_s
        way_m: FloatArray = self._change_m * ((1.0 + self._since_s) / 2 + ahead_s)
        return way_m
