"""One walk while it goes on: rows of sensors in, estimates out, by the clock of `Episode`."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any, Final

import numpy as np

from pdrbench.episode import CLOCK_SLACK_S, num_due, num_observations, read_estimate
from pdrbench.errors import EstimateError, RecordingError, unknown_name
from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.localizer import Briefing, Estimate, Localizer, Observation
from pdrbench.registry import make_localizer

WAIT_S: Final = 0.1  # packets of several sensors hardly ever come together
MAX_JUMP_S: Final = 5.0  # further ahead may be a wrong clock: a second packet has to say so as well
MAX_GAP_S: Final = 600.0  # after which a walk is another one
LATE, AHEAD, TWICE, WRONG = "late", "ahead", "twice", "not a number, or out of bounds"


class Session:
    """A localizer on rows that come in: `push`, `push`, `estimate`, ... and `finish`.

    Observation k holds what its sensors delivered up to k periods, as an `Episode` hands it out. It is due once a row
    of any sensor is more than `wait_s` later. Until then rows may come in any order, and twice. What comes after its
    observation is left out. A gap is one: observations without rows are given as well. Answers are those that
    `pdrbench.run` gives on a recording of the rows that were not left out.

    >>> import pdrbench
    >>> from pdrbench.sensors import sensor_spec
    >>> sensors = {"stride": sensor_spec("stride")}
    >>> session = pdrbench.Session("dead_reckoning", Briefing(None, sensors, 0.2, pdrbench.Start([0, 0], 0, 0.0)))
    >>> session.push("stride", [[1.0, 1.4, 0.0, 0.0]]), session.finish().xy_m.tolist()
    (1, [1.4, 0.0])

    Attributes:
        localizer: What answers; its `debug` may be asked between calls.
        now_s: Time of the last observation, in seconds from the start of the walk; -inf before the first.
        dropped: Rows that were left out, by reason.
        missing: Answers that could not be used, by reason.
    """

    def __init__(
        self,
        localizer: str | Localizer,
        briefing: Briefing,
        rng: np.random.Generator | None = None,
        *,
        wait_s: float = WAIT_S,
    ) -> None:
        """Begins a walk.

        Args:
            localizer: Id, `package.module:Class` or `path/to/file.py:Class`; or the object.
            briefing: What the localizer is given; its sensors are those that can be pushed.
            rng: The localizer's own randomness; seeded with 0 where None.
            wait_s: How long, by the clock of the rows, an observation waits for rows that are late.

        Raises:
            UnsuitableError: The localizer needs what the briefing lacks.
        """
        self.localizer = make_localizer(localizer) if isinstance(localizer, str) else localizer
        self.briefing, self.now_s = briefing, -math.inf
        self.dropped: Counter[str] = Counter()
        self.missing: Counter[str] = Counter()
        self._wait_s, self._newest_s, self._ahead_s = wait_s, 0.0, -math.inf
        self._pending = {name: np.zeros((0, len(spec.columns))) for name, spec in briefing.sensors.items()}
        self._step = 0
        self._last: Estimate | None = None
        self.localizer.reset(briefing, np.random.default_rng(0) if rng is None else rng)

    def push(self, sensor: str, rows: Any) -> int:
        """Takes rows that a sensor delivered.

        Args:
            sensor: Of the briefing.
            rows: (n, C) columns as `briefing.sensors` has them; t_s in seconds from the start of the walk.

        Returns:
            Rows that were kept; `dropped` counts the others.

        Raises:
            UnknownNameError: The briefing has no such sensor.
            RecordingError: No array of numbers of that shape.
        """
        if sensor not in self._pending:
            raise unknown_name("sensor of the briefing", sensor, self._pending)
        spec = self.briefing.sensors[sensor]
        try:
            table = np.array(rows, dtype=np.float64)
        except (TypeError, ValueError, OverflowError) as error:
            raise RecordingError(f"push: rows of {sensor!r} are numbers (n, {len(spec.columns)}); {error}") from None
        table = table.reshape(-1, len(spec.columns)) if not table.size else table
        if table.ndim != 2 or table.shape[1] != len(spec.columns):
            raise RecordingError(
                f"push: rows of {sensor!r} have the shape {table.shape}, expected (n, {len(spec.columns)}): "
                f"{', '.join(spec.columns)}"
            )
        inside: Any = (table >= spec.low) & (table <= spec.high)
        table = self._kept(table, inside.all(axis=1), WRONG)
        table = self._kept(table, table[:, 0] > self.now_s + CLOCK_SLACK_S, LATE)
        table = self._kept(table, table[:, 0] <= self._limit_s(table[:, 0]), AHEAD)
        joined = np.concatenate([self._pending[sensor], table])
        _, first = np.unique(joined, axis=0, return_index=True)
        self.dropped[TWICE] += len(joined) - len(first)
        joined = joined[np.sort(first)]
        self._pending[sensor] = joined[np.argsort(joined[:, 0], kind="stable")]
        self._newest_s = float(table[:, 0].max(initial=self._newest_s))
        return len(table)

    def estimate(self) -> Estimate | None:
        """Gives the localizer every observation that is due; its last answer, None where there is none that counts."""
        return self._play(num_observations(self._newest_s - self._wait_s, self.briefing.period_s) - 1)

    def finish(self) -> Estimate | None:
        """Gives it what is left: the walk is over, and the last answer that of its end."""
        return self._play(num_observations(self._newest_s, self.briefing.period_s))

    def _play(self, num: int) -> Estimate | None:
        while self._step < num:
            self.now_s = self._step * self.briefing.period_s
            self._step += 1
            rows = {}
            for name, pending in self._pending.items():
                due = num_due(pending[:, 0], self.now_s)
                rows[name], self._pending[name] = pending[:due].copy(), pending[due:]
            answer = self.localizer.step(Observation(self.now_s, rows))
            try:
                read_estimate(answer)
                self._last = answer
            except EstimateError as error:
                self.missing[str(error).partition(": ")[0]] += 1
        return self._last

    def _kept(self, table: FloatArray, is_kept: BoolArray, reason: str) -> FloatArray:
        self.dropped[reason] += len(table) - int(is_kept.sum())
        kept: FloatArray = table[is_kept]
        return kept

    def _limit_s(self, t_s: FloatArray) -> float:
        """The latest time that is believed: far ahead only where the packet before it was as far."""
        limit_s = self._newest_s + MAX_JUMP_S
        newest_s = float(t_s.max(initial=-math.inf))
        if newest_s > limit_s:
            is_said_again = abs(newest_s - self._ahead_s) <= MAX_JUMP_S and newest_s <= self._newest_s + MAX_GAP_S
            self._ahead_s = newest_s
            return newest_s if is_said_again else limit_s
        return limit_s
