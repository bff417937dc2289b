"""Gaps in what a foot measures: samples are carried on from the earlier stride that went most like this one."""

from __future__ import annotations

from typing import Final

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray

# Ours, chosen on recordings with gaps of 0.2 and 0.6 s cut into them; see the laboratory's notebook on foot_ins.
SHORTEST_S: Final = 0.05  # not measured: a shorter gap is crossed by the mean of its two ends
MEMORY_S: Final = 30.0  # in which earlier strides are looked for
MATCHED_S: Final = 0.8  # before the gap, that has to go alike: two strides differ where they began
LEAST_MATCHED_S: Final = 0.3
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
        self._rate_hz, self._longest_s = rate_hz, longest_s
        self._shortest_s = max(SHORTEST_S, 2.5 / rate_hz)
        self._seen: list[FloatArray] = [np.zeros((0, 7))]

    def fill(self, rows: FloatArray) -> tuple[FloatArray, BoolArray]:
        """The next samples and those that are missing between them.

        Args:
            rows: (n, 7) time in seconds, specific force in m/s2 and rate in rad/s, following on those of the last call.

        Returns:
            (m, 7) the same with what is carried on, and (m,) whether a sample was carried on.
        """
        if self._longest_s <= 0:
            return rows, np.zeros(len(rows), dtype=bool)
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
        if matched < LEAST_MATCHED_S * self._rate_hz:
            return seen[:0]
        values, after = seen[:, 1:], after[1:]
        scaled = values / SCALE
        windows, wanted = scaled[: len(seen) - count - 1], scaled[-matched:]
        energy = np.concatenate([[0.0], np.cumsum(np.square(windows).sum(axis=1))])
        alike = sum(np.correlate(one, other, mode="valid") for one, other in zip(windows.T, wanted.T, strict=True))
        off = energy[matched:] - energy[:-matched] - 2 * alike
        begins = matched + np.arange(len(off))  # of what would be carried on
        off += AFTER_WEIGHT * np.square(scaled[begins + count] - after / SCALE).sum(axis=1)
        begin = begins[off.argmin()]
        t_s = begin_s + (end_s - begin_s) * np.arange(1, count + 1) / (count + 1)
        lead_in = np.exp((begin_s - t_s) / BLEND_S)[:, None] * (values[-1] - values[begin - 1])
        lead_out = np.exp((t_s - end_s) / BLEND_S)[:, None] * (after - values[begin + count])
        return np.column_stack([t_s, values[begin : begin + count] + lead_in + lead_out])
