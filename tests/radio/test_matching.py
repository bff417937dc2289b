from __future__ import annotations

import tracemalloc

import numpy as np
import pytest

from pdrbench.geometry import FloatArray
from pdrbench.radio import ScanMatcher, strength, survey_of_readings
from pdrbench.radio.kernels import MIN_WEIGHT
from pdrbench.radio.matching import FRESHNESS_PER_S, POWER
from pdrbench.recording import RadioMap
from pdrbench.sensors import sensor_spec

NUM_ACCESS_POINTS = 40


def draw(rng: np.random.Generator, num_scans: int, num_heard: int, num_access_points: int = NUM_ACCESS_POINTS):
    """A survey, and its readings as a dense table."""
    heard = np.argsort(rng.random((num_scans, num_access_points)), axis=1)[:, :num_heard]
    rssi_dbm = rng.uniform(-99.0, -30.0, heard.shape)
    readings = np.column_stack([heard.ravel(), rssi_dbm.ravel(), np.zeros(heard.size)])
    walk = np.zeros(num_scans, dtype=int)
    survey = survey_of_readings(np.zeros((num_scans, 2)), 0, walk, walk + num_heard, readings, surveyed=True)
    dense = np.full((num_scans, num_access_points), -100.0)
    np.put_along_axis(dense, heard, rssi_dbm, axis=1)
    return survey, dense


def matcher_of(survey: RadioMap) -> ScanMatcher:
    return ScanMatcher(survey, sensor_spec("wifi"))


def scan_of(rng: np.random.Generator, ages_s: FloatArray) -> FloatArray:
    access_point = rng.choice(NUM_ACCESS_POINTS + 5, len(ages_s), replace=False)  # five are unknown
    return np.column_stack([access_point, rng.uniform(-99.0, -30.0, len(ages_s)), ages_s])


def dense_distance(dense: FloatArray, scan: FloatArray, is_ochiai: bool) -> FloatArray:
    """The readable twin: every fingerprint and every access point."""
    scan = scan[scan[:, 0] < NUM_ACCESS_POINTS]
    strengths, weight = np.zeros(NUM_ACCESS_POINTS), np.ones(NUM_ACCESS_POINTS)
    strengths[scan[:, 0].astype(int)] = strength(scan[:, 1], POWER)
    weight[scan[:, 0].astype(int)] = FRESHNESS_PER_S ** scan[:, 2]
    fingerprints = strength(dense, POWER)
    power = 1 if is_ochiai else 2
    norms = np.sqrt(fingerprints**power @ weight * (weight @ strengths**power))
    both = np.minimum(fingerprints, strengths) if is_ochiai else fingerprints * strengths
    return 1.0 - np.divide(both @ weight, norms, out=np.zeros(len(norms)), where=norms > 0)


def test_two_access_points_in_closed_form() -> None:
    """(3, 4) and (4, 3) have the cosine 0.96; nothing shared is 1, a factor changes nothing."""
    readings = np.array([[7, -97, 0], [9, -96, 0], [7, -94, 0], [9, -92, 0], [8, -50, 0]])
    survey = survey_of_readings(np.zeros((4, 2)), 0, [0, 0, 0, 0], [2, 2, 1, 0], readings, surveyed=True)
    matcher = ScanMatcher(survey, sensor_spec("wifi"), power=1.0)
    found = matcher.distance(np.array([[7.0, -96.0, 0.0], [9.0, -97.0, 0.0]]))
    np.testing.assert_allclose(found, [0.04, 0.04, 1.0, 1.0], atol=1e-15)
    np.testing.assert_allclose(matcher.between(np.array([0, 2, 3])), [[0, 0, 1, 1], [1, 1, 0, 1], [1] * 4], atol=1e-15)


