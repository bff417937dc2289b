"""Fingerprints as histograms, and how far a scan is from each of them (Frank et al. 2009, eq. 1)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdrbench.errors import RecordingError
from pdrbench.geometry import BoolArray, FloatArray, IntArray, read_only
from pdrbench.radio.fingerprints import UNHEARD_DBM
from pdrbench.recording import RadioMap

Unknown = Literal["ignore", "penalise"]
UNKNOWN: Final = ("ignore", "penalise")


@dataclass(frozen=True, slots=True, eq=False)
class HistogramTable:
    """For each calibration point, how often each access point was received with which RSSI.

    Histograms lie access point by access point: those of `access_point[a]` are `first[a]:first[a + 1]`, at rising
    points. Histogram h is of calibration point `point[h]` and has bins of 1 dB around whole numbers: bin k of it counts
    readings of `lowest_dbm[h] + k`.

    Attributes:
        access_point: (A,) int, sorted.
        xy_m: (P, 2) calibration points, in the order in which they were first surveyed.
        level: (P,) int.
        first: (A + 1,) int, into the histograms.
        point: (H,) int.
        lowest_dbm: (H,) int, of the first bin.
        first_bin: (H + 1,) int, histogram h owns the bins `first_bin[h]:first_bin[h + 1]`.
        count: (B,) int, readings in each bin.
    """

    access_point: IntArray
    xy_m: FloatArray
    level: IntArray
    first: IntArray
    point: IntArray
    lowest_dbm: IntArray
    first_bin: IntArray
    count: IntArray
    _queries: Queries = field(init=False, repr=False)

    def __post_init__(self) -> None:
        small, large = np.int32, np.int64
        for name, dtype in (
            ("access_point", large), ("xy_m", np.float64), ("level", large), ("first", large), ("point", small),
            ("lowest_dbm", small), ("first_bin", large), ("count", small),
        ):  # fmt: skip
            object.__setattr__(self, name, read_only(getattr(self, name), dtype))
        object.__setattr__(self, "_queries", _queries_of(self))

    @classmethod
    def from_radio_map(cls, radio_map: RadioMap, *, max_age_s: float = math.inf) -> HistogramTable:
        """Counts the readings of a survey.

        Scans at exactly the same place and level make one calibration point. A histogram is over the scans that
        received the access point: those that did not are not counted, as the paper has no bin for them, so that one
        received in a tenth of the scans looks as well known as one received in all. Of an access point that stands
        twice in a scan the strongest reading counts. A place where nothing was received is no calibration point: every
        scan would be nearest to it.

        Args:
            radio_map: The survey.
            max_age_s: Readings older than this are left out: they were received somewhere else.

        Raises:
            RecordingError: The survey has no scan, or no reading that is fresh enough.
        """
        if not len(radio_map):
            raise RecordingError("radio map: it has no scans; survey the building first, or use one without WLAN")
        fresh = np.flatnonzero(radio_map.age_s <= max_age_s)
        if not len(fresh):
            raise RecordingError(
                f"radio map: none of its {len(radio_map.age_s)} readings is {max_age_s:g} s old or younger; "
                "raise max_age_s or survey again"
            )
        scan = np.repeat(np.arange(len(radio_map)), np.diff(radio_map.first))[fresh]
        access_point = np.unique(radio_map.access_point[fresh])
        column = np.searchsorted(access_point, radio_map.access_point[fresh])
        kept = _strongest(scan * len(access_point) + column, radio_map.rssi_dbm[fresh])
        place_of_scan, first_scan = _places(radio_map)
        point = place_of_scan[scan[kept]]
        spoken = np.unique(point)
        point = np.searchsorted(spoken, point)
        bin_dbm = np.floor(radio_map.rssi_dbm[fresh[kept]] + 0.5).astype(np.int64)
        histograms = _count(column[kept], point, bin_dbm, len(access_point), len(spoken))
        at = first_scan[spoken]
        return cls(access_point, radio_map.xy_m[at], radio_map.level[at], *histograms)

    def __len__(self) -> int:
        """How many calibration points there are."""
        return len(self.xy_m)

    @property
    def nbytes(self) -> int:
        """Memory of all arrays, those that queries read included."""
        own = self.access_point, self.xy_m, self.level, self.point, self.lowest_dbm, self.first_bin, self.count
        return sum(array.nbytes for array in (*own, *self._queries))

    def known(self, access_point: ArrayLike) -> BoolArray:
        """(n,) True for the access points that the survey received anywhere."""
        return self._columns(np.asarray(access_point, dtype=np.float64))[1]

    def distance(self, access_point: ArrayLike, rssi_dbm: ArrayLike, *, unknown: Unknown = "ignore") -> FloatArray:
        """How far a scan is from each calibration point, eq. (1) of Frank et al. 2009 as claim F4 reads it.

        D_p = sum over access points i in the fingerprint p of sum_j |x_i - x_ij| p_ij = E|x_i - X_ip|, which is the
        1-Wasserstein distance between what is observed and the histogram. For one that the scan did not receive, x_i is
        -100 dBm. Those that the survey never received do not count. The nearest is `np.argmin`: the first of equals.

        Args:
            access_point: (n,) that the scan received; of one that stands twice the strongest reading counts.
            rssi_dbm: (n,) as it is, not rounded.
            unknown: What one does that is in the scan and not in the fingerprint of a point: "ignore" as written, which
                prefers points where little was received; "penalise" as if it had been measured there with -100 dBm.

        Returns:
            (P,) in dB, summed over access points.

        Raises:
            RecordingError: A number is not finite, or the survey knows none of the access points: ask `known` first
                and keep the last estimate then.
        """
        from pdrbench.radio.kernels import strongest_readings
        from pdrbench_baselines.frank2009.kernels import add_received

        if unknown not in UNKNOWN:
            raise ValueError(f"unknown is 'ignore' or 'penalise'; got {unknown!r}")
        received, x_dbm = np.array(access_point, dtype=np.float64), np.array(rssi_dbm, dtype=np.float64)
        if received.ndim != 1 or received.shape != x_dbm.shape:
            raise RecordingError(f"scan: give one RSSI per access point; got {x_dbm.shape} for {received.shape}")
        if not (np.isfinite(received).all() and np.isfinite(x_dbm).all()):
            raise RecordingError("scan: access points and RSSI must be numbers; leave out readings without")
        # A copy: for a read-only array the kernel would be compiled again.
        reading = strongest_readings(self.access_point.copy(), received, x_dbm)
        column = np.flatnonzero(reading >= 0)
        if not len(column):
            raise RecordingError(
                f"scan: none of its {len(received)} access points is in the survey; "
                "ask known() and keep the last estimate"
            )
        x_dbm = x_dbm[reading[column]]
        missing_db = np.abs(x_dbm - UNHEARD_DBM) if unknown == "penalise" else np.zeros(len(x_dbm))
        distance_db: FloatArray = self._queries.silence_db + missing_db.sum()
        add_received(distance_db, column, x_dbm, missing_db, UNHEARD_DBM, self._queries)
        return distance_db

    def _columns(self, access_point: FloatArray) -> tuple[IntArray, BoolArray]:
        """Column of each access point, and whether there is one; the column means nothing where not."""
        column = np.minimum(np.searchsorted(self.access_point, access_point), len(self.access_point) - 1)
        is_known: BoolArray = self.access_point[column] == access_point
        return column, is_known


def best_of_three(last: Sequence[int]) -> int:
    """The best of three estimates (Frank et al. 2009, section 2; claim F5).

    Of the last three calibration points the one that was nearest at least twice, else the latest.

    >>> best_of_three([4, 7, 4]), best_of_three([4, 9, 8])
    (4, 8)
    """
    return next((point for point in last if last.count(point) >= 2), last[-1])


class Queries(NamedTuple):
    """What a query reads, laid out in the order in which it is read.

    A slice is of one access point and one step of 1 dB, from the middle of a bin to that of the next. It holds the
    histograms that have bins on both sides; for all others E|x - X| is |x - mean|.

    Attributes:
        first: (A + 1,) int, access point a owns the histograms `first[a]:first[a + 1]`.
        point: (H,) int, calibration point of each histogram.
        mean_dbm: (H,)
        silence_db: (P,) distance of a scan without any access point.
        bottom_dbm: (A,) int, where the first slice of each access point begins.
        first_slice: (A + 1,) int, access point a owns the slices `first_slice[a]:first_slice[a + 1]`.
        first_part: (slices + 1,) int, a slice owns the parts `first_part[s]:first_part[s + 1]`.
        part_of: (parts,) int, the histogram.
        part_point: (parts,) int, its calibration point.
        excess_db: (parts,) E|x - X| - |x - mean| where the slice begins.
        slope: (parts,) by which E|x - X| grows along the slice, per dB.
    """

    first: IntArray
    point: NDArray[np.uint32]
    mean_dbm: FloatArray
    silence_db: FloatArray
    bottom_dbm: IntArray
    first_slice: IntArray
    first_part: IntArray
    part_of: NDArray[np.uint32]
    part_point: NDArray[np.uint32]
    excess_db: FloatArray
    slope: FloatArray


def _queries_of(table: HistogramTable) -> Queries:
    begin, width = table.first_bin[:-1], np.diff(table.first_bin)
    mean_dbm, expected_db, slope = _expected(table)
    # A reading below -100 dBm is possible, and then the histogram reaches to both sides of it.
    top_dbm = table.lowest_dbm + width - 1
    unheard_db = np.abs(UNHEARD_DBM - mean_dbm)
    both = np.flatnonzero((table.lowest_dbm < UNHEARD_DBM) & (top_dbm > UNHEARD_DBM))
    unheard_db[both] = expected_db[begin[both] + int(UNHEARD_DBM) - table.lowest_dbm[both]]

    bottom_dbm = np.minimum.reduceat(table.lowest_dbm, table.first[:-1])
    num_slices = np.maximum.reduceat(top_dbm, table.first[:-1]) - bottom_dbm
    first_slice = np.concatenate([[0], np.cumsum(num_slices, dtype=np.int64)])
    column = np.repeat(np.arange(len(table.access_point)), np.diff(table.first))
    slice_of_histogram = first_slice[column] + table.lowest_dbm - bottom_dbm[column]
    slice_of_bin = np.arange(len(table.count)) + np.repeat(slice_of_histogram - begin, width)
    parts = np.delete(np.arange(len(table.count)), table.first_bin[1:] - 1)  # no slice begins at the last bin
    parts = parts[np.argsort(slice_of_bin[parts], kind="stable")]
    point = table.point.astype(np.uint32)
    part_of = np.repeat(np.arange(len(point)), width)[parts].astype(np.uint32)
    part_dbm = table.lowest_dbm[part_of] + parts - begin[part_of]
    return Queries(
        table.first,
        point,
        mean_dbm,
        np.bincount(table.point, weights=unheard_db, minlength=len(table)).astype(np.float64),
        bottom_dbm,
        first_slice,
        np.searchsorted(slice_of_bin[parts], np.arange(first_slice[-1] + 1)),
        part_of,
        point[part_of],
        expected_db[parts] - np.abs(part_dbm - mean_dbm[part_of]),
        slope[parts],
    )


def _expected(table: HistogramTable) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Mean of each histogram (H,); E|x - X| where x is the middle of each bin, and its slope from there on (B,).

    From one bin to the next E|x - X| grows by the fraction of readings so far less the fraction still to come. In
    whole numbers, hence exact: the division comes last.
    """
    begin, width = table.first_bin[:-1], np.diff(table.first_bin)
    offset = np.arange(len(table.count)) - np.repeat(begin, width)
    total = np.add.reduceat(table.count, begin, dtype=np.int64)
    moment = np.add.reduceat(table.count * offset, begin, dtype=np.int64)
    totals = np.repeat(total, width)
    growth = 2 * _running(table.count, begin, width) - totals
    weighted = np.repeat(moment, width) + _running(growth, begin, width) - growth
    return table.lowest_dbm + moment / total, weighted / totals, growth / totals


