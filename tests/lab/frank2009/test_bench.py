from __future__ import annotations

import numpy as np
import pytest

from pdrbench.radio import ScanMatcher, strength
from pdrbench.radio import kernels as radio_kernels
from pdrbench.radio.matching import POWER
from pdrbench.sensors import sensor_spec
from pdrbench_baselines.frank2009.histograms import HistogramTable
from pdrbench_baselines.frank2009.kernels import add_received
from pdrbench_baselines.frank2009.warm import warm_up
from pdrbench_lab.papers.frank2009 import bench as radio

KERNELS = (add_received, radio_kernels.distances, radio_kernels.strongest_readings)


@pytest.mark.parametrize("num_received", [40, 500])
def test_both_sides_find_where_the_scan_was_made(rng: np.random.Generator, num_received: int) -> None:
    """A ratio is of the same work: with fingerprints this different, all have the same nearest."""
    case = radio.draw(rng, 30, num_received, 10)
    from sklearn.neighbors import NearestNeighbors

    found = radio.by_histograms(HistogramTable.from_radio_map(case.survey), case)
    for metric in radio.METRICS:
        search = NearestNeighbors(n_neighbors=1, algorithm="brute", metric=metric).fit(case.means_dbm)
        np.testing.assert_array_equal(found, radio.by_brute_force(search, case.dense_scans()))
    means_dbm = case.means_dbm[found[:, None], case.heard]
    assert np.abs(case.rssi_dbm - means_dbm).mean() == pytest.approx(radio.SPREAD_DB * np.sqrt(2 / np.pi), rel=0.2)


def test_of_rows_of_length_one_the_nearest_is_that_of_the_cosine(rng: np.random.Generator) -> None:
    """So that scikit-learn's fastest way is compared with, not its slow distance of that name."""
    from sklearn.neighbors import NearestNeighbors

    case = radio.draw(rng, 300, 40, 10, 1)  # each access point is heard
    matcher = ScanMatcher(case.survey, sensor_spec("wifi"))
    search = NearestNeighbors(n_neighbors=1, algorithm="brute").fit(radio.directions(matcher.fingerprints))
    scans = radio.directions(strength(case.dense_scans(), POWER))
    np.testing.assert_array_equal(radio.by_cosine(matcher, case), radio.by_brute_force(search, scans))


def test_with_one_scan_a_point_the_distance_is_manhattan(rng: np.random.Generator) -> None:
    """Where access points missing from the fingerprint count as -100 dBm too."""
    from sklearn.metrics import pairwise_distances

    case = radio.draw(rng, 50, 40, 5, 1)
    table = HistogramTable.from_radio_map(case.survey)
    found = [table.distance(*scan, unknown="penalise") for scan in zip(case.heard, case.rssi_dbm, strict=True)]
    everywhere = np.isin(np.arange(radio.NUM_ACCESS_POINTS), table.access_point)
    expected = pairwise_distances(case.dense_scans()[:, everywhere], case.means_dbm[:, everywhere], metric="manhattan")
    np.testing.assert_allclose(found, expected, atol=1e-9)


def test_nothing_is_left_to_compile_after_warming_up(rng: np.random.Generator) -> None:
    warm_up()
    radio_kernels.warm_up()
    known = [len(kernel.signatures) for kernel in KERNELS]
    case = radio.draw(rng, 20, 40, 3)
    table = HistogramTable.from_radio_map(case.survey)
    matcher = ScanMatcher(case.survey, sensor_spec("wifi"))
    for access_point, rssi_dbm in zip(case.heard, case.rssi_dbm, strict=True):
        rows = np.column_stack([access_point, rssi_dbm])  # as a stream has them
        rows.flags.writeable = False
        table.distance(rows[:, 0], rows[:, 1] + 0.25, unknown="penalise")
        table.distance(access_point, rssi_dbm)
        matcher.distance(np.column_stack([rows, rows[:, 0]])[::-1])
    assert [len(kernel.signatures) for kernel in KERNELS] == known


def test_the_radio_bench_has_its_rows() -> None:
    lines: list[str] = []
    rows = {row.name: row for row in radio.run(True, lines.append)}
    assert set(rows) == {
        *(f"{name}_{what}" for name in ("sparse", "dense") for what in (*radio.METRICS, "build", "memory")),
        *(f"fingerprints_{what}" for what in ("cosine", "euclidean", "manhattan", "memory")),
    }
    assert lines
    assert all(row.value > 0 and bool(row.against) == (row.ratio is not None) for row in rows.values())
    assert rows["fingerprints_memory"].value < 14  # 12 and 16 / 30 of one, not the 133 of a dense table
    assert rows["sparse_manhattan"].ratio > 3  # type: ignore[operator]  # ten is asked of 10 000 fingerprints
