"""Gaps in what a foot measures: samples are carried on from the earlier strides that went most like this one."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray

# Ours, chosen on recordings with gaps of 0.2 and 0.6 s cut into them; see the laboratory's notebook on foot_ins.
SHORTEST_S: Final = 0.018  # a shorter gap is crossed by the mean of its two ends
MEMORY_S: Final = 30.0  # in which earlier strides are looked for
MATCHED_S: Final = 0.8  # before the gap, that has to go alike: two strides differ where they began
MIN_MATCHED_S: Final = 0.3  # and how far apart two strides begin at least
FADES_S: Final = 0.3  # a sample before the gap counts less by a factor of e where it is so much older
NUM_ALIKE: Final = 3  # strides whose mean is carried on
AFTER_WEIGHT: Final = 60.0  # samples that the one after the gap counts as
BLEND_S: Final = 0.05  # in which a stride that is carried on is led over into what was measured on either side
SCALE: Final = np.array([3.0, 3.0, 3.0, 0.7, 0.7, 0.7])  # m/s2 and rad/s that count alike


class GapFiller:
    """Fills gaps in a stream, piece by piece; how it is cut does not matter, and nothing looks ahead.

    Args:
        rate_hz: Nominal rate of the samples.
        longest_s: A longer gap is left as it is: nobody knows what the foot did.
    """

    def __init__(self, rate_hz: float, longest_s: float) -> None:
        self._rate_hz, self._longest_s, self._shortest_s = rate_hz, longest_s, max(SHORTEST_S, 1.8 / rate_hz)
        self._seen: list[FloatArray] = [np.zeros((0, 7))]

    def fill(self, rows: FloatArray) -> tuple[FloatArray, BoolArray]:
        """The next samples and those that are missing between them.

        Args:
            rows: (n, 7) time in seconds, specific force in m/s2 and rate in rad/s, following on those of the last call.

        Returns:
            (m, 7) the same with what is carried on, and (m,) whether a sample was carried on.
        """
        t_s = np.concatenate([self._seen[-1][-1:, 0] if len(self._seen[-1]) else rows[:1, 0], rows[:, 0]])
        steps_s = t_s[1:] - t_s[:-1]
        gaps = np.flatnonzero((steps_s > self._shortest_s) & (steps_s <= self._longest_s))
        if not len(gaps):
            self._remember(rows)
            return rows, np.zeros(len(rows), dtype=bool)
        parts: list[FloatArray] = []
        is_made: list[BoolArray] = []
        for piece in np.split(rows, gaps):  # the first comes before the first gap, and may be empty
            made = self._carried_on(piece[0]) if parts else rows[:0]
            parts += [made, piece]
            is_made += [np.ones(len(made), dtype=bool), np.zeros(len(piece), dtype=bool)]
            self._remember(made, piece)
        return np.concatenate(parts), np.concatenate(is_made)

    def _remember(self, *pieces: FloatArray) -> None:
        self._seen.extend(piece for piece in pieces if len(piece))
        if len(self._seen) > 1 and not len(self._seen[0]):
            del self._seen[0]
        if len(self._seen) > 1 and self._seen[-1][-1, 0] - self._seen[0][0, 0] > 2 * MEMORY_S:
            self._seen = [self._history()]

    def _history(self) -> FloatArray:
        seen = np.concatenate(self._seen)
        kept: FloatArray = seen[seen[:, 0] > seen[-1, 0] - MEMORY_S]
        return kept

    def _carried_on(self, after: FloatArray) -> FloatArray:
        """(k, 7) samples up to `after` (7,), the first one behind the gap; none where no stride is known."""
        seen = self._history()
        begin_s, end_s = seen[-1, 0], after[0]
        count = max(round((end_s - begin_s) * self._rate_hz) - 1, 1)
        matched = min(round(MATCHED_S * self._rate_hz), len(seen) - count - 3)
        if matched < MIN_MATCHED_S * self._rate_hz:
            return seen[:0]
        values, scaled, after = seen[:, 1:], seen[:, 1:] / SCALE, after[1:]
        windows, faded = scaled[: len(seen) - count - 1], np.exp(np.arange(-matched, 0) / (FADES_S * self._rate_hz))
        wanted = faded[:, None] * scaled[-matched:]
        alike = sum(np.correlate(one, other, mode="valid") for one, other in zip(windows.T, wanted.T, strict=True))
        off = np.correlate(np.square(windows).sum(axis=1), faded, mode="valid") - 2 * alike
        off += AFTER_WEIGHT * np.square(scaled[matched + count :][: len(off)] - after / SCALE).sum(axis=1)
        t_s = begin_s + (end_s - begin_s) * np.arange(1, count + 1) / (count + 1)
        ends = np.sinh(np.column_stack([end_s - t_s, t_s - begin_s]) / BLEND_S) / np.sinh((end_s - begin_s) / BLEND_S)
        strides, apart = list[FloatArray](), round(MIN_MATCHED_S * self._rate_hz)
        while len(strides) < NUM_ALIKE and off.min() < np.inf:
            begin = matched + int(off.argmin())  # of what is carried on, and led over into what was measured
            off[max(begin - matched - apart, 0) : begin - matched + apart] = np.inf
            missed = np.stack([values[-1] - values[begin - 1], after - values[begin + count]])
            strides.append(values[begin : begin + count] + ends @ missed)
        return np.column_stack([t_s, np.mean(strides, axis=0)])