@pytest.mark.parametrize("is_ochiai", [False, True])
@pytest.mark.parametrize("oldest_s", [0.0, 10.0, 300.0])
def test_lists_give_what_the_dense_table_gives(rng: np.random.Generator, oldest_s: float, is_ochiai: bool) -> None:
    survey, dense = draw(rng, 60, 9)
    matcher = ScanMatcher(survey, sensor_spec("wifi"), is_ochiai=is_ochiai)
    assert (FRESHNESS_PER_S**300.0 < MIN_WEIGHT) and (FRESHNESS_PER_S**10.0 > MIN_WEIGHT)
    for _ in range(20):
        scan = scan_of(rng, rng.uniform(0.0, oldest_s, 12))
        np.testing.assert_allclose(matcher.distance(scan), dense_distance(dense, scan, is_ochiai), rtol=0, atol=1e-12)


def test_a_scan_of_old_readings_alone_is_compared_exactly(rng: np.random.Generator) -> None:
    """Its fingerprint has nothing else: the sum of all squares less those that count for little is only rounding."""
    survey, dense = draw(rng, 5, 6)
    heard = np.flatnonzero(dense[3] > -100.0)
    scan = np.column_stack([heard, dense[3, heard], np.full(len(heard), 200.0)])
    assert matcher_of(survey).distance(scan)[3] == pytest.approx(0.0, abs=1e-12)  # type: ignore[index]


def test_without_ages_it_is_the_cosine_distance_of_scikit_learn(rng: np.random.Generator) -> None:
    from sklearn.metrics.pairwise import cosine_distances

    survey, dense = draw(rng, 50, 12)
    strengths, matcher = strength(dense, POWER), matcher_of(survey)
    np.testing.assert_allclose(matcher.between(np.arange(50)), cosine_distances(strengths), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(matcher.fingerprints, strengths)


def test_the_order_of_readings_changes_no_bit(rng: np.random.Generator) -> None:
    survey, _ = draw(rng, 30, 9)
    scan = scan_of(rng, rng.uniform(0.0, 5.0, 20))
    expected = matcher_of(survey).distance(scan)
    for _ in range(5):
        np.testing.assert_array_equal(matcher_of(survey).distance(rng.permutation(scan)), expected)


def test_the_strongest_of_two_readings_counts_with_its_age(rng: np.random.Generator) -> None:
    survey, _ = draw(rng, 30, 9)
    scan = scan_of(rng, np.full(8, 1.0))
    weaker = scan + np.array([0.0, -5.0, 7.0])
    matcher = matcher_of(survey)
    for both in (np.concatenate([scan, weaker]), np.concatenate([weaker, scan])):
        np.testing.assert_array_equal(matcher.distance(both), matcher.distance(scan))


def test_a_scan_of_unknown_access_points_has_no_distance(rng: np.random.Generator) -> None:
    survey, _ = draw(rng, 3, 2)
    assert matcher_of(survey).distance(np.array([[1e6, -50.0, 0.0]])) is None
    assert matcher_of(survey).distance(np.zeros((0, 3))) is None


def test_memory_is_in_proportion_to_what_was_heard(rng: np.random.Generator) -> None:
    """A survey of a mall: a dense table of its strengths and one of their squares have 210 MB each."""
    num_scans, num_heard, num_access_points = 7_000, 30, 3_750
    heard = rng.integers(num_access_points, size=(num_scans, num_heard))
    readings = np.column_stack([heard.ravel(), rng.uniform(-95.0, -40.0, heard.size), np.zeros(heard.size)])
    walk = np.zeros(num_scans, dtype=int)
    survey = survey_of_readings(np.zeros((num_scans, 2)), 0, walk, walk + num_heard, readings, surveyed=False)
    matcher_of(draw(rng, 2, 2)[0])  # kernels are loaded
    tracemalloc.start()
    matcher = matcher_of(survey)
    matcher.distance(readings[:num_heard])
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert matcher.nbytes < 14 * len(readings) + 8 * (num_access_points + num_scans) * 2
    assert peak < 100 * len(readings)
