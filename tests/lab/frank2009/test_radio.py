"""The published figure of UJIIndoorLoc, exactly, and the distance of Frank et al. 2009 on the same scans."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdrbench_lab.papers.frank2009 import radio
from pdrbench_lab.reproduce.reproduction import Numbers
from pdrbench_sim.readers.wifi_fingerprints import FingerprintSet, SurveyRows

N = np.nan


def rows(rssi_dbm: list[list[float]], x_m: list[float], level: list[int], building: list[int]) -> SurveyRows:
    places = np.column_stack([x_m, np.zeros(len(x_m))])
    return SurveyRows(np.array(rssi_dbm), places, np.array(level) * 3.7, np.array(level), np.array(building))


@pytest.fixture
def small() -> FingerprintSet:
    """Two places of two rows each, one row elsewhere; all right, wrong building, wrong level."""
    train = rows(
        [[-50, -70, N], [-54, N, N], [N, -50, -80], [N, -52, -84], [-104, N, -60]],
        [0.0, 0.0, 10.0, 10.0, 10.0],
        [0, 0, 1, 1, 1],
        [0, 0, 0, 0, 1],
    )
    test = rows([[-51, -71, N], [N, -51, -81], [N, -52, -82]], [1.0, 10.0, 13.0], [0, 1, 2], [0, 1, 0])
    return FingerprintSet(train, test, 0.5)


def test_scores_count_hits_in_both_units(small: FingerprintSet) -> None:
    found = radio.scored("it", small, radio.nearest(small))
    assert found == pytest.approx({"it_hit_share": 1 / 3, "it_hit_m": 1.0, "it_hit_mercator_m": 2.0, "it_all_m": 4 / 3})


@pytest.mark.parametrize(("weakest_dbm", "row"), [(-100.0, 0), (-104.0, 1)])
def test_nearest_takes_missing_access_points_at_the_weakest_training_value(weakest_dbm: float, row: int) -> None:
    """Squares by hand: 36 + 1 or 36 + 25 to the first row, 42.25 + 1 to the second."""
    train = rows([[-50, N], [-62.5, -98], [weakest_dbm, N]], [0.0, 1.0, 2.0], [0, 0, 0], [0, 0, 0])
    test = rows([[-56, -99]], [0.0], [0], [0])
    assert radio.nearest(FingerprintSet(train, test, 1.0)).tolist() == [row]


def test_rows_of_a_place_make_one_fingerprint_and_buildings_stay_apart(small: FingerprintSet) -> None:
    table = radio.histograms(small.train, pooled=True, count_unheard=False)
    assert table.xy_m[:, 0].tolist() == [0, 2, 4]
    assert radio.histogram(table, 0, 1)[0].tolist() == [-70]
    counted = radio.histograms(small.train, pooled=True, count_unheard=True)
    rssi_dbm, probability = radio.histogram(counted, 0, 1)
    assert (rssi_dbm.tolist(), probability.tolist()) == ([-100, -70], [0.5, 0.5])
    assert len(radio.histograms(small.train, pooled=False, count_unheard=False)) == 5


def test_a_scan_of_unknown_access_points_is_answered_all_the_same(small: FingerprintSet) -> None:
    table = radio.histograms(rows([[-50, N]], [0.0], [0], [0]), pooled=True, count_unheard=False)
    assert radio.matched(table, rows([[N, -50]], [0.0], [0], [0]), "ignore").tolist() == [0]


@pytest.fixture(scope="module")
def measured(data_root: Path) -> Numbers:
    if not (data_root / "wifi_fingerprints").is_dir():
        pytest.skip("no wifi_fingerprints/ in PDRBENCH_DATA")
    return radio.uji(0)


def test_the_published_figure_is_met_exactly(measured: Numbers) -> None:
    assert round(100 * float(measured["nearest_hit_share"]), 2) == 89.92
    assert round(float(measured["nearest_hit_mercator_m"]), 2) == 7.90
    for claim in radio.UJI_CLAIMS:
        value = claim.value([measured]).ours
        assert np.isfinite(value)
        assert claim.gate is None or claim.gate.holds(value)


def test_the_distance_on_a_large_survey(measured: Numbers) -> None:
    """As written it fails where fingerprints hold different access points; each option mends a part of it."""
    hit = {name: float(measured[f"{name}_hit_share"]) for name in ("scan_ignore", "scan_penalise", "knn")}
    hit |= {name: float(measured[f"{name}_hit_share"]) for name in ("place_penalise", "counted_penalise")}
    assert hit["scan_ignore"] < 0.1
    assert hit["scan_penalise"] == pytest.approx(0.892, abs=0.005)
    assert hit["place_penalise"] < hit["counted_penalise"] - 0.1
    assert hit["knn"] == pytest.approx(0.945, abs=0.005)
