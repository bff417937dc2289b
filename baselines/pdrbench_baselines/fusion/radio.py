"""What a scan says of every place of a lattice, by the radio map of `gp_wifi` and by fingerprints.

Fields are fitted and evaluated only on levels, and with offsets of the device, that particles still have.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection, Iterator
from typing import Final

import numpy as np
from scipy.ndimage import distance_transform_edt
from scipy.sparse import csr_array
from scipy.spatial import KDTree

from pdrbench.building import Building
from pdrbench.geometry import BoolArray, FloatArray, IntArray
from pdrbench.recording import RadioMap
from pdrbench_baselines.gp_wifi.field import SignalMap
from pdrbench_baselines.gp_wifi.fingerprints import FingerprintEvidence
from pdrbench_baselines.gp_wifi.kernels import squares_at
from pdrbench_baselines.gp_wifi.localizer import GpWifiParams
from pdrbench_baselines.gp_wifi.sightings import Sweeps

MIN_LOG: Final = -30.0  # likelihoods below e to that of the best count as that
# People walk where the surveyors walked: of a map without walls, how near to their legs, how often elsewhere at least,
# and the power of that at each scan, since what neighbouring scans say of it is one thing. Ours.
WALKED_M, ELSEWHERE, WALKED_TRUST = 2.5, 0.05, 0.2
SAME_ROUTE: Final = 0.8  # of the squares of either walk that the other one crosses
NEWS_S: Final = (
    1.8  # between scans of the malls and of Campus, by which trust was chosen; other phones send three in it
)
MAX_LEG_M, LEG_PARTS = 20.0, 8  # scans farther apart are no leg; places along one
BESIDE: Final = 1.5  # squares: so near to the lattice, a place has the likelihood of its nearest square


class RadioEvidence:
    """A radio survey; scans come in by `update`.

    Args:
        radio_map: With one scan or more.
        building: Its floor is where the lattice is; without one that is around the survey.
        params: Of the radio map.
        error_m: By which the radio map is off, per axis: likelihoods are spread so far.
        off_legs: Fraction of the time that a walker is away from the legs of the survey; only used without a building.

    Attributes:
        params: Of the radio map.
        places: The radio map.
        xy_m: (N, 2) the lattice.
        level: (N,) int.
        offset_db: (K,) what a device may add to every reading.
        prior: (K,) of these offsets.
        lattice_m: Side of a square.
        fingerprints: What they say of a scan beside fields; None for nothing.
    """

    def __init__(
        self,
        radio_map: RadioMap,
        building: Building | None,
        params: GpWifiParams,
        error_m: float,
        off_legs: float = ELSEWHERE,
    ) -> None:
        self.radio_map, self.building, self.params, self._error_m = radio_map, building, params, error_m
        self.places = SignalMap(radio_map, building, params.field)
        self.xy_m, self.level, self.lattice_m = self.places.xy_m, self.places.level, params.field.lattice_m
        self.offset_db, self.prior = params.offsets_db()
        self._reached: dict[int, FloatArray] = {}
        size = (len(self.places.levels), *(self.places.row.max(axis=0) + 3))  # an empty square, or more, all around
        self._nearest, self._is_beside = np.empty(size, dtype=np.int64), np.empty(size, dtype=np.bool_)
        self._corner_m = np.empty((size[0], 2))
        for number, (low, high) in enumerate(itertools.pairwise(self.places.first)):
            row, square = self.places.row[low:high] + 1, np.full(size[1:], -1)
            square[tuple(row.T)] = np.arange(low, high)
            away, nearest = distance_transform_edt(square < 0, return_indices=True)
            self._nearest[number], self._is_beside[number] = square[tuple(nearest)], away <= BESIDE
            self._corner_m[number] = self.xy_m[low] - (row[0] + 0.5) * self.lattice_m
        self._off_legs = off_legs
        self.walked = self._walked(radio_map) if building is None else np.zeros(len(self.level))
        self.fingerprints: FingerprintEvidence | None = None
        self.begin(1.0)

    def begin(self, trust: float, fingerprint_trust: float = 0.0, max_work: float = math.inf) -> None:
        """Begins another walk; likelihoods, and densities of `fingerprints`, are taken to these powers.

        Readings wait for later updates where their new fields are more work than `max_work` (`SignalMap.work`).
        """
        self._max_work, self._new_part = max_work, 1.0
        self._waiting: list[FloatArray] = []
        self._numbers = range(len(self.places.levels))  # of the levels on which scans are evaluated
        self._offsets = np.arange(len(self.prior))
        self._scanned_s = -math.inf
        self._sweeps, self._trust, self._fingerprint_trust = Sweeps(), trust, fingerprint_trust
        if self.fingerprints is not None:
            self.fingerprints.begin()

    def get_ready(self) -> None:
        """For scans on all levels."""
        if self._trust > 0.0:
            self.places.get_ready()

    def focus(self, levels: Collection[int], is_left: BoolArray) -> None:
        """Scans are evaluated on these levels and those between them, on all where none is surveyed, and under the
        offsets (K,) that are left."""
        on = np.flatnonzero(np.isin(self.places.levels, list(levels)))
        if len(on):
            self._numbers = range(int(on[0]), int(on[-1]) + 1)
        self._offsets = np.flatnonzero(is_left)

    @property
    def waits(self) -> bool:
        """Whether readings wait for a later update."""
        return len(self._waiting) > 0

    def update(self, rows: FloatArray) -> Iterator[FloatArray]:
        """Log-likelihoods (N, K), up to a constant, of all scans among the next rows together; very low elsewhere.

        Of a scan with many new access points the strongest readings come first, the others with the next updates.
        """
        if not len(rows) and not self.waits:
            return
        places = slice(int(self.places.first[self._numbers[0]]), int(self.places.first[self._numbers[-1] + 1]))
        total = np.zeros((places.stop - places.start, len(self._offsets)))
        for likelihood in self._of_fields(rows):
            total += likelihood
        if len(rows):
            self._new_part = self._news(float(rows[-1, 0]))
            if self.fingerprints is not None and self._fingerprint_trust > 0.0:
                for density in self.fingerprints.update(rows, places):
                    total += self._fingerprint_trust * density[:, None]
        if np.ptp(total) > 0.0:
            total = self._new_part * (total + self.walked[places, None] * bool(len(rows)))
            everywhere = np.full((len(self.level), len(self.prior)), MIN_LOG)
            everywhere[places, self._offsets] = np.maximum(total - total.max(), MIN_LOG)
            yield everywhere

    def _walked(self, radio_map: RadioMap) -> FloatArray:
        """(N,) logarithm of how likely a walker is at places of the lattice rather than on a leg of the survey."""
        away_m = np.full(len(self.level), np.inf)
        for level in np.unique(self.level).tolist():
            here = self.level == level
            away_m[here] = KDTree(_legs(radio_map, level)[0]).query(self.xy_m[here])[0]
        near = np.exp(-0.5 * (away_m / WALKED_M) ** 2)
        return np.asarray(WALKED_TRUST * np.log((1.0 - self._off_legs) * near + self._off_legs))

    def _news(self, now_s: float) -> float:
        """Which part of a scan is news: each of several within two seconds repeats the one before."""
        since_s = now_s - self._scanned_s
        self._scanned_s = now_s
        return min(1.0, since_s / NEWS_S)

    def elsewhere(self, log_likelihood: FloatArray) -> float:
        """Log-likelihood of a scan, that on the lattice (N, K) given: off the floor, or off the survey."""
        if self.building is not None:
            return float(log_likelihood.min())
        return math.log(self._off_legs * float(np.exp(log_likelihood[log_likelihood > MIN_LOG]).mean()))

    def squares_at(self, xy_m: FloatArray, level: IntArray, *, nearest: bool = False) -> IntArray:
        """(M,) which place of the lattice places (M, 2) on levels (M,) are at; where none, the nearest, or -1."""
        squares = self.places.levels, self._nearest, self._is_beside, self._corner_m, self.lattice_m
        return np.asarray(squares_at(xy_m, level, *squares, nearest))

    def _of_fields(self, rows: FloatArray) -> Iterator[FloatArray]:
        """(n, k) of each scan at the places and under the offsets that are left; none where fields are not trusted."""
        if self._trust == 0.0:
            return
        scans, self._waiting, left = self._waiting, [], self._max_work
        scans += [fresh[np.argsort(-fresh[:, 2], kind="stable")] for _, fresh, _ in self._sweeps.update(rows)]
        for fresh in scans:
            access_points = fresh[:, 1].astype(np.int64)
            work = np.cumsum(self._work(access_points))
            count = max(int(np.searchsorted(work, left, side="right")), 1)
            left -= work[count - 1 : count].sum()
            if count < len(fresh):
                self._waiting.append(fresh[count:])
            offset_db, now = self.offset_db[self._offsets], (access_points[:count], fresh[:count, 2].tolist())
            likelihood = self.params.log_likelihood(self.places, self._numbers, *now, offset_db)
            if np.ptp(likelihood) > 0.0:
                yield self._spread(self._trust * likelihood)

    def _work(self, access_points: IntArray) -> FloatArray:
        """(A,) of fitting the fields of access points, see `SignalMap.work`."""
        new = ((self.places.work(one), self.places.new(access_points, one)) for one in self._numbers)
        return np.asarray(np.sum([work * np.isin(access_points, which) for work, which in new], axis=0))

    def _spread(self, log_likelihood: FloatArray) -> FloatArray:
        """(n, k) the same, each place taking the mean of the floor around it; that of the likeliest is 0."""
        likelihood = np.exp(log_likelihood - log_likelihood.max())
        first = self.places.first - self.places.first[self._numbers[0]]
        spread = np.concatenate(
            [self._around(number, likelihood[first[number] : first[number + 1]]) for number in self._numbers]
        )
        spread_log: FloatArray = np.log(np.maximum(spread / spread.max(), np.exp(MIN_LOG)))
        return spread_log

    def _around(self, number: int, value: FloatArray) -> FloatArray:
        """(n, k) means of values (n, k) of the floor around each place of the level of that number."""
        if number not in self._reached:
            ones = np.ones((int(np.diff(self.places.first)[number]), 1))
            self._reached[number] = self.places.smoothed(number, ones, self._error_m)
        return self.places.smoothed(number, value, self._error_m) / self._reached[number]


def fraction_off_survey(radio_map: RadioMap) -> float:
    """Fraction of the time that the next walker is off the survey, estimated by leaving out one route at a time; ours.

    The floor is divided into squares of 5 m. A square that a survey walk crosses counts as surveyed where a walk along
    another route crosses it or a neighbour of it; walks along the same route (`SAME_ROUTE`) are left out together. The
    mean over walks of the fraction that is not, at least `ELSEWHERE`; 1 where all walks follow one route.
    """
    levels, walks = np.unique(radio_map.level), np.unique(radio_map.walk)
    squares = []
    for number, level in enumerate(levels.tolist()):
        xy_m, walk = _legs(radio_map, level)
        row = np.floor(xy_m / (2 * WALKED_M)).astype(np.int64)
        squares.append(np.column_stack([np.searchsorted(walks, walk), np.full(len(row), number), row]))
    walk, *square = np.unique(np.concatenate(squares), axis=0).T
    square = [of - of.min() + 1 for of in square]
    shape = [of.max() + 2 for of in square]

    def crossed(reach: int) -> csr_array:
        """(W, squares) 1 where a walk crosses a square, or one that is at most `reach` squares away."""
        steps = [(0, x, y) for x in range(-reach, reach + 1) for y in range(-reach, reach + 1)]
        at = [np.ravel_multi_index([of + by for of, by in zip(square, step, strict=True)], shape) for step in steps]
        row = np.tile(walk, len(steps))
        found = csr_array((np.ones(len(row), np.float32), (row, np.concatenate(at))), (len(walks), math.prod(shape)))
        found.data = np.minimum(found.data, 1.0)
        return found

    own, near = crossed(0), crossed(1)
    # fraction (W, W) of the squares of one walk that another comes near to, and which walks follow the same route
    shared = (own @ near.T) / own.sum(axis=1)[:, None]
    same = (shared.minimum(shared.T) >= SAME_ROUTE).astype(np.float32)
    # (W, squares) by how many walks along other routes each own square is surveyed
    others = own.multiply(near.sum(axis=0)[None]) - own.multiply(same @ near)
    return max(ELSEWHERE, 1.0 - float(np.mean((others > 0.5).sum(axis=1) / own.sum(axis=1))))


def _legs(radio_map: RadioMap, level: int) -> tuple[FloatArray, IntArray]:
    """(M, 2) places of scans on a level, and along lines to the next scan of the same walk; (M,) the walks."""
    on = radio_map.level == level
    xy_m, walk = radio_map.xy_m[on], radio_map.walk[on]
    is_leg = (np.diff(walk) == 0) & (np.linalg.norm(np.diff(xy_m, axis=0), axis=1) < MAX_LEG_M)
    part = np.linspace(0.0, 1.0, LEG_PARTS, endpoint=False)[:, None, None]
    between_m = (1.0 - part) * xy_m[:-1][is_leg] + part * xy_m[1:][is_leg]
    return np.vstack([xy_m, between_m.reshape(-1, 2)]), np.concatenate([walk, np.tile(walk[:-1][is_leg], LEG_PARTS)])
