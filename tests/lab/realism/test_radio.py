from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from sklearn.metrics.pairwise import cosine_distances

from pdrbench_lab.realism import radio
from pdrbench_lab.realism.radio_statistics import (
    SurveyWalk,
    _fingerprint_distances,
    _mean_error_m,
    _path_loss,
    floor_values,
    survey_of,
    walk_values,
)

SENDERS_M = np.random.default_rng(1).uniform((0.0, 0.0), (60.0, 30.0), (60, 2))


def survey(rng: np.random.Generator, num_walks: int = 24, sigma_db: float = 3.0) -> list[SurveyWalk]:
    """Straight walks past 60 senders at -30 dBm and exponent 3, in white noise, all of them received in every scan."""
    walks = []
    for y_m in rng.uniform(0.0, 30.0, num_walks):
        t_s = np.arange(2.0, 30.0, 2.25)
        xy_m = np.column_stack([2.0 * t_s, np.full(len(t_s), y_m)])
        distance_m = np.maximum(np.linalg.norm(xy_m[:, None] - SENDERS_M, axis=2), 1.0)
        rssi_dbm = -30.0 - 30.0 * np.log10(distance_m) + sigma_db * rng.standard_normal(distance_m.shape)
        scan, sender = np.indices(rssi_dbm.shape).reshape(2, -1)
        rows = np.column_stack([t_s[scan], sender + 1.0, rssi_dbm.ravel(), np.full(len(scan), 2412.0), 0.0 * scan])
        walks.append(SurveyWalk(np.array([0.0, 30.0]), np.array([[0.0, y_m], [60.0, y_m]]), rows))
    return walks


def test_the_fit_finds_exponent_and_noise_of_a_known_field(rng: np.random.Generator):
    xy_m = rng.uniform((0.0, 0.0), (60.0, 30.0), (400, 2))
    distance_m = np.maximum(np.linalg.norm(xy_m[:, None] - SENDERS_M, axis=2), 1.0)
    rssi_dbm = -30.0 - 30.0 * np.log10(distance_m) + 3.0 * rng.standard_normal(distance_m.shape)
    rssi_dbm[rng.random(rssi_dbm.shape) < 0.3] = np.nan
    exponent, sigma_db = _path_loss(rssi_dbm, xy_m)
    assert np.median(exponent) == pytest.approx(3.0, abs=0.2)  # the grid of 4 m flattens what is near
    assert np.median(sigma_db) == pytest.approx(3.0, abs=0.3)


def test_the_variogram_of_white_noise_begins_at_its_sigma_and_rises_with_the_path_loss(rng: np.random.Generator):
    values = floor_values(survey(rng))
    assert values["wifi_variogram_0m"] == pytest.approx(3.0, abs=0.4)
    assert values["wifi_variogram_22m"] > values["wifi_variogram_5m"] > values["wifi_variogram_0m"]
    assert [values[f"wifi_again_{dbm}"] for dbm in (60, 75)] == [1.0, 1.0]  # every scan receives everything


def test_matching_gets_worse_with_fewer_walks_and_with_more_noise(rng: np.random.Generator):
    quiet, loud = floor_values(survey(rng)), floor_values(survey(rng, sigma_db=12.0))
    assert 1.0 < quiet["wifi_knn_half"] < quiet["wifi_knn_quarter"]
    assert loud["wifi_knn_m"] > 1.3 * quiet["wifi_knn_m"]


def test_errors_of_a_subset_are_those_of_its_walks_alone(rng: np.random.Generator):
    walk, xy_m = np.repeat(np.arange(6), 4), rng.uniform(0.0, 50.0, (24, 2))
    distance = rng.uniform(0.1, 1.0, (24, 24))
    part = np.array([0, 2, 5])
    kept = np.isin(walk, part)
    among_all, whole = _mean_error_m(distance, walk, xy_m, [part, np.arange(6)])
    alone = _mean_error_m(distance[np.ix_(kept, kept)], walk[kept], xy_m[kept], [part])[0]
    assert among_all == pytest.approx(alone)
    # by hand: the three nearest scans of the other walks, weighted by the inverse square
    errors = []
    for query in range(24):
        others = np.flatnonzero(walk != walk[query])
        nearest = others[np.argsort(distance[query, others])[:3]]
        found_m = np.average(xy_m[nearest], axis=0, weights=distance[query, nearest] ** -2.0)
        errors.append(np.hypot(*(found_m - xy_m[query])))
    assert whole == pytest.approx(np.mean(errors))


def test_distances_are_those_of_the_registered_localizer(rng: np.random.Generator):
    walks = survey(rng, 3)
    scans = [rows for walk in walks for rows in walk.scans()]
    found = _fingerprint_distances(survey_of(walks), scans)
    strengths = np.zeros((len(scans), len(SENDERS_M)))
    for number, rows in enumerate(scans):
        strengths[number, rows[:, 1].astype(int) - 1] = np.maximum(rows[:, 2] + 100.0, 0.0) ** 2.5
    np.testing.assert_allclose(found[4], cosine_distances(strengths, strengths[4:5])[:, 0], atol=1e-9)


def test_ages_and_entries_are_counted_by_walk():
    rows = np.array([[2.0, 1, -50, 2412, 0.5], [4.5, 1, -50, 2412, 3.0], [4.5, 2, -60, 2412, 1.0]])
    walk = SurveyWalk(np.array([0.0, 5.0]), np.zeros((2, 2)), rows)
    once = SurveyWalk(np.array([0.0, 5.0]), np.zeros((2, 2)), rows[:1])
    values = walk_values([walk, once])
    assert values["wifi_entries"].tolist() == [1.5]
    assert values["wifi_fresh"].tolist() == pytest.approx([2 / 3])
    assert values["wifi_age_median_s"].tolist() == [1.0]
    assert values["wifi_period_s"].tolist() == [2.5]


def test_a_survey_has_the_same_bytes_whenever_it_is_drawn(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(radio, "NUM_WALKS", 5)
    monkeypatch.setattr(radio, "AREA_M2", (8000.0, 9000.0))
    one, same, other = (radio.survey_floor(np.random.default_rng([seed, 0])) for seed in (2, 2, 3))
    assert [walk.wifi.tobytes() for walk in one] == [walk.wifi.tobytes() for walk in same]
    assert [walk.xy_m.tobytes() for walk in one] == [walk.xy_m.tobytes() for walk in same]
    assert [walk.wifi.tobytes() for walk in one] != [walk.wifi.tobytes() for walk in other]


def test_real_walks_are_split_into_fit_and_check(data_root: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setenv("PDRBENCH_DATA", str(data_root))
    fit = radio.real("fit")
    assert len(fit["wifi_entries"]) == 45  # 46 walks, one with a single scan
    assert fit["wifi_knn_m"].tolist() == pytest.approx([8.675], abs=0.01)
    assert fit["wifi_variogram_0m"].tolist() == pytest.approx([4.07], abs=0.05)
