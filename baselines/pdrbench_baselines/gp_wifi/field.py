"""Signal strengths of access points on a lattice, from a survey that leaves most of the floor out.

On every level an access point has a path-loss mean A - 10 n log10 |x - p|, of a place p, an exponent n and a level A,
with normal priors on n and A; the posterior of p is taken on a grid, n and A in closed form, and mean and variance of
the mixture extrapolate. What it leaves is a Gaussian process (Ferris, Haehnel & Fox 2006) with an exponential kernel.
A scan that does not report an access point says that it is weak there, more or less: a reading r is reported with
probability q Phi((r - c) / s), so that a miss is a probit observation. It enters as the normal site that has the same
first two derivatives at the mean as predicted without it (one step of expectation propagation).

Evaluated once on a lattice over the floor, a field keeps what is above `weakest_dbm`. Access points are fitted when
they are first asked for.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from scipy.linalg.blas import strsm
from scipy.linalg.lapack import spotrf
from scipy.ndimage import gaussian_filter
from scipy.special import ndtr

from pdrbench.building import Building, FloorRegion
from pdrbench.geometry import FloatArray, IntArray
from pdrbench.recording import RadioMap
from pdrbench.trajectory import Start
from pdrbench_baselines.gp_wifi.kernels import equations
from pdrbench_baselines.gp_wifi.sightings import Sightings, sightings_of

FAR_M2: Final = 1e12  # to another level
NEAREST_M2: Final = 4.0  # added to squared distances: phones and access points are at different heights


@dataclass(frozen=True, slots=True)
class SignalFieldParams:
    """Ours; those of misses and of the noise were read off train walks of MallPhoneLost-v2, left out of the survey.

    Attributes:
        lattice_m: Between places where fields are evaluated.
        cell_m: Edge of the cells in which a survey is gathered.
        grid_m: Between places where an access point may be.
        margin_m: Around the survey, for both.
        covers_floor: Whether the lattice has all floor of a surveyed level, however far from the survey.
        exponent, exponent_sigma: Prior of n.
        level_dbm, level_sigma_db: Prior of A.
        mean_sigma_db: What path loss leaves, where it is fitted.
        evidence: By so much evidence for the place of an access point is divided: neighbouring cells err alike.
        draws: Places of an access point that are averaged.
        shadow_db, shadow_m: Spread and length of the Gaussian process.
        nugget_db: Of it, what differs within a cell.
        noise_db: Of a reading.
        reported: q.
        half_dbm: c.
        half_sigma_db: s.
        min_information_per_db2: Of a miss; what says less is left out.
        min_cells: Where an access point was received in fewer cells of a level it has no field there.
        weakest_dbm: Weaker means are left out.
    """

    lattice_m: float = 3.0
    cell_m: float = 3.0
    grid_m: float = 6.0
    margin_m: float = 20.0
    covers_floor: bool = False
    exponent: float = 2.5
    exponent_sigma: float = 0.5
    level_dbm: float = -38.0
    level_sigma_db: float = 8.0
    mean_sigma_db: float = 7.0
    evidence: float = 4.0
    draws: int = 12
    shadow_db: float = 6.0
    shadow_m: float = 10.0
    nugget_db: float = 3.0
    noise_db: float = 5.0
    reported: float = 0.95
    half_dbm: float = -70.0
    half_sigma_db: float = 11.0
    min_information_per_db2: float = 1e-3
    min_cells: int = 2
    weakest_dbm: float = -91.0


class Field(NamedTuple):
    """One access point on a level.

    Attributes:
        at: (E,) int, places of the lattice.
        mean_dbm: (E,).
        variance_db2: (E,).
    """

    at: IntArray
    mean_dbm: FloatArray
    variance_db2: FloatArray


class SignalMap:
    """The fields of all access points of a survey.

    Args:
        radio_map: With one scan or more.
        building: Its floor is where the lattice is; None for what is near to the survey.
        params: See `SignalFieldParams`.

    Attributes:
        xy_m: (N, 2) the lattice, level by level.
        level: (N,).
        row: (N, 2) int, row and column of each place on its level.
        levels: (L,) that are surveyed, ascending.
        first: (L + 1,) int, level k owns the places `first[k]:first[k + 1]`.
    """

    def __init__(self, radio_map: RadioMap, building: Building | None, params: SignalFieldParams) -> None:
        self.params = params
        survey = sightings_of(radio_map)
        self.access_point, column = np.unique(survey.access_point, return_inverse=True)
        self.levels = np.unique(survey.scan_level)
        region = None if building is None else FloorRegion.whole(building)
        self._levels = [
            _Level(survey, column, len(self.access_point), int(level), building, region, params)
            for level in self.levels
        ]
        self.first = np.cumsum([0, *(len(level.lattice_m) for level in self._levels)])
        self.xy_m = np.concatenate([level.lattice_m for level in self._levels])
        self.row = np.concatenate([level.row for level in self._levels])
        self.level = np.repeat(self.levels, np.diff(self.first))
        self._parts: list[dict[int, Field]] = [{} for _ in self._levels]
        self._surveyed = frozenset(self.access_point.tolist())

    def get_ready(self) -> None:
        """For access points on all levels."""
        for level in self._levels:
            level.get_ready()

    def prepare(self, access_points: IntArray, number: int) -> list[Field | None]:
        """Fields of access points on the level of that number alone, in single precision; its first place is 0.

        Those asked for the first time are fitted together; None of one that was not received there.
        """
        parts, new = self._parts[number], self.new(access_points, number)
        if len(new):
            level, columns = self._levels[number], np.searchsorted(self.access_point, new)
            level.fit(columns)
            for one, column in zip(new.tolist(), columns.tolist(), strict=True):
                at, mean_dbm, variance_db2 = level.field(column)
                parts[one] = Field(at.astype(np.int32), mean_dbm.astype(np.float32), variance_db2.astype(np.float32))
        return [parts.get(one) for one in access_points.tolist()]

    def new(self, access_points: IntArray, number: int) -> IntArray:
        """Those of them, ascending, that are surveyed and were not asked for on the level of that number."""
        asked = self._surveyed.intersection(access_points.tolist()).difference(self._parts[number])
        return np.array(sorted(asked), dtype=np.int64)

    def work(self, number: int) -> float:
        """Of fitting one field on the level of that number: surveyed cells, squared."""
        return float(len(self._levels[number].cell_m)) ** 2

    def near(self, start: Start, least_m: float) -> FloatArray:
        """(N,) normal density about a start on its level; where that has no survey, on all levels. Its sum is 1."""
        away_m2 = ((self.xy_m - start.xy_m) ** 2).sum(axis=1) + np.where(self.level == start.level, 0.0, FAR_M2)
        density = np.exp(-0.5 * (away_m2 - away_m2.min()) / max(least_m, start.radius_m / 2) ** 2)
        return np.asarray(density / density.sum())

    def smoothed(self, number: int, value: FloatArray, sigma_m: float, reach: float = 4.0) -> FloatArray:
        """(n, k) values on the lattice of the level of that number, each spread over the floor around it."""
        x, y = self.row[self.first[number] : self.first[number + 1]].T
        floor, sigma = np.zeros((x.max() + 1, y.max() + 1, value.shape[1])), sigma_m / self.params.lattice_m
        floor[x, y] = value
        return np.asarray(gaussian_filter(floor, (sigma, sigma, 0.0), mode="constant", truncate=reach)[x, y])

    @property
    def nbytes(self) -> int:
        """Memory of the fields that were asked for."""
        fields = [field for parts in self._parts for field in parts.values()]
        return sum(f.at.nbytes + f.mean_dbm.nbytes + f.variance_db2.nbytes for f in fields)


class _Level:
    """One level of a survey."""

    def __init__(
        self,
        survey: Sightings,
        column: IntArray,
        num_access_points: int,
        level: int,
        building: Building | None,
        region: FloorRegion | None,
        params: SignalFieldParams,
    ) -> None:
        p = self._params = params
        on = survey.scan_level[survey.scan] == level
        scans_m, xy_m, column = survey.scan_xy_m[survey.scan_level == level], survey.xy_m[on], column[on]
        cells, at = _cells(np.concatenate([scans_m, xy_m]), p.cell_m)
        self.cell_m = (cells + 0.5) * p.cell_m
        self._scans = np.bincount(at[: len(scans_m)], minlength=len(cells)).astype(np.float64)[:, None]
        order = np.argsort(column.astype(np.min_scalar_type(num_access_points)), kind="stable")
        first = np.searchsorted(column[order], np.arange(num_access_points + 1))
        self._readings = first, at[len(scans_m) :][order], survey.rssi_dbm[on][order]
        low_m, high_m = self.cell_m.min(axis=0) - p.margin_m, self.cell_m.max(axis=0) + p.margin_m
        self._grid_m = _lattice(low_m, high_m, p.grid_m)[0]
        if p.covers_floor and building is not None and region is not None:
            corners_m = region.corners_xy_m[building.level(region.polygon) == level].reshape(-1, 2)
            reach_m = np.concatenate([[low_m, high_m], corners_m])
            low_m, high_m = reach_m.min(axis=0), reach_m.max(axis=0)
        self.lattice_m, self.row = self._on_floor(*_lattice(low_m, high_m, p.lattice_m), level, building, region)
        self._is_ready = False

    def get_ready(self) -> None:
        """Computes what all access points have in common, once: of some levels nothing is ever asked."""
        if self._is_ready:
            return
        p, self._is_ready = self._params, True
        # single precision is enough: the noise of every cell keeps the matrix far from singular
        self._prior = (p.shadow_db**2 * _kernel(self.cell_m, self.cell_m, p.shadow_m)).astype(np.float32)
        self._cross = (p.shadow_db**2 * _kernel(self.cell_m, self.lattice_m, p.shadow_m)).astype(np.float32)
        self._to_cells = _loss(self._grid_m, self.cell_m)
        self._to_cells_squared = self._to_cells**2
        self._to_lattice = np.empty((len(self._grid_m), len(self.lattice_m)), dtype=np.float32)
        self._has_loss = np.zeros(len(self._grid_m), dtype=np.bool_)  # rows of that are filled when they are needed

    def fit(self, numbers: IntArray) -> None:
        """Fits path losses of access points (A,), ascending; what was fitted before is forgotten."""
        self.get_ready()
        first, cell, rssi_dbm = self._readings
        size, ranges = len(self.cell_m), [slice(*first[one : one + 2]) for one in numbers.tolist()]
        received = np.stack([np.bincount(cell[one], minlength=size) for one in ranges], axis=1).astype(np.float64)
        total = np.stack([np.bincount(cell[one], rssi_dbm[one], size) for one in ranges], axis=1).astype(np.float64)
        own = np.flatnonzero((received > 0).sum(axis=0) >= self._params.min_cells)
        self._own, self._received, total = numbers[own], received[:, own], total[:, own]
        self._dbm = np.divide(total, self._received, out=np.zeros_like(total), where=self._received > 0)
        self._fit_path_loss()
        p, is_received = self._params, self._received > 0
        noise_db2 = np.where(is_received, p.noise_db**2 / np.maximum(self._received, 1), self._site_db2)
        left_db = np.where(is_received, self._dbm, self._site_dbm) - self._mean_dbm
        self._is_seen = (is_received | self._is_miss).T.copy()
        self._left_db, self._noise_db2 = (of.T.astype(np.float32) for of in (left_db, noise_db2 + p.nugget_db**2))
        new = np.unique(self._place)
        new = new[~self._has_loss[new]]
        self._to_lattice[new], self._has_loss[new] = _loss(self._grid_m[new], self.lattice_m), True
        # mean and variance (A, N) over the places where an access point may be
        each_dbm = np.array([self._path_loss_dbm(place) for place in self._place])
        self._at_lattice = each_dbm.mean(axis=0), each_dbm.var(axis=0)

    def _path_loss_dbm(self, place: IntArray) -> FloatArray:
        """(A, N) on the lattice, were access points at places (A,) of the grid."""
        level_dbm, exponent = (of[place, np.arange(len(place)), None] for of in (self._level_dbm, self._exponent))
        return np.asarray(level_dbm + exponent * self._to_lattice[place])

    def field(self, number: int) -> tuple[IntArray, FloatArray, FloatArray]:
        """Places of the lattice (E,), means and variances there, of one access point."""
        own = int(np.searchsorted(self._own, number))
        if own == len(self._own) or self._own[own] != number:
            return np.zeros(0, dtype=np.int64), np.zeros(0), np.zeros(0)
        p, (mean_dbm, variance_db2) = self._params, (of[own] for of in self._at_lattice)
        near = (mean_dbm > p.weakest_dbm - 4.0).nonzero()[0]
        covariance, right = equations(
            self._is_seen[own], self._left_db[own], self._noise_db2[own], near, self._prior, self._cross
        )
        factor, _ = spotrf(covariance.T, lower=False, clean=False, overwrite_a=True)
        # X U = B, in the order of memory that is at hand
        left, known = np.split(strsm(1.0, factor, right.T, side=True, lower=False, overwrite_b=True), [1])
        mean_dbm = mean_dbm[near] + known @ left[0]
        kept = (mean_dbm > p.weakest_dbm).nonzero()[0]
        variance_db2 = variance_db2[near] + p.shadow_db**2 - np.einsum("nc,nc->n", known, known)
        return near[kept], mean_dbm[kept], variance_db2[kept]

    def _fit_path_loss(self) -> None:
        """Places, exponents and levels of all access points: on the grid with what was received, then with misses."""
        p, is_received = self._params, self._received > 0
        loss = self._to_cells
        prior_level, prior_exponent = p.mean_sigma_db**2 / np.square([p.level_sigma_db, p.exponent_sigma])
        column = np.arange(len(self._own))
        self._is_miss, self._site_dbm, self._site_db2 = (
            np.zeros(is_received.shape, kind) for kind in (bool, float, float)
        )
        for is_again in (False, True):
            weight, value = is_received.astype(np.float64), self._dbm
            if is_again:
                self._see_misses(p.mean_sigma_db)
                weight = weight + np.where(self._is_miss, 1.0 / (1.0 + self._site_db2 / p.mean_sigma_db**2), 0.0)
                value = np.where(is_received, self._dbm, self._site_dbm)
            weighted = weight * value
            # normal equations of level and exponent for every place of the grid (J,) and every access point (A,)
            one, two, both = (
                weight.sum(axis=0) + prior_level,
                self._to_cells_squared @ weight + prior_exponent,
                loss @ weight,
            )
            left = weighted.sum(axis=0) + prior_level * p.level_dbm
            right = loss @ weighted + prior_exponent * p.exponent
            determinant = one * two - both**2
            self._level_dbm, self._exponent = (
                (two * left - both * right) / determinant,
                (one * right - both * left) / determinant,
            )
            fits = (self._level_dbm * left + self._exponent * right) / (2 * p.evidence * p.mean_sigma_db**2)
            likely = np.cumsum(np.exp(fits - fits.max(axis=0)), axis=0)
            likely /= likely[-1]
            # evenly spaced quantiles of the posterior over the grid
            self._place = np.stack([(likely < (draw + 0.5) / p.draws).sum(axis=0) for draw in range(p.draws)])
            self._place = np.minimum(self._place, len(loss) - 1)
            slope = np.zeros_like(self._exponent)
            np.add.at(slope, (self._place, column), self._exponent[self._place, column] / p.draws)
            self._mean_dbm = self._level_dbm[self._place, column].mean(axis=0) + loss.T @ slope
        self._see_misses(p.shadow_db)

    def _see_misses(self, sigma_db: float) -> None:
        """Normal sites of cells (C, A) where an access point was not reported: value, variance, and which say enough.

        log(1 - q Phi(z)), z = (mean - c) / sqrt(s^2 + sigma^2), has the derivatives d1 and d2; the site that gives the
        same posterior has the value mean - d1 / d2 and the variance -1 / d2 - sigma^2, over the number of scans there.
        """
        p = self._params
        scale = math.hypot(p.half_sigma_db, sigma_db)
        z = (self._mean_dbm - p.half_dbm) / scale
        density = p.reported * np.exp(-0.5 * z**2) / math.sqrt(2 * math.pi) / scale
        missed = 1.0 - p.reported * ndtr(z)
        first = -density / missed
        second = density * z / (scale * missed) - first**2
        self._is_miss = (self._received == 0) & (self._scans > 0) & (second < -p.min_information_per_db2)
        bent = np.where(self._is_miss, second, -1.0)
        self._site_dbm = self._mean_dbm - first / bent
        self._site_db2 = np.maximum(-1.0 / bent - sigma_db**2, 1.0) / np.maximum(self._scans, 1.0)

    def _on_floor(
        self, places_m: FloatArray, row: IntArray, level: int, building: Building | None, region: FloorRegion | None
    ) -> tuple[FloatArray, IntArray]:
        """Places of a lattice that are floor, or near to the survey where the floor is not known."""
        kept = np.zeros(len(places_m), dtype=np.bool_)
        if building is not None and region is not None:
            place, triangle = region.triangles_at(places_m)
            kept[place[building.level(region.polygon)[triangle] == level]] = True
        if not kept.any():
            kept = _squares(places_m, self.cell_m).min(axis=1) < self._params.margin_m**2
        return places_m[kept], row[kept]


def _cells(xy_m: FloatArray, cell_m: float) -> tuple[FloatArray, IntArray]:
    """(C, 2) whole numbers of cells that hold places (N, 2), ascending, and (N,) the cell of each."""
    cell = np.floor(xy_m / cell_m).astype(np.int64)
    low = cell.min(axis=0)
    columns = int(cell[:, 1].max()) - low[1] + 1
    number = (cell[:, 0] - low[0]) * columns + cell[:, 1] - low[1]
    held = np.bincount(number) > 0
    cells = np.stack(np.divmod(np.flatnonzero(held), columns), axis=1) + low
    return cells.astype(np.float64), (np.cumsum(held) - 1)[number]


def _lattice(low_m: FloatArray, high_m: FloatArray, step_m: float) -> tuple[FloatArray, IntArray]:
    """Middles of the squares of a rectangle, and row and column of each."""
    numbers = [np.arange(max(1, math.ceil((high - low) / step_m))) for low, high in zip(low_m, high_m, strict=True)]
    row = np.stack(np.meshgrid(*numbers, indexing="ij"), axis=-1).reshape(-1, 2)
    return low_m + (row + 0.5) * step_m, row


def _squares(one_m: FloatArray, other_m: FloatArray) -> FloatArray:
    """(M, N) squared distances."""
    away_m2: FloatArray = np.subtract.outer(one_m[:, 0], other_m[:, 0]) ** 2
    away_m2 += np.subtract.outer(one_m[:, 1], other_m[:, 1]) ** 2
    return away_m2


def _loss(one_m: FloatArray, other_m: FloatArray) -> FloatArray:
    """(M, N) path loss of exponent 1."""
    loss: FloatArray = -5.0 * np.log10(_squares(one_m, other_m) + NEAREST_M2)
    return loss


def _kernel(one_m: FloatArray, other_m: FloatArray, length_m: float) -> FloatArray:
    """(M, N) correlation."""
    correlation: FloatArray = np.exp(-np.sqrt(_squares(one_m, other_m)) / length_m)
    return correlation
