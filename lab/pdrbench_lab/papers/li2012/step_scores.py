"""Steps and strides found against those that were made: counting them, and measuring the ones that fit.

Events are times in seconds, of steps or of strides, in any order. They are matched one to one within a tolerance; a
match is a true positive (TP), an event found that nothing matches a false positive (FP), an event made that nothing
matches a false negative (FN). Lengths are compared on the matches only, so read them beside `EventMatch.f1`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import linear_sum_assignment

from pdrbench.errors import EstimateError, PdrbenchError, RecordingError
from pdrbench.geometry import FloatArray, IntArray, read_only
from pdrbench.metrics.position import rms

ROUNDING_S: Final = 1e-9  # 0.55 - 0.30 exceeds 0.25 in floating point


@dataclass(frozen=True, slots=True)
class EventMatch:
    """Which event found is which event made.

    Attributes:
        estimated: (P,) int, rows of the events found, in the order of their times.
        reference: (P,) int, the event made that each of them is.
        num_estimated: Events found, matched or not.
        num_reference: Events made, matched or not.
    """

    estimated: IntArray
    reference: IntArray
    num_estimated: int
    num_reference: int

    def __post_init__(self) -> None:
        for name in ("estimated", "reference"):
            object.__setattr__(self, name, read_only(getattr(self, name), np.int64))

    @property
    def true_positives(self) -> int:
        """Matched events: TP."""
        return len(self.estimated)

    @property
    def false_positives(self) -> int:
        """Events found that were not made: FP."""
        return self.num_estimated - len(self.estimated)

    @property
    def false_negatives(self) -> int:
        """Events made that were not found: FN."""
        return self.num_reference - len(self.reference)

    @property
    def precision(self) -> float:
        """TP / (TP + FP); NaN where nothing was found."""
        return _ratio(self.true_positives, self.num_estimated)

    @property
    def recall(self) -> float:
        """TP / (TP + FN); NaN where nothing was made."""
        return _ratio(self.true_positives, self.num_reference)

    @property
    def f1(self) -> float:
        """2 TP / (2 TP + FP + FN), the harmonic mean of precision and recall; NaN without any event on either side."""
        return _ratio(2 * self.true_positives, self.num_estimated + self.num_reference)

    @property
    def count_error_pct(self) -> float:
        """Signed error of the count in percent: 100 (found - made) / made; NaN where nothing was made.

        Misses and false events cancel in it; they do not in `f1`.
        """
        return 100.0 * _ratio(self.num_estimated - self.num_reference, self.num_reference)


def match_events(estimated_s: ArrayLike, reference_s: ArrayLike, *, tolerance_s: float = 0.25) -> EventMatch:
    """Matches events one to one: as many pairs as possible, and of all such matchings the least sum of |t_est - t_ref|.

    A pair may be `tolerance_s` apart, not more. In time order no two pairs of the best matching cross: uncrossing two
    pairs lengthens neither the longer nor the sum.

    Args:
        estimated_s: (E,) finite times of the events found, any order; of two at one time at most one is true for
            each event made then.
        reference_s: (R,) finite times of the events made, any order.
        tolerance_s: Greater than 0; about half a step, so that a neighbour is no match.

    Raises:
        EstimateError: Times found are not a row of finite numbers.
        RecordingError: Times made are not.

    >>> found = match_events([0.5, 1.1, 1.2, 3.0], [0.52, 1.0, 1.4])
    >>> found.estimated.tolist(), found.reference.tolist(), found.false_positives
    ([0, 1, 2], [0, 1, 2], 1)
    """
    if not 0 < tolerance_s < math.inf:
        raise PdrbenchError(f"tolerance_s is {tolerance_s}; give a finite time above 0 s, 0.25 for steps")
    found_s = _finite_row("times of estimated events", estimated_s, EstimateError)
    made_s = _finite_row("times of reference events", reference_s, RecordingError)
    found_order, made_order = np.argsort(found_s, kind="stable"), np.argsort(made_s, kind="stable")
    estimated, reference = _match_sorted(found_s[found_order], made_s[made_order], tolerance_s + ROUNDING_S)
    return EventMatch(found_order[estimated], made_order[reference], len(found_s), len(made_s))


def step_f1(estimated_s: ArrayLike, reference_s: ArrayLike, *, tolerance_s: float = 0.25) -> float:
    """`EventMatch.f1` of the steps of a walk."""
    return match_events(estimated_s, reference_s, tolerance_s=tolerance_s).f1


def step_count_error_pct(estimated_s: ArrayLike, reference_s: ArrayLike) -> float:
    """`EventMatch.count_error_pct` of the steps of a walk, for which nothing need match."""
    num_found = len(_finite_row("times of estimated events", estimated_s, EstimateError))
    num_made = len(_finite_row("times of reference events", reference_s, RecordingError))
    return 100.0 * _ratio(num_found - num_made, num_made)


def false_steps_per_min(estimated_s: ArrayLike, still_s: ArrayLike) -> float:
    """Events found a minute while the person stands: #{t in a still interval} / total length; NaN without intervals.

    Args:
        estimated_s: (E,) finite times of the events found, any order.
        still_s: (K, 2) begin and end of intervals without a step, in order and apart; an end belongs to its interval.

    >>> false_steps_per_min([1.0, 4.0, 50.0], [[0.0, 30.0], [60.0, 90.0]])
    2.0
    """
    found_s = _finite_row("times of estimated events", estimated_s, EstimateError)
    ends_s = np.asarray(still_s, dtype=np.float64)
    if not ends_s.size:
        return math.nan
    if ends_s.ndim != 2 or ends_s.shape[1] != 2 or not np.isfinite(ends_s).all():
        raise RecordingError(f"still intervals have shape {ends_s.shape}; give finite begins and ends as (K, 2)")
    wrong = ends_s[:, 0] >= ends_s[:, 1]
    wrong[1:] |= ends_s[1:, 0] < ends_s[:-1, 1]
    if wrong.any():
        row = int(np.flatnonzero(wrong)[0])
        raise RecordingError(f"still interval {row} is empty or begins before the last one ends; sort and merge them")
    interval = np.searchsorted(ends_s[:, 0], found_s, side="right") - 1
    is_still = (interval >= 0) & (found_s <= ends_s[interval, 1])
    return float(60.0 * np.count_nonzero(is_still) / np.diff(ends_s, axis=1).sum())


def stride_errors_m(match: EventMatch, estimated_m: ArrayLike, reference_m: ArrayLike) -> FloatArray:
    """(P,) length found minus length made of the matched strides, in metres.

    Args:
        match: Of the times of the strides.
        estimated_m: (E,) finite lengths found, in the order the times were given in.
        reference_m: (R,) finite lengths made, greater than 0.
    """
    found_m, made_m = _lengths_m(match, estimated_m, reference_m)
    return found_m - made_m


def stride_rmse_m(match: EventMatch, estimated_m: ArrayLike, reference_m: ArrayLike) -> float:
    """Root mean square of `stride_errors_m`; NaN without a match."""
    return rms(stride_errors_m(match, estimated_m, reference_m))


def stride_bias_m(match: EventMatch, estimated_m: ArrayLike, reference_m: ArrayLike) -> float:
    """Mean of `stride_errors_m`, negative where strides come out short; NaN without a match."""
    error_m = stride_errors_m(match, estimated_m, reference_m)
    return float(error_m.mean()) if len(error_m) else math.nan


def stride_relative_error_pct(match: EventMatch, estimated_m: ArrayLike, reference_m: ArrayLike) -> float:
    """Mean relative size of the error of matched strides in percent: 100 mean |l_est - l| / l; NaN without a match."""
    found_m, made_m = _lengths_m(match, estimated_m, reference_m)
    return float(100.0 * np.mean(np.abs(found_m - made_m) / made_m)) if len(made_m) else math.nan


def _lengths_m(match: EventMatch, estimated_m: ArrayLike, reference_m: ArrayLike) -> tuple[FloatArray, FloatArray]:
    found_m = _finite_row("lengths of estimated strides", estimated_m, EstimateError)
    made_m = _finite_row("lengths of reference strides", reference_m, RecordingError)
    if len(found_m) != match.num_estimated:
        raise EstimateError(f"{len(found_m)} lengths for {match.num_estimated} estimated strides; give one for each")
    if len(made_m) != match.num_reference:
        raise RecordingError(f"{len(made_m)} lengths for {match.num_reference} reference strides; give one for each")
    if (made_m <= 0).any():
        row = int(np.flatnonzero(made_m <= 0)[0])
        raise RecordingError(f"reference stride {row} is {made_m[row]} m long; leave out what is no stride")
    return found_m[match.estimated], made_m[match.reference]


def _match_sorted(found_s: FloatArray, made_s: FloatArray, within_s: float) -> tuple[IntArray, IntArray]:
    """Matches sorted times, one stretch after the other: stretches are too far apart for a pair between them."""
    low = np.searchsorted(made_s, found_s - within_s, side="left")
    high = np.searchsorted(made_s, found_s + within_s, side="right")
    near = np.flatnonzero(high > low)
    begins = np.flatnonzero(low[near[1:]] >= high[near[:-1]]) + 1
    pairs: list[tuple[int, int]] = []
    for rows in np.split(near, begins) if len(near) else []:
        if len(rows) == 1 == high[rows[0]] - low[rows[0]]:
            pairs.append((int(rows[0]), int(low[rows[0]])))
            continue
        first = low[rows[0]]
        apart_s = np.abs(found_s[rows, None] - made_s[first : high[rows[-1]]])
        # A pair is worth more than all time differences together could take away.
        worth = np.where(apart_s <= within_s, within_s * (min(apart_s.shape) + 1) - apart_s, 0.0)
        row, column = linear_sum_assignment(worth, maximize=True)
        is_pair = worth[row, column] > 0
        pairs += zip(rows[row[is_pair]].tolist(), (first + np.sort(column[is_pair])).tolist(), strict=True)
    matched = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return matched[:, 0], matched[:, 1]


def _ratio(part: int, whole: int) -> float:
    return part / whole if whole else math.nan


def _finite_row(what: str, values: ArrayLike, error: type[PdrbenchError]) -> FloatArray:
    row = np.asarray(values, dtype=np.float64)
    if row.ndim != 1:
        raise error(f"{what} have shape {row.shape}; give one number for each event")
    if not np.isfinite(row).all():
        raise error(f"{what} are not finite at row {int(np.flatnonzero(~np.isfinite(row))[0])}; leave that event out")
    return row
