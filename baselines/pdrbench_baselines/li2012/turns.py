"""Turns of a walker, from the headings of steps (Li et al. 2012, claim L17)."""

from __future__ import annotations

import math
import statistics
from dataclasses import dataclass

import numpy as np

from pdrbench.errors import PdrbenchError
from pdrbench.geometry import wrap_rad


@dataclass(frozen=True, slots=True)
class TurnParams:
    """Settings of `TurnDetector`, from Li et al. 2012 unless a line says otherwise.

    Attributes:
        median_steps: Length of the median filter over headings, odd.
        mean_steps: Length of the mean filter behind it, odd.
        threshold_rad: A heading so far from the mean since the last turn is a turn.
        steady_rad: A filtered heading that changes by less over two steps is stable again.
    """

    median_steps: int = 9
    mean_steps: int = 3
    threshold_rad: float = math.radians(45.0)  # L17: the paper does not say
    steady_rad: float = math.radians(8.0)  # ours: a third of the threshold over the reach of the mean filter

    def __post_init__(self) -> None:
        for name in ("median_steps", "mean_steps"):
            if getattr(self, name) < 1 or getattr(self, name) % 2 == 0:
                raise PdrbenchError(f"turns: {name} is an odd number of steps; got {getattr(self, name)}")
        if not (self.steady_rad > 0 and 0 < self.threshold_rad < math.pi):
            raise PdrbenchError(f"turns: threshold and steady_rad are angles above 0, below half a turn; got {self}")

    @property
    def lag_steps(self) -> int:
        """Steps that both filters look ahead."""
        return self.median_steps // 2 + self.mean_steps // 2


@dataclass(frozen=True, slots=True)
class Turn:
    """One turn; steps are counted from 0.

    Attributes:
        begin: First step that turns.
        salient: Step at which the heading changes most.
        end: First step of the new direction.
        angle_rad: By how much it turned, counter-clockwise.
    """

    begin: int
    salient: int
    end: int
    angle_rad: float


class TurnDetector:
    """Finds turns while steps come in; a turn is known `TurnParams.lag_steps` and some steps after it has ended.

    Eq. (6) compares a heading with the sum of those before; as the text says, it is compared with their mean since the
    last turn here. Headings are unwrapped, so that the plain mean is the circular one and a turn may go on and on.
    """

    def __init__(self, params: TurnParams | None = None) -> None:
        self._params = params or TurnParams()
        self._raw: list[float] = []
        self._median: list[float] = []
        self._smooth: list[float] = []
        self._since = 0  # the mean of headings counts from here
        self._begun: tuple[int, int, float] | None = None

    def update(self, heading_rad: float) -> Turn | None:
        """Takes the heading of the next step; the turn whose end became known by it, if any."""
        # Unwrapped against three steps: one that points backwards would otherwise add a whole turn to all that follow.
        last_rad = statistics.median(self._raw[-3:]) if self._raw else heading_rad
        self._raw.append(last_rad + float(wrap_rad(heading_rad - last_rad)))
        half = self._params.median_steps // 2
        middle = len(self._raw) - 1 - half
        if middle < 0:
            return None
        self._median.append(statistics.median(self._raw[max(middle - half, 0) : middle + half + 1]))
        reach = self._params.mean_steps // 2
        middle -= reach
        if middle < 0:
            return None
        self._smooth.append(statistics.fmean(self._median[max(middle - reach, 0) : middle + reach + 1]))
        return self._look_at(middle)

    def _look_at(self, step: int) -> Turn | None:
        """The filtered heading of `step` is the newest."""
        smooth, p = self._smooth, self._params
        if self._begun is None:
            if step == self._since:
                return None
            mean_rad = statistics.fmean(smooth[self._since : step])
            if abs(smooth[step] - mean_rad) < p.threshold_rad:
                return None
            self._begun = (*self._salient(step), mean_rad)
        begin, salient, before_rad = self._begun
        if abs(smooth[step] - smooth[max(step - 2, 0)]) >= p.steady_rad:
            return None
        self._begun, self._since = None, step
        end = step
        while end - 1 > salient and abs(smooth[end - 1] - smooth[step]) < p.steady_rad:
            end -= 1
        return Turn(begin, salient, end, smooth[step] - before_rad)

    def _salient(self, step: int) -> tuple[int, int]:
        """Where a turn detected at `step` began, and where it turns most, within the reach of the filters."""
        smooth, steady_rad = self._smooth, self._params.steady_rad / 2
        first = max(step - self._params.lag_steps - 1, self._since + 1, 1)
        change_rad = np.abs(np.diff(smooth[first - 1 : step + 1]))
        salient = first + int(np.argmax(change_rad))
        begin = salient
        while begin > first and abs(smooth[begin - 1] - smooth[begin - 2]) >= steady_rad:
            begin -= 1
        return begin, salient
