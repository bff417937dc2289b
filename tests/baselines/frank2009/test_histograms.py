from __future__ import annotations

from collections import Counter

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from pdrbench.errors import RecordingError
from pdrbench.radio import UNHEARD_DBM
from pdrbench.recording import RadioMap
from pdrbench_baselines.frank2009.histograms import HistogramTable, best_of_three

Scan = dict[int, float]  # RSSI by access point


def survey_of(places: list[tuple[float, float, int]], scans: list[tuple[int, Scan]], age_s: float = 0.0) -> RadioMap:
    """A survey of scans, each at one of some places."""
    at = [places[place] for place, _ in scans]
    num_readings = [len(scan) for _, scan in scans]
    return RadioMap(
        xy_m=np.array([place[:2] for place in at]).reshape(-1, 2),
        level=[place[2] for place in at],
        walk=np.zeros(len(scans)),
        first=np.concatenate([[0], np.cumsum(num_readings)]).astype(int),
        access_point=[name for _, scan in scans for name in scan],
        rssi_dbm=[rssi for _, scan in scans for rssi in scan.values()],
        age_s=np.full(sum(num_readings), age_s),
    )


def twin(scans: list[Scan], observed: Scan, unknown: str, known: set[int]) -> float:
    """Eq. (1) as it stands, of the scans at one calibration point: a sum over access points and one over bins."""
    distance = 0.0
    for name in known:
        bins = Counter(int(np.floor(scan[name] + 0.5)) for scan in scans if name in scan)
        if not bins and name in observed and unknown == "penalise":
            bins = Counter([int(UNHEARD_DBM)])
        x = observed.get(name, UNHEARD_DBM)
        distance += sum(abs(x - dbm) * count / bins.total() for dbm, count in bins.items())
    return distance


_names = st.integers(1, 6)
_rssi = st.one_of(st.integers(-106, -30).map(float), st.floats(-106.0, -30.0))
_scans = st.dictionaries(_names, _rssi, max_size=5)
_surveys = st.lists(st.tuples(st.integers(0, 4), _scans), min_size=1, max_size=25).filter(
    lambda scans: any(scan for _, scan in scans)
)


@settings(deadline=None)
@given(_surveys, st.dictionaries(st.integers(1, 7), _rssi, max_size=6), st.sampled_from(["ignore", "penalise"]))
def test_distance_is_equation_1(scans: list[tuple[int, Scan]], observed: Scan, unknown: str) -> None:
    places = [(float(place % 2), float(place // 2), place % 3) for place in range(5)]
    table = HistogramTable.from_radio_map(survey_of(places, scans))
    known = {name for _, scan in scans for name in scan}
    names, rssi = list(observed), list(observed.values())
    assert set(np.array(names)[table.known(names)] if names else []) == known & set(observed)
    if not known & set(observed):
        with pytest.raises(RecordingError, match="keep the last estimate"):
            table.distance(names, rssi, unknown=unknown)  # type: ignore[arg-type]
        return
    distance = table.distance(names, rssi, unknown=unknown)  # type: ignore[arg-type]
    at = {place: [scan for where, scan in scans if where == place] for place, _ in scans}
    spoken = [place for place in at if any(at[place])]
    assert table.xy_m.tolist() == [list(places[place][:2]) for place in spoken]
    assert table.level.tolist() == [places[place][2] for place in spoken]
    expected = [twin(at[place], observed, unknown, known) for place in spoken]
    np.testing.assert_allclose(distance, expected, rtol=0, atol=1e-9)


def test_the_strongest_of_duplicates_counts_in_scan_and_survey() -> None:
    survey = RadioMap([[0, 0], [0, 0]], [0, 0], [0, 0], [0, 3, 4], [4, 4, 9, 4], [-80, -60, -70, -62], np.zeros(4))
    table = HistogramTable.from_radio_map(survey)
    assert (table.lowest_dbm[0], table.count.tolist()) == (-62, [1, 0, 1, 1])
    twice, once = table.distance([9, 4, 9], [-75, -61, -70]), table.distance([4, 9], [-61, -70])
    assert twice.tolist() == once.tolist() == [1.0]


def test_old_readings_and_places_without_access_points_are_left_out() -> None:
    survey = RadioMap([[0, 0], [9, 9]], [0, 0], [0, 1], [0, 2, 3], [1, 2, 1], [-50, -60, -70], [0.0, 3.0, 8.0])
    table = HistogramTable.from_radio_map(survey, max_age_s=3.0)
    assert table.xy_m.tolist() == [[0.0, 0.0]]
    assert len(HistogramTable.from_radio_map(survey)) == 2


@pytest.mark.parametrize(
    ("names", "rssi", "message"),
    [
        ([1], [np.nan], "must be numbers"),
        ([np.nan], [-50.0], "must be numbers"),
        ([1], [-np.inf], "must be numbers"),
        ([1, 2], [-50.0], "one RSSI per access point"),
        ([], [], "none of its 0 access points"),
        ([99], [-50.0], "ask known"),
    ],
)
def test_bad_scans_are_refused(names: list[float], rssi: list[float], message: str) -> None:
    table = HistogramTable.from_radio_map(survey_of([(0, 0, 0)], [(0, {1: -50.0})]))
    with pytest.raises(RecordingError, match=message):
        table.distance(names, rssi)


def test_bad_surveys_are_refused() -> None:
    empty = survey_of([], [])
    with pytest.raises(RecordingError, match="no scans; survey the building first"):
        HistogramTable.from_radio_map(empty)
    with pytest.raises(RecordingError, match="raise max_age_s or survey again"):
        HistogramTable.from_radio_map(survey_of([(0, 0, 0)], [(0, {1: -50.0})], age_s=4.0), max_age_s=3.0)
    table = HistogramTable.from_radio_map(survey_of([(0, 0, 0)], [(0, {1: -50.0})]))
    with pytest.raises(ValueError, match="'ignore' or 'penalise'"):
        table.distance([1], [-50.0], unknown="drop")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("nearest", "answers"),
    [
        ([1, 2, 3, 4], [1, 2, 3, 4]),  # none twice: the latest
        ([1, 1, 2, 2], [1, 1, 1, 2]),
        ([1, 2, 1, 3, 3], [1, 2, 1, 3, 3]),
        ([5, 5, 5, 6, 7], [5, 5, 5, 5, 7]),  # what is four scans old no longer counts
    ],
)
def test_best_of_three(nearest: list[int], answers: list[int]) -> None:
    assert [best_of_three(nearest[max(k - 2, 0) : k + 1]) for k in range(len(nearest))] == answers
