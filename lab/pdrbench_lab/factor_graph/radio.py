"""What a scan says, as a smooth cost: minus the logarithm of its likelihood on a lattice, spread by a normal kernel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from pdrbench.geometry import FloatArray, IntArray
from pdrbench_baselines.fusion.radio import MIN_LOG, RadioEvidence
from pdrbench_lab.factor_graph.chain import STATE
from pdrbench_lab.factor_graph.graph import Factor, Terms

REACH: Final = 3  # squares of the lattice to each side: three standard deviations of the kernel

BESIDE: Final = np.stack(np.meshgrid(*2 * [np.arange(-REACH, REACH + 1)], indexing="ij"), axis=-1).reshape(-1, 2)

Scan = Mapping[int, NDArray[np.float32]]  # likelihood by level, (X, Y)


@dataclass(frozen=True, slots=True)
class _Floor:
    """Of a level: the lattice as a grid, each square with the place of the lattice that is nearest to it."""

    low_m: FloatArray
    place: IntArray


class ScanGrids:
    """The lattice of a survey as grids, one for each level.

    Args:
        radio: The survey.
    """

    def __init__(self, radio: RadioEvidence) -> None:
        self._prior, self.square_m = radio.prior, radio.lattice_m
        self._floors: dict[int, _Floor] = {}
        for level in np.unique(radio.level).tolist():
            own = np.flatnonzero(radio.level == level)
            xy_m = radio.xy_m[own]
            low_m = xy_m.min(axis=0) - REACH * self.square_m
            square = np.rint((xy_m - low_m) / self.square_m).astype(np.int64)
            place = np.full(square.max(axis=0) + 1 + REACH, -1)
            place[tuple(square.T)] = own
            nearest = distance_transform_edt(place < 0, return_distances=False, return_indices=True)
            self._floors[level] = _Floor(low_m, place[tuple(nearest)])

    @property
    def levels(self) -> frozenset[int]:
        """That have scans."""
        return frozenset(self._floors)

    def scan(self, log_likelihood: FloatArray) -> Scan:
        """Likelihood on the grids, from logarithms (N, K) on the lattice for every offset of the device."""
        likelihood = np.exp(log_likelihood) @ self._prior
        return {level: likelihood[floor.place].astype(np.float32) for level, floor in self._floors.items()}

    def around(
        self, level: int, scans: NDArray[np.float32], which: IntArray, xy_m: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Spread likelihood (N,) at places, and mean (N, 2) and covariance (N, 2, 2) of what it is spread from.

        With places p_i, likelihoods L_i and a normal kernel k of a standard deviation of one square the first is
        sum L_i k(x - p_i) / sum k(x - p_i), and the others are of p_i with the weights L_i k(x - p_i).

        Args:
            level: Of all places.
            scans: (S, X, Y) likelihood there.
            which: (N,) of the scans.
            xy_m: (N, 2).
        """
        low_m = self._floors[level].low_m
        near = np.rint((xy_m - low_m) / self.square_m).astype(np.int64)
        near = np.clip(near, REACH, np.array(scans.shape[1:]) - 1 - REACH)
        square = near[:, None] + BESIDE
        place_m = low_m + self.square_m * square
        away2 = np.square((place_m - xy_m[:, None]) / self.square_m).sum(axis=2)
        kernel = np.exp(-0.5 * (away2 - away2.min(axis=1, keepdims=True)))  # off the grid it would be 0 everywhere
        weight = kernel * scans[which[:, None], square[..., 0], square[..., 1]]
        total = weight.sum(axis=1)
        weight = (weight / total[:, None])[:, None]
        mean_m = weight @ place_m
        off_m = place_m - mean_m
        spread_m2 = (np.swapaxes(off_m, 1, 2) * weight) @ off_m
        return total / kernel.sum(axis=1), mean_m[:, 0], spread_m2


def radio(grids: ScanGrids, scans: Sequence[tuple[int, Scan]], level: IntArray) -> Factor:
    """Scans at states of every chain; nothing on a level that has no survey.

    Of the cost -log L(x) of a spread likelihood the gradient is -(m - x) / s^2 and the second derivative
    (I - C / s^2) / s^2, with mean m and covariance C as `ScanGrids.around` gives them; of that the positive part.

    Args:
        grids: Of the survey.
        scans: Number of the state where each was received.
        level: (P, T) of every state.
    """
    num_parts, num_states = level.shape
    at = np.array([state for state, _ in scans])
    columns = STATE * (num_states * np.arange(num_parts)[:, None] + at).reshape(-1, 1) + np.arange(2)
    of_scan, which = level[:, at].ravel(), np.tile(np.arange(len(scans)), num_parts)
    groups = []
    for one in np.unique(of_scan).tolist():
        if one in grids.levels:
            groups.append((one, np.stack([scan[one] for _, scan in scans]), np.flatnonzero(of_scan == one)))

    def factor(values: FloatArray) -> Terms:
        xy_m = values[columns]
        cost = np.full(len(xy_m), -MIN_LOG)
        gradient, curvature = np.zeros((len(xy_m), 2)), np.zeros((len(xy_m), 2, 2))
        for one, grid, own in groups:
            total, mean_m, spread_m2 = grids.around(one, grid, which[own], xy_m[own])
            cost[own] = -np.log(total)
            gradient[own] = (xy_m[own] - mean_m) / grids.square_m**2
            curvature[own] = (np.eye(2) - spread_m2 / grids.square_m**2) / grids.square_m**2
        size, axes = np.linalg.eigh(curvature)
        return Terms(columns, cost, gradient, (axes * np.maximum(size, 0.0)[:, None]) @ np.swapaxes(axes, 1, 2))

    return factor
