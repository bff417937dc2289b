"""Where each access point is received, and where a walker is who receives several (Woodman & Harle 2008, eq. 17-19)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from pdrbench.building import FloorRegion
from pdrbench.errors import RecordingError
from pdrbench.geometry import BoolArray, FloatArray, IntArray, read_only
from pdrbench.radio.cells import NO_CELL, Cells
from pdrbench.recording import RadioMap

STRONG_DBM: Final = -75.0  # claim W13
FRESH_S: Final = 2.5  # an older reading was received on the way here, perhaps in another cell; sources.md 1.9


@dataclass(frozen=True, slots=True, eq=False)
class WlanStart:
    """Where one scan was received.

    Attributes:
        region: The prior is uniform over it (eq. 19); never empty.
        used: (k,) int, access points whose regions were intersected, strongest first; none: it is the whole building.
        dropped: (d,) int, strong access points that were left out, strongest first: with them nothing was left.
        unknown: (u,) int, strong access points that the survey never sighted, strongest first.
    """

    region: FloorRegion
    used: IntArray
    dropped: IntArray
    unknown: IntArray


@dataclass(frozen=True, slots=True, eq=False)
class VisibilityMap:
    """A coarse radio map: which access points can be seen from which cells.

    Attributes:
        cells: The floor.
        access_point: (A,) int, sorted.
        visible: (A, C) bool; row j is the set of cells A_j of eq. 17, column i the set V_i.
        num_stray: Scans of the survey that lay in no cell and count for none.
    """

    cells: Cells
    access_point: IntArray
    visible: BoolArray
    num_stray: int = 0

    def __post_init__(self) -> None:
        object.__setattr__(self, "access_point", read_only(self.access_point, np.int64))
        object.__setattr__(self, "visible", read_only(self.visible, np.bool_))
        if self.visible.shape != (len(self.access_point), self.cells.num_cells):
            raise RecordingError(
                f"a visibility map of {len(self.access_point)} access points and {self.cells.num_cells} cells needs "
                f"one bool for each pair; got {self.visible.shape}"
            )
        if (np.diff(self.access_point) <= 0).any() or not self.visible.any(axis=1).all():
            raise RecordingError("visibility map: access points are sorted, and each is visible somewhere")

    @classmethod
    def from_radio_map(cls, cells: Cells, radio_map: RadioMap, *, max_age_s: float = FRESH_S) -> VisibilityMap:
        """Sights every access point in a cell that one or more scans inside it received.

        A_j = {c_i | ap_j in V_i}, eq. 17.

        Args:
            cells: Of the building that was surveyed.
            radio_map: Its scans; one outside every cell is counted, not used.
            max_age_s: Older readings do not count.
        """
        cell_of_scan = cells.locate(radio_map.level, radio_map.xy_m)
        cell = np.repeat(cell_of_scan, np.diff(radio_map.first))
        is_sighted = (cell != NO_CELL) & (radio_map.age_s <= max_age_s)
        access_point, row = np.unique(radio_map.access_point[is_sighted], return_inverse=True)
        visible = np.zeros((len(access_point), cells.num_cells), dtype=np.bool_)
        visible[row, cell[is_sighted]] = True
        return cls(cells, access_point, visible, int((cell_of_scan == NO_CELL).sum()))

    def region(self, access_point: int) -> FloorRegion:
        """The visible region R_j of an access point, the union of its cells (eq. 18); empty where it is unknown."""
        row = np.flatnonzero(self.access_point == access_point)
        return self.cells.union(self.visible[row].any(axis=0))

    def start(self, access_point: ArrayLike, rssi_dbm: ArrayLike, threshold_dbm: float = STRONG_DBM) -> WlanStart:
        """Intersects the visible regions of the strong access points of one scan.

        R_prior = R_1 n ... n R_j, eq. 19. Where nothing is left, the weakest are dropped until something is (claim
        W13); of two as strong the larger identifier goes first. Without any strong access point, or none that the
        survey knows, the region is the whole building.

        Args:
            access_point: (n,), as in the `wifi` stream; of several readings of one the strongest counts.
            rssi_dbm: (n,).
            threshold_dbm: Strong is what is above it.
        """
        strong = _strongest_first(np.asarray(access_point), np.asarray(rssi_dbm, dtype=np.float64), threshold_dbm)
        row = np.minimum(np.searchsorted(self.access_point, strong), max(len(self.access_point) - 1, 0))
        known = self.access_point[row] == strong if len(self.access_point) else np.zeros(len(strong), dtype=np.bool_)
        unknown, strong, row = strong[~known], strong[known], row[known]
        if not len(strong):
            whole = np.ones(self.cells.num_cells, dtype=np.bool_)
            return WlanStart(self.cells.union(whole), strong, strong, unknown)
        left = np.logical_and.accumulate(self.visible[row], axis=0)
        num_used = int(left.any(axis=1).sum())
        region = self.cells.union(left[num_used - 1])
        return WlanStart(region, strong[:num_used], strong[num_used:], unknown)


def _strongest_first(access_point: FloatArray, rssi_dbm: FloatArray, threshold_dbm: float) -> IntArray:
    """(k,) access points above the threshold, each once, strongest first; the smaller identifier before its equal."""
    if access_point.ndim != 1 or access_point.shape != rssi_dbm.shape:
        raise RecordingError(f"a scan needs one RSSI per access point; got {access_point.shape} and {rssi_dbm.shape}")
    is_strong = rssi_dbm > threshold_dbm
    identifier = access_point[is_strong].astype(np.int64)
    identifier = identifier[np.lexsort([identifier, -rssi_dbm[is_strong]])]
    _, first = np.unique(identifier, return_index=True)
    ordered: IntArray = identifier[np.sort(first)]
    return ordered
