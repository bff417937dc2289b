"""Time until the place is found, whether it is lost again, and what the localizer itself claims about it.

Time counts from the first surveyed position. Errors are those of the surveyed positions; on the wrong level the error
is infinite here. What never happens takes infinitely long: it is not left out, or a localizer would improve by failing.
Failures as Li et al. 2012 count them need a localizer that is given the reference again, and are not here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from pdrbench.geometry import BoolArray, FloatArray
from pdrbench.metrics.hold import Held
from pdrbench.metrics.level import level_differences
from pdrbench.metrics.position import PercentileMethod, errors_m, mean, percentile
from pdrbench.metrics.statistics import median
from pdrbench.trajectory import Trajectory

ROUNDING_S = 1e-6  # k * period_s is rounded


@dataclass(frozen=True, slots=True)
class Search:
    """When a walker was found, lost and found again.

    Attributes:
        converged_s: Time of the first convergence; infinite where there was none.
        lost_s: (L,) time of each loss after it.
        recovered_s: (L,) time of the convergence after each loss; infinite where there was none.
        end_s: Time of the last surveyed position; that of the first is 0.
    """

    converged_s: float
    lost_s: FloatArray
    recovered_s: FloatArray
    end_s: float


def found_errors_m(held: Held, reference: Trajectory) -> FloatArray:
    """(n,) error e_k at the surveyed positions, infinite where the level is wrong."""
    return np.asarray(np.where(level_differences(held, reference) == 0, errors_m(held, reference), math.inf))


def stretches_s(where: BoolArray, t_s: FloatArray) -> tuple[FloatArray, FloatArray]:
    """First and last time of every longest stretch of rows on which something is so.

    >>> stretches_s(np.array([True, True, False, True]), np.array([0.0, 2.0, 4.0, 6.0]))
    (array([0., 6.]), array([2., 6.]))
    """
    change = np.diff(np.concatenate([[False], where, [False]]).astype(np.int8))
    return t_s[np.flatnonzero(change == 1)], t_s[np.flatnonzero(change == -1) - 1]


def search(
    held: Held,
    reference: Trajectory,
    *,
    within_m: float = 5.0,
    hold_s: float = 10.0,
    lost_m: float = 10.0,
    lost_for_s: float = 10.0,
) -> Search | None:
    """When the walker was found, lost and found again; None where the surveyed positions span less than `hold_s`.

    Converged at the first t of the first stretch of surveyed positions with e <= within_m that lasts at least `hold_s`;
    lost from the first t after that of the first stretch with e > lost_m that lasts more than `lost_for_s`; converged
    again as before, and so on. A stretch lasts from its first to its last surveyed position.
    """
    t_s = reference.t_s[reference.surveyed]
    if not len(t_s) or t_s[-1] - t_s[0] < hold_s - ROUNDING_S:
        return None
    t_s = t_s - t_s[0]
    error_m = found_errors_m(held, reference)
    first, last = stretches_s(error_m <= within_m, t_s)
    found_s = first[last - first >= hold_s - ROUNDING_S]
    first, last = stretches_s(error_m > lost_m, t_s)
    gone_s = first[last - first > lost_for_s + ROUNDING_S]
    converged_s = now_s = _next_s(found_s, -math.inf)
    lost_s, recovered_s = [], []
    while math.isfinite(now_s) and math.isfinite(loss_s := _next_s(gone_s, now_s)):
        lost_s.append(loss_s)
        now_s = _next_s(found_s, loss_s)
        recovered_s.append(now_s)
    return Search(converged_s, np.array(lost_s), np.array(recovered_s), float(t_s[-1]))


def convergence_s(held: Held, reference: Trajectory, *, within_m: float = 5.0, hold_s: float = 10.0) -> float:
    """First time in seconds from which e <= within_m for at least `hold_s`; infinite where there is none.

    NaN where the surveyed positions span less than `hold_s`: nothing could be shown there.
    """
    found = search(held, reference, within_m=within_m, hold_s=hold_s)
    return math.nan if found is None else found.converged_s


def first_within_s(held: Held, reference: Trajectory, *, within_m: float = 5.0) -> float:
    """First time in seconds at which e <= within_m; infinite where it never is, NaN where no position is surveyed."""
    t_s = reference.t_s[reference.surveyed]
    is_within = found_errors_m(held, reference) <= within_m
    return float(t_s[is_within.argmax()] - t_s[0]) if is_within.any() else math.inf if len(t_s) else math.nan


def converged_by(
    held: Held, reference: Trajectory, *, by_s: float = 60.0, within_m: float = 5.0, hold_s: float = 10.0
) -> float:
    """1.0 where `convergence_s` <= by_s, else 0.0.

    NaN where that could not be shown, since the surveyed positions span less than by_s + hold_s. Whether a walk counts
    depends on the walk alone, so that a mean is not one over survivors.
    """
    found = search(held, reference, within_m=within_m, hold_s=hold_s)
    if found is None or found.end_s < by_s + hold_s - ROUNDING_S:
        return math.nan
    return float(found.converged_s <= by_s + ROUNDING_S)


def lost_count(
    held: Held,
    reference: Trajectory,
    *,
    within_m: float = 5.0,
    hold_s: float = 10.0,
    lost_m: float = 10.0,
    lost_for_s: float = 10.0,
) -> float:
    """How often the walker was lost after convergence; NaN where it never converged.

    Lost from the first t after the convergence of a stretch with e > lost_m, or on the wrong level, that lasts more
    than `lost_for_s`; found again at the next convergence, which is as the first: e <= within_m for at least `hold_s`.
    """
    found = search(held, reference, within_m=within_m, hold_s=hold_s, lost_m=lost_m, lost_for_s=lost_for_s)
    return math.nan if found is None or math.isinf(found.converged_s) else float(len(found.lost_s))


def lost_share(
    held: Held,
    reference: Trajectory,
    *,
    within_m: float = 5.0,
    hold_s: float = 10.0,
    lost_m: float = 10.0,
    lost_for_s: float = 10.0,
) -> float:
    """Fraction of the time after convergence between losses and recoveries; NaN where it never converged.

    sum_i (min(recovered_i, end) - lost_i) / (end - converged), lost and found again as in `lost_count`.
    """
    found = search(held, reference, within_m=within_m, hold_s=hold_s, lost_m=lost_m, lost_for_s=lost_for_s)
    if found is None or not found.converged_s < found.end_s:
        return math.nan
    away_s = np.minimum(found.recovered_s, found.end_s) - found.lost_s
    return float(away_s.sum() / (found.end_s - found.converged_s))


def recovery_s(
    held: Held,
    reference: Trajectory,
    *,
    within_m: float = 5.0,
    hold_s: float = 10.0,
    lost_m: float = 10.0,
    lost_for_s: float = 10.0,
) -> float:
    """Lower median over the losses of a walk of recovered_i - lost_i in seconds; NaN where it was never lost.

    Infinite where more than half of the losses were for good.
    """
    found = search(held, reference, within_m=within_m, hold_s=hold_s, lost_m=lost_m, lost_for_s=lost_for_s)
    if found is None or not len(found.lost_s):
        return math.nan
    return float(median(found.recovered_s - found.lost_s))


def claimed_convergence_s(answered: Held, reference: Trajectory) -> float:
    """Time in seconds of the first answer that claims to have converged; infinite where none does.

    0 where that came before the first surveyed position. NaN where the localizer claims nothing, neither that it has
    converged nor that it has not, or nothing was surveyed.

    Args:
        answered: Held at the time of every answer.
        reference: Its first surveyed position is where time begins.
    """
    claims = answered.converged
    if np.isnan(claims).all() or not reference.surveyed.any():
        return math.nan
    begin_s = reference.t_s[np.argmax(reference.surveyed)]
    return max(0.0, float(answered.t_s[np.argmax(claims == 1)] - begin_s)) if (claims == 1).any() else math.inf


def claimed_correct(held: Held, reference: Trajectory, answered: Held, *, within_m: float = 3.0) -> float:
    """1.0 where the first claim of convergence was right, else 0.0, also where it never came.

    Right is e <= within_m on the right level at the first surveyed position at or after `claimed_convergence_s`. NaN
    where the localizer claims nothing, or nothing was surveyed after the claim.

    Args:
        held: At every row of `reference`.
        reference: Surveyed rows are scored.
        answered: Held at the time of every answer.
        within_m: Three metres distinguish neighbouring rooms.
    """
    claimed_s = claimed_convergence_s(answered, reference)
    if not math.isfinite(claimed_s):
        return 0.0 if math.isinf(claimed_s) else math.nan
    t_s = reference.t_s[reference.surveyed]
    after = t_s - t_s[0] >= claimed_s - ROUNDING_S
    error_m = found_errors_m(held, reference)
    return float(error_m[np.argmax(after)] <= within_m) if after.any() else math.nan


def converged_errors_m(held: Held, reference: Trajectory) -> FloatArray:
    """(m,) error e_k, in the plane, at the surveyed positions where the estimate in force claims to have converged."""
    return np.asarray(errors_m(held, reference)[held.converged[reference.surveyed] == 1])


def converged_share(held: Held, reference: Trajectory) -> float:
    """Fraction of surveyed positions at which the estimate in force claims to have converged; NaN without any claim."""
    claims = held.converged[reference.surveyed]
    return math.nan if np.isnan(claims).all() else float(np.mean(claims == 1))


def converged_mean_m(held: Held, reference: Trajectory) -> float:
    """Mean of `converged_errors_m` in metres; read it beside `converged_share`: fewer claims, fewer errors."""
    return mean(converged_errors_m(held, reference))


def converged_percentile_m(
    held: Held, reference: Trajectory, *, quantile: float = 0.75, method: PercentileMethod = "hazen"
) -> float:
    """Percentile of `converged_errors_m` in metres, by `method`; read it beside `converged_share`."""
    return percentile(converged_errors_m(held, reference), quantile, method)


def _next_s(times_s: FloatArray, after_s: float) -> float:
    """First of increasing times after a time; infinite where there is none."""
    index = int(np.searchsorted(times_s, after_s, side="right"))
    return float(times_s[index]) if index < len(times_s) else math.inf
