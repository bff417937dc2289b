"""Figures of a network: on windows of people it never met, and on whole walks of environments."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import torch

from pdrbench.geometry import FloatArray, wrap_rad
from pdrbench_baselines.learned.data import Windows
from pdrbench_baselines.learned.model import surprise, whitened
from pdrbench_baselines.learned.signals import turned

if TYPE_CHECKING:
    from pdrbench_baselines.learned.batches import Feed
    from pdrbench_baselines.learned.model import Network

WALKS_M: Final = 0.5  # in a second; slower than that a course tells nothing
LEVELS: Final = (0.50, 0.90, 0.95)


@dataclass(frozen=True, slots=True)
class WindowFigures:
    """On windows of one set of people.

    Attributes:
        error_m: Mean error of the displacement in a second.
        surprise: Mean of minus the log likelihood.
        distance_pct: Mean over walks of the relative error of the distance walked.
        turn_p95_deg: 95 % of the errors of the change of course from one second to the next.
        coverage_50_pct, coverage_90_pct, coverage_95_pct: Errors within the ellipses that are claimed to hold so many.
    """

    error_m: float
    surprise: float
    distance_pct: float
    turn_p95_deg: float
    coverage_50_pct: float
    coverage_90_pct: float
    coverage_95_pct: float

    def line(self) -> str:
        """For people."""
        held = "/".join(f"{one:.0f}" for one in (self.coverage_50_pct, self.coverage_90_pct, self.coverage_95_pct))
        return (
            f"{self.error_m:.3f} m, -log p {self.surprise:.3f}, distance {self.distance_pct:.1f} %, "
            f"turn P95 {self.turn_p95_deg:.1f} deg, coverage {held} %"
        )


def window_figures(network: Network, feed: Feed, windows: Windows) -> WindowFigures:
    """Asks a network about every window of a set."""
    network.eval()
    told, truth, white, nll = [], [], [], []
    with torch.no_grad():
        for batch in feed.in_order():
            said = network(batch.window, batch.height_m)
            white.append((whitened(said, batch.move_m) ** 2).sum(dim=1).cpu().numpy())
            nll.append(surprise(said, batch.move_m).cpu().numpy())
            yaw_rad = batch.yaw_rad.cpu().numpy()
            told.append(turned(said.move_m.cpu().numpy(), yaw_rad))
            truth.append(turned(batch.move_m.cpu().numpy(), yaw_rad))
    move_m, true_m = np.concatenate(told), np.concatenate(truth)
    squares = np.concatenate(white)
    held = [100.0 * float(np.mean(squares <= -2.0 * np.log(1.0 - level))) for level in LEVELS]
    return WindowFigures(
        float(np.hypot(*(move_m - true_m).T).mean()),
        float(np.concatenate(nll).mean()),
        float(np.mean(_distance_errors_pct(move_m, true_m, windows.walk))),
        float(np.percentile(np.degrees(_turn_errors_rad(move_m, true_m, windows)), 95)),
        *held,
    )


def _distance_errors_pct(move_m: FloatArray, true_m: FloatArray, walk: np.ndarray) -> FloatArray:
    """(W,) for each walk."""
    own, true = (np.bincount(walk, np.hypot(*one.T)) for one in (move_m, true_m))
    walked = true > 1.0
    return np.asarray(100.0 * np.abs(own[walked] / true[walked] - 1.0))


def _turn_errors_rad(move_m: FloatArray, true_m: FloatArray, windows: Windows) -> FloatArray:
    """(K,) absolute, wherever somebody walks in two seconds of which one follows the other."""
    after = {
        (walk, end): i for i, (walk, end) in enumerate(zip(windows.walk.tolist(), windows.end.tolist(), strict=True))
    }
    pairs = [(i, after[walk, end + 50]) for (walk, end), i in after.items() if (walk, end + 50) in after]
    if not pairs:
        return np.zeros(1)
    one, two = np.array(pairs).T
    goes = (np.hypot(*true_m[one].T) > WALKS_M) & (np.hypot(*true_m[two].T) > WALKS_M)
    one, two = one[goes], two[goes]
    turns = [np.arctan2(m[two, 1], m[two, 0]) - np.arctan2(m[one, 1], m[one, 0]) for m in (move_m, true_m)]
    errors: FloatArray = np.abs(wrap_rad(turns[0] - turns[1]))
    return errors if len(errors) else np.zeros(1)