def _running(values: IntArray, begin: IntArray, width: IntArray) -> IntArray:
    """Running sums of each histogram."""
    total = np.cumsum(values, dtype=np.int64)
    running: IntArray = total - np.repeat(total[begin] - values[begin], width)
    return running


def _places(radio_map: RadioMap) -> tuple[IntArray, IntArray]:
    """Number of the place of each scan, and the first scan of each place; places in the order of these."""
    order = np.lexsort((radio_map.xy_m[:, 1], radio_map.xy_m[:, 0], radio_map.level))  # stable: first scans first
    xy_m, level = radio_map.xy_m[order], radio_map.level[order]
    is_new = np.append(True, (np.diff(xy_m, axis=0) != 0).any(axis=1) | (np.diff(level) != 0))
    first_scan, place = order[is_new], np.cumsum(is_new) - 1
    rank = np.argsort(np.argsort(first_scan))
    place_of_scan = np.empty_like(order)
    place_of_scan[order] = rank[place]
    return place_of_scan, np.sort(first_scan)


def _strongest(reading_of: IntArray, rssi_dbm: FloatArray) -> IntArray:
    """Rows of the strongest reading of each access point in each scan."""
    if np.diff(np.sort(reading_of)).all():  # each has one, as in most surveys
        return np.arange(len(reading_of))
    order = np.lexsort((-rssi_dbm, reading_of))
    return order[np.diff(reading_of[order], prepend=-1) > 0]


def _count(
    column: IntArray, point: IntArray, bin_dbm: IntArray, num_columns: int, num_points: int
) -> tuple[IntArray, IntArray, IntArray, IntArray, IntArray]:
    """`first`, `point`, `lowest_dbm`, `first_bin` and `count` of a table."""
    bottom = int(bin_dbm.min())
    span = int(bin_dbm.max()) - bottom + 1
    key, number = np.unique((column * num_points + point) * span + bin_dbm - bottom, return_counts=True)
    histogram_of_key, dbm = key // span, key % span
    last = np.flatnonzero(np.diff(histogram_of_key, append=-1))
    begin = np.concatenate([[0], last[:-1] + 1])
    width = dbm[last] - dbm[begin] + 1
    first_bin = np.concatenate([[0], np.cumsum(width)])
    count = np.zeros(first_bin[-1], dtype=np.int32)
    count[np.repeat(first_bin[:-1] - dbm[begin], last + 1 - begin) + dbm] = number
    columns, points = np.divmod(histogram_of_key[begin], num_points)
    first = np.searchsorted(columns, np.arange(num_columns + 1))
    return first, points, dbm[begin] + bottom, first_bin, count
