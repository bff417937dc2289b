"""Competition scores, held against the published ones of IPIN 2023 track 3."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from tracks import make_answers, make_reference

from pdrbench.metrics import hold_at, score
from pdrbench.metrics.competition import mean_level_penalised_m, p75_level_penalised_m, penalised_errors_m
from pdrbench.metrics.hold import Held
from pdrbench.metrics.position import percentile, rms
from pdrbench.trajectory import Estimates, Start, Trajectory

# The errors and scores of the organisers' report on two sample entries (Torres-Sospedra et al. 2023,
# doi 10.5281/zenodo.8362205), in metres at the 69 surveyed positions, level penalty included.
# fmt: off
PUBLISHED_ERRORS_M = {
    "S323ZENODOTS01": [
        5.347, 14.971, 2.824, 1.190, 2.791, 1.925, 2.125, 2.101, 7.510, 9.482, 7.492, 4.816, 3.608, 10.005,
        9.722, 3.803, 0.323, 4.235, 4.899, 2.773, 5.618, 3.705, 3.532, 4.290, 4.415, 2.202, 6.478, 3.628,
        6.353, 5.946, 3.251, 9.058, 2.235, 7.436, 5.283, 5.758, 5.583, 19.582, 18.563, 3.373, 1.024, 2.878,
        2.559, 1.779, 2.366, 1.962, 2.833, 2.640, 0.962, 2.831, 3.811, 4.989, 3.976, 5.649, 4.188, 16.319,
        16.759, 8.825, 2.139, 2.234, 3.210, 2.671, 0.848, 3.920, 0.923, 2.150, 3.712, 5.751, 3.834,
    ],
    "S323ZENODOTZ01": [
        3.981, 15.301, 2.446, 1.208, 2.863, 2.621, 2.153, 1.822, 6.502, 9.481, 7.076, 4.027, 2.913, 8.314,
        9.033, 4.213, 1.151, 4.073, 4.854, 3.377, 6.552, 4.549, 4.516, 4.637, 4.339, 1.858, 6.853, 4.189,
        6.471, 6.091, 2.651, 8.438, 2.504, 8.483, 4.909, 5.210, 5.617, 19.916, 17.936, 3.541, 1.362, 2.761,
        3.729, 2.825, 3.512, 2.742, 2.535, 2.892, 1.137, 3.103, 4.525, 5.706, 5.186, 6.363, 4.703, 0.915,
        2.020, 10.315, 2.436, 2.417, 2.026, 2.652, 1.102, 4.257, 1.281, 2.421, 3.264, 6.815, 4.170,
    ],
}
# fmt: on
PUBLISHED_M = {
    "S323ZENODOTS01": {"p75": 5.75, "mean": 5.01, "rms": 6.47, "p50": 3.80, "p90": 9.63, "p95": 16.34, "plain": 4.14},
    "S323ZENODOTZ01": {"p75": 5.80, "mean": 4.72, "rms": 5.90, "p50": 4.03, "p90": 8.46, "p95": 10.56, "plain": 4.29},
}
PUBLISHED_HIT_PCT = {"S323ZENODOTS01": 94.20, "S323ZENODOTZ01": 97.10}
ENTRIES = sorted(PUBLISHED_M)
# Scores are printed with two decimals (0.005), and come from errors before their rounding to three (0.0005).
PRINTED_M = 0.0056


@pytest.mark.parametrize("entry", ENTRIES)
def test_published_errors_give_the_published_scores(entry: str) -> None:
    errors, published = np.array(PUBLISHED_ERRORS_M[entry]), PUBLISHED_M[entry]
    assert len(errors) == 69
    for name in ("p50", "p75", "p90", "p95"):
        assert percentile(errors, float(name[1:]) / 100) == pytest.approx(published[name], abs=PRINTED_M), name
    assert errors.mean() == pytest.approx(published["mean"], abs=PRINTED_M)
    assert rms(errors) == pytest.approx(published["rms"], abs=PRINTED_M)


def test_only_hazen_gives_the_published_percentile() -> None:
    errors = np.array(PUBLISHED_ERRORS_M["S323ZENODOTS01"])
    assert percentile(errors, 0.95, "hazen") == pytest.approx(16.34, abs=PRINTED_M)
    assert percentile(errors, 0.95, "linear") == pytest.approx(15.78, abs=PRINTED_M)


def local_metres(longitude_deg: np.ndarray, latitude_deg: np.ndarray, origin_deg: np.ndarray) -> np.ndarray:
    """(T, 2) east and north of an origin on the WGS 84 ellipsoid, flat: good to a millimetre within a building."""
    equator_m, flattening = 6378137.0, 1 / 298.257223563
    eccentricity2 = flattening * (2 - flattening)
    latitude = math.radians(origin_deg[1])
    bend = 1 - eccentricity2 * math.sin(latitude) ** 2
    east_m = np.radians(longitude_deg - origin_deg[0]) * math.cos(latitude) * equator_m / math.sqrt(bend)
    north_m = np.radians(latitude_deg - origin_deg[1]) * equator_m * (1 - eccentricity2) / bend**1.5
    return np.column_stack([east_m, north_m])


def read_entry(folder: Path, entry: str) -> tuple[Estimates, Trajectory]:
    """An entry (time, ..., lon, lat, level) and its reference (time, lon, lat, level, index) in local metres."""
    truth = np.loadtxt(folder / "GT_IPIN2023_T3_ScoringTrial01.csv", delimiter=",")
    rows = np.loadtxt(folder / f"{entry}.est", delimiter=",")
    origin_deg = truth[:, 1:3].mean(axis=0)
    reference = Trajectory(
        t_s=truth[:, 0],
        xy_m=local_metres(truth[:, 1], truth[:, 2], origin_deg),
        level=truth[:, 3],
        surveyed=np.ones(len(truth), bool),
    )
    unclaimed = np.full(len(rows), math.nan)
    xy_m = local_metres(rows[:, 4], rows[:, 5], origin_deg)
    return Estimates(rows[:, 0], xy_m, rows[:, 6], unclaimed, unclaimed, unclaimed), reference


@pytest.mark.data
@pytest.mark.parametrize("entry", ENTRIES)
def test_sample_entries_score_as_published(data_root: Path, entry: str) -> None:
    folder = data_root / "ipin2023_track3" / "evaluation"
    if not folder.is_dir():
        pytest.skip(f"no {folder.name} of ipin2023_track3 among the recorded data")
    estimates, reference = read_entry(folder, entry)
    start = Start(xy_m=reference.xy_m[0], level=0)
    held = hold_at(estimates, reference.t_s, start)
    # error by error, level penalty included; printed to a millimetre
    assert penalised_errors_m(held, reference) == pytest.approx(PUBLISHED_ERRORS_M[entry], abs=0.001)
    scores, published = score(estimates, reference, None, start), PUBLISHED_M[entry]
    assert scores["p75_level_penalised_m"] == pytest.approx(published["p75"], abs=0.005)
    assert scores["mean_level_penalised_m"] == pytest.approx(published["mean"], abs=0.005)
    assert scores["mean_m"] == pytest.approx(published["plain"], abs=0.005)
    assert 100 * scores["level_hit_rate"] == pytest.approx(PUBLISHED_HIT_PCT[entry], abs=0.005)
    assert scores["n"] == 69


def one_level_off(count: int, wrong: int) -> tuple[Held, Trajectory]:
    """A walk with an error of 2 m everywhere and `wrong` rows two levels off."""
    reference = make_reference(np.zeros((count, 2)))
    estimates = make_answers(reference.t_s, [0.0, 2.0], np.where(np.arange(count) < wrong, -2.0, 0.0))
    return hold_at(estimates, reference.t_s, Start(xy_m=np.zeros(2), level=0)), reference


def test_levels_of_difference_cost_fifteen_metres_and_the_wrong_building_fifty() -> None:
    held, reference = one_level_off(4, 1)
    assert penalised_errors_m(held, reference).tolist() == [32.0, 2.0, 2.0, 2.0]
    assert mean_level_penalised_m(held, reference) == 9.5
    assert mean_level_penalised_m(held, reference, per_level_m=4.0, per_building_m=50.0) == 4.0
    assert p75_level_penalised_m(held, reference) == 17.0  # Hazen: halfway between the third and the fourth
    held, reference = one_level_off(4, 0)
    wrong = np.array([True, False, False, False])
    assert penalised_errors_m(held, reference, wrong_building=wrong).tolist() == [52.0, 2.0, 2.0, 2.0]
    assert mean_level_penalised_m(held, reference, wrong_building=wrong) == 2.0  # Kaggle scores one building
    assert mean_level_penalised_m(held, reference, per_building_m=50.0, wrong_building=wrong) == 14.5
