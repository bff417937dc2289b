from __future__ import annotations

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.errors import RecordingError
from pdrbench.radio import Cells, divide
from pdrbench.recording import RadioMap
from pdrbench_baselines.woodman2008.visibility import VisibilityMap

# Cells of the house: the hall in two halves, the room, the attic.
WEST, EAST, ROOM, ATTIC = (0, 2.5, 1.0), (0, 7.5, 1.0), (0, 13.0, 3.0), (1, 4.0, 3.0)


@pytest.fixture(scope="module")
def cells(house: Building) -> Cells:
    cells = divide(house)
    assert cells.num_cells == 4
    return cells


def survey(*scans: tuple[tuple[float, ...], dict[int, float]], age_s: float = 0.0) -> RadioMap:
    """Scans at (level, x, y) that received access points as strongly as the dict says."""
    counts = [len(scan) for _, scan in scans]
    return RadioMap(
        xy_m=[place[1:] for place, _ in scans],
        level=[int(place[0]) for place, _ in scans],
        walk=np.arange(len(scans)),
        first=np.concatenate([[0], np.cumsum(counts)]),
        access_point=[a for _, scan in scans for a in scan],
        rssi_dbm=[r for _, scan in scans for r in scan.values()],
        age_s=np.full(sum(counts), age_s),
        surveyed=True,
    )


@pytest.fixture(scope="module")
def seen(cells: Cells) -> VisibilityMap:
    """10 is visible in the hall, 20 in its east and the room, 30 in the attic and the hall's west, 40 in the attic."""
    return VisibilityMap.from_radio_map(
        cells,
        survey(
            (WEST, {10: -90.0, 30: -80.0}),
            (EAST, {20: -40.0}),
            (EAST, {10: -50.0}),
            (ROOM, {20: -88.0}),
            (ATTIC, {30: -60.0, 40: -60.0}),
        ),
    )


def where(cells: Cells, *places: tuple[float, ...]) -> float:
    """Area of the cells that hold the places."""
    return float(cells.area_m2()[[int(cells.locate(p[0], [p[1:]])[0]) for p in places]].sum())


def test_one_sighting_suffices_however_weak(seen: VisibilityMap, cells: Cells):
    assert seen.access_point.tolist() == [10, 20, 30, 40]
    assert seen.visible.sum(axis=1).tolist() == [2, 2, 2, 1]
    assert seen.region(10).area_m2 == pytest.approx(where(cells, WEST, EAST))  # eq. 18
    assert seen.region(30).area_m2 == pytest.approx(where(cells, WEST, ATTIC))
    assert len(seen.region(99)) == 0
    assert seen.num_stray == 0


def test_the_prior_is_the_intersection_of_strong_access_points(seen: VisibilityMap, cells: Cells):
    one = seen.start([20], [-60.0]).region
    both = seen.start([20, 10], [-60.0, -70.0]).region
    assert one.area_m2 == pytest.approx(where(cells, EAST, ROOM))
    assert both.area_m2 == pytest.approx(where(cells, EAST))  # eq. 19
    assert both.contains(0, [[7.5, 1.0], [2.5, 1.0]]).tolist() == [True, False]
    # 10 is not above the threshold: it says nothing
    assert seen.start([20, 10], [-60.0, -75.0]).region.area_m2 == pytest.approx(one.area_m2)
    assert seen.start([20, 10], [-60.0, -75.0], threshold_dbm=-80.0).region.area_m2 == pytest.approx(both.area_m2)


def test_the_weakest_is_dropped_until_something_is_left(seen: VisibilityMap, cells: Cells):
    # 40 is visible in the attic only: with 10 or 20 nothing is left.
    start = seen.start([40, 10, 20], [-70.0, -60.0, -50.0])
    assert (start.used.tolist(), start.dropped.tolist()) == ([20, 10], [40])
    assert start.region.area_m2 == pytest.approx(where(cells, EAST))
    start = seen.start([40, 10, 20], [-50.0, -70.0, -60.0])
    assert (start.used.tolist(), start.dropped.tolist()) == ([40], [20, 10])
    # 30 alone would go with 40, but the rule drops from the weak end only
    start = seen.start([40, 20, 30], [-50.0, -60.0, -70.0])
    assert (start.used.tolist(), start.dropped.tolist()) == ([40], [20, 30])
    equal = seen.start([40, 20], [-60.0, -60.0])
    assert (equal.used.tolist(), equal.dropped.tolist()) == ([20], [40])


@pytest.mark.parametrize(
    ("access_point", "rssi_dbm", "unknown"),
    [([], [], []), ([10, 20], [-75.0, -90.0], []), ([77, 5], [-70.0, -40.0], [5, 77])],
    ids=["empty scan", "none strong", "none known"],
)
def test_without_information_all_is_equal(seen: VisibilityMap, house: Building, access_point, rssi_dbm, unknown):
    start = seen.start(access_point, rssi_dbm)
    assert not len(start.used)
    assert start.region.area_m2 == pytest.approx(house.area_m2)
    assert start.unknown.tolist() == unknown


def test_unknown_access_points_are_reported_and_do_not_count(seen: VisibilityMap, cells: Cells):
    start = seen.start([99, 20], [-30.0, -60.0])
    assert len(start.used)
    assert (start.used.tolist(), start.unknown.tolist()) == ([20], [99])
    assert start.region.area_m2 == pytest.approx(where(cells, EAST, ROOM))


def test_scans_in_no_cell_are_counted_and_old_readings_belong_elsewhere(cells: Cells):
    stray = ((0, 2.5, 2.5), {50: -40.0}), ((4, 1.0, 1.0), {60: -40.0}), (WEST, {10: -40.0})  # in the pillar; no level 4
    seen = VisibilityMap.from_radio_map(cells, survey(*stray))
    assert (seen.num_stray, seen.access_point.tolist()) == (2, [10])
    old = VisibilityMap.from_radio_map(cells, survey((WEST, {10: -40.0}), age_s=9.0))
    assert len(old.access_point) == 0
    assert not len(old.start([10], [-40.0]).used)
    assert VisibilityMap.from_radio_map(cells, survey((WEST, {10: -40.0}), age_s=9.0), max_age_s=9.0).visible.sum() == 1


def test_bad_input_is_refused(cells: Cells, seen: VisibilityMap):
    with pytest.raises(RecordingError, match="one RSSI per access point"):
        seen.start([10, 20], [-50.0])
    with pytest.raises(RecordingError, match="one bool for each pair"):
        VisibilityMap(cells, np.array([1]), np.ones((1, 7), dtype=bool))
    with pytest.raises(RecordingError, match="sorted"):
        VisibilityMap(cells, np.array([2, 1]), np.ones((2, 4), dtype=bool))
