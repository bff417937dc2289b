"""Figures of a network on windows of people who are in no training set."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

import numpy as np
import torch

from pdrbench.geometry import FloatArray, IntArray, wrap_rad
from pdrbench_baselines.learned.signals import HORIZON, turned
from pdrbench_lab.learned.data import Windows
from pdrbench_lab.learned.model import surprise, whitened

if TYPE_CHECKING:
    from pdrbench_lab.learned.batches import Augmentation, Feed
    from pdrbench_lab.learned.model import PhoneNetwork

WALKS_M: Final = 0.5  # in a second; below it the heading of travel says nothing
LEVELS: Final = (0.50, 0.90, 0.95)


@dataclass(frozen=True, slots=True)
class WindowFigures:
    """On windows of one set of people.

    Attributes:
        error_m: Mean error of the displacement in a second.
        surprise: Mean of minus the log likelihood.
        distance_pct: Mean over walks of the relative error of the distance walked.
        turn_p95_deg: 95 % of the errors of the change of heading from one second to the next.
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
        """All of them in one line of text."""
        held = "/".join(f"{one:.0f}" for one in (self.coverage_50_pct, self.coverage_90_pct, self.coverage_95_pct))
        return (
            f"{self.error_m:.3f} m, -log p {self.surprise:.3f}, distance {self.distance_pct:.1f} %, "
            f"turn P95 {self.turn_p95_deg:.1f} deg, coverage {held} %"
        )


@dataclass(frozen=True, slots=True, eq=False)
class WindowOutputs:
    """Outputs of a network for the N windows of a set.

    Attributes:
        number: (N,) of each window in the set.
        move_m: (N, 2) in the frame of the rotation vector.
        true_m: (N, 2).
        whitened_squares: (N,) squared errors in units of what is claimed: 2 degrees of freedom.
        surprise: (N,) minus the log likelihood.
    """

    number: IntArray
    move_m: FloatArray
    true_m: FloatArray
    whitened_squares: FloatArray
    surprise: FloatArray


def window_outputs(network: PhoneNetwork, feed: Feed, how: Augmentation | None = None) -> WindowOutputs:
    """Asks a network about every window of a set, changed where `how` is given."""
    network.eval()
    parts: list[tuple[FloatArray, ...]] = []
    with torch.no_grad():
        for batch in feed.in_order(how):
            said = network(batch.window, batch.height_m)
            squares = (whitened(said, batch.move_m) ** 2).sum(dim=1)
            figures = (batch.number, batch.yaw_rad, said.move_m, batch.move_m, squares, surprise(said, batch.move_m))
            parts.append(tuple(one.numpy() for one in figures))
    number, yaw_rad, move_m, true_m, square, nll = (np.concatenate(one) for one in zip(*parts, strict=True))
    return WindowOutputs(number, turned(move_m, yaw_rad), turned(true_m, yaw_rad), square, nll)


def window_figures(
    network: PhoneNetwork, feed: Feed, windows: Windows, how: Augmentation | None = None
) -> WindowFigures:
    """Figures over every window of a set, changed where `how` is given."""
    outputs = window_outputs(network, feed, how)
    walk, end = windows.walk[outputs.number], windows.end[outputs.number]
    own, true = (np.bincount(walk, np.hypot(*one.T)) for one in (outputs.move_m, outputs.true_m))
    walked = true > 1.0
    held = [100.0 * float(np.mean(outputs.whitened_squares <= -2.0 * np.log(1.0 - level))) for level in LEVELS]
    return WindowFigures(
        float(np.hypot(*(outputs.move_m - outputs.true_m).T).mean()),
        float(outputs.surprise.mean()),
        float(np.mean(100.0 * np.abs(own[walked] / true[walked] - 1.0))),
        float(np.percentile(np.degrees(_turn_errors_rad(outputs.move_m, outputs.true_m, walk, end)), 95)),
        *held,
    )


def _turn_errors_rad(move_m: FloatArray, true_m: FloatArray, walk: IntArray, ends: IntArray) -> FloatArray:
    """(K,) absolute, wherever the person walks in two consecutive seconds."""
    after = {key: i for i, key in enumerate(zip(walk.tolist(), ends.tolist(), strict=True))}
    pairs = [(i, after[w, end + HORIZON]) for (w, end), i in after.items() if (w, end + HORIZON) in after]
    if not pairs:
        return np.zeros(1)
    one, two = np.array(pairs).T
    goes = (np.hypot(*true_m[one].T) > WALKS_M) & (np.hypot(*true_m[two].T) > WALKS_M)
    one, two = one[goes], two[goes]
    turns = [np.arctan2(m[two, 1], m[two, 0]) - np.arctan2(m[one, 1], m[one, 0]) for m in (move_m, true_m)]
    errors: FloatArray = np.abs(wrap_rad(turns[0] - turns[1]))
    return errors if len(errors) else np.zeros(1)
