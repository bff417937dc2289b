"""The radio map that extrapolates, on surveys whose field is known."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Observation
from pdrbench.radio import survey_of_readings
from pdrbench.recording import RadioMap
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_baselines.gp_wifi.field import SignalFieldParams, SignalMap
from pdrbench_baselines.gp_wifi.localizer import GpWifi, GpWifiParams
from pdrbench_baselines.gp_wifi.sightings import Sweeps, scan_times_s, sightings_of

PLACES = np.array([[5.0, 4.0], [35.0, 4.0], [5.0, 26.0], [35.0, 26.0], [20.0, 15.0]])  # of access points
HEARD_DBM = -88.0


def strength_dbm(xy_m: FloatArray) -> FloatArray:
    """(N, A) by the path loss that the prior expects: exponent 2.5, -38 dBm at 1 m."""
    away_m2 = ((xy_m[:, None, :] - PLACES[None]) ** 2).sum(axis=2) + 4.0
    return np.asarray(-38.0 - 12.5 * np.log10(away_m2))


def survey(
    rng: np.random.Generator, xy_m: FloatArray, levels: tuple[int, ...] = (0,), noise_db: float = 2.0
) -> RadioMap:
    """A survey of scans that lasted no time, the levels alike but for 25 dB; access points are those of their level."""
    readings, counts = [], []
    for home in levels:
        for level in levels:
            dbm = strength_dbm(xy_m) - 25.0 * (level != home) + noise_db * rng.standard_normal((len(xy_m), len(PLACES)))
            readings.append(np.where(dbm > HEARD_DBM, dbm, np.nan))
    size = len(levels)
    rows = []
    for number in range(size):
        dbm = np.concatenate([readings[home * size + number] for home in range(size)], axis=1)
        for heard in dbm:
            known = np.flatnonzero(~np.isnan(heard))
            rows.append(np.column_stack([known + 1.0, heard[known], np.zeros(len(known))]))
            counts.append(len(known))
    walk = np.repeat(np.arange(size), len(xy_m))
    places_m = np.tile(xy_m, (size, 1))
    return survey_of_readings(places_m, np.repeat(levels, len(xy_m)), walk, counts, np.concatenate(rows), surveyed=True)


def lines_of(*y_m: float) -> FloatArray:
    return np.array([[x, y] for y in y_m for x in np.arange(1.0, 40.0, 1.5)])


def brief(radio_map: RadioMap | None, start: Start | None = None) -> Briefing:
    return Briefing(None, {"wifi": sensor_spec("wifi")}, 0.2, start, radio_map)


def scan(t_s: float, dbm: FloatArray, first: int = 1) -> FloatArray:
    heard = np.flatnonzero(dbm > HEARD_DBM)
    return np.array([[t_s, first + k, dbm[k], 2412.0, 0.1] for k in heard])


def test_repeats_are_left_out_and_sightings_placed_by_their_age() -> None:
    """Two scans, 2 s and 4 m apart; the second repeats five readings of the first and has one of half a second ago."""
    first = [[ap, -50.0 - ap, 0.3] for ap in range(1, 6)]
    second = [[ap, dbm, age + 2.0] for ap, dbm, age in first] + [[9.0, -60.0, 0.5]]
    radio_map = survey_of_readings(
        [[0.0, 0.0], [4.0, 0.0]], 0, [7, 7], [5, 6], np.array(first + second), surveyed=False
    )
    np.testing.assert_allclose(scan_times_s(radio_map), [np.nan, 2.0])
    found = sightings_of(radio_map)
    assert found.access_point.tolist() == [1, 2, 3, 4, 5, 9]
    np.testing.assert_allclose(found.xy_m[-1], [3.0, 0.0])
    np.testing.assert_allclose(found.scan_xy_m, [[0.0, 0.0], [2.0, 0.0]])


def test_a_scan_hands_out_what_the_one_before_did_not() -> None:
    rows = np.array(
        [[1.0, 1, -50, 2412, 9.0], [1.0, 2, -50, 2412, 0.4], [3.0, 2, -50, 2412, 2.4], [3.0, 1, -55, 2412, 1.9]]
    )
    (one,), (two,) = (list(sweeps.update(part)) for sweeps in [Sweeps()] for part in (rows[:2], rows[2:]))
    assert (one[0], one[1][:, 1].tolist()) == (1.0, [2.0])
    assert (two[0], two[1][:, 1].tolist(), two[2]) == (3.0, [1.0], 2.0)


def test_a_field_extrapolates_path_loss_and_says_how_well(rng: np.random.Generator) -> None:
    """Surveyed along two lines 3 m apart, asked up to 20 m away."""
    signals = SignalMap(survey(rng, lines_of(3.0, 6.0)), None, SignalFieldParams())
    z = []
    for k in range(len(PLACES)):
        field = signals.prepare(np.array([k + 1]), 0)[0]
        assert field is not None and len(field.at)
        true_dbm = strength_dbm(signals.xy_m[field.at])[:, k]
        z.append((field.mean_dbm - true_dbm) / np.sqrt(field.variance_db2))
    assert np.abs(np.concatenate(z)).mean() < 1.0  # 0.8 where the law is normal and the truth is of the prior
    x_m, y_m = signals.xy_m.T
    is_near, is_far = (y_m > 2) & (y_m < 7) & (x_m > 3) & (x_m < 37), y_m > 18
    near, far = np.flatnonzero(is_near), np.flatnonzero(is_far)
    (field,) = signals.prepare(np.array([5]), 0)
    assert field is not None
    at = [np.isin(field.at, part) for part in (near, far)]
    assert field.variance_db2[at[0]].mean() < 0.6 * field.variance_db2[at[1]].mean()
    assert signals.prepare(np.array([77]), 0) == [None] and signals.nbytes > 0


def test_where_scans_missed_an_access_point_it_is_weaker() -> None:
    """Received strongly in two cells only; forty scans on one side of them, 6 m away, lack it: the other is as far."""
    heard_m, missed_m = np.array([[0.0, 0.0], [4.0, 0.0]] * 4), np.array([[2.0, 6.0], [5.0, 6.0]] * 20)
    readings = np.array([[1.0, -60.0, 0.0]] * 8)
    radio_map = survey_of_readings(
        np.concatenate([heard_m, missed_m]), 0, np.arange(48), [1] * 8 + [0] * 40, readings, surveyed=True
    )
    ring = np.array([(-10.0, -12.0), (15.0, -12.0), (15.0, 12.0), (-10.0, 12.0)])
    hall = Building("hall", (FloorPolygon("hall", ring, np.full(4, WALL), 0.0, 0),))
    signals = SignalMap(radio_map, hall, SignalFieldParams(covers_floor=True))
    (field,) = signals.prepare(np.array([1]), 0)
    assert field is not None
    missed_dbm, other_dbm = (
        field.mean_dbm[np.hypot(*(signals.xy_m[field.at] - [3.0, y_m]).T) < 3.0].mean() for y_m in (6.0, -6.0)
    )
    assert missed_dbm < other_dbm - 3.0


def test_a_walk_far_from_the_survey_is_found(rng: np.random.Generator) -> None:
    """Surveyed along y = 3 and y = 27; the walk goes along y = 15, twelve metres from the nearest scan."""
    localizer = GpWifi(GpWifiParams(trust=1.0, fingerprint_trust=0.0))  # five that err independently
    localizer.reset(brief(survey(rng, lines_of(3.0, 27.0))), rng)
    errors = []
    for k, x_m in enumerate(np.arange(4.0, 36.0, 2.0)):
        place_m = np.array([[x_m, 15.0]])
        dbm = strength_dbm(place_m)[0] + 2.0 * rng.standard_normal(5)
        estimate = localizer.step(Observation(2.0 * k, {"wifi": scan(2.0 * k, dbm)}))
        errors.append(float(np.hypot(*(estimate.xy_m - place_m[0]))))
    assert np.mean(errors[3:]) < 6.0  # a scan of the survey is 12 m away


def test_the_lattice_ends_near_the_survey_or_covers_all_floor_of_a_surveyed_level(rng: np.random.Generator) -> None:
    ring = np.array([(0.0, 0.0), (120.0, 0.0), (120.0, 30.0), (0.0, 30.0)])
    floors = [FloorPolygon(f"hall{level}", ring, np.full(4, WALL), 4.0 * level, level) for level in (0, 1)]
    known = survey(rng, lines_of(4.0))  # to x = 39.5 on level 0
    near, all_floor = (
        SignalMap(known, Building("halls", tuple(floors)), SignalFieldParams(covers_floor=covers))
        for covers in (False, True)
    )
    assert near.xy_m[:, 0].max() < 39.5 + near.params.margin_m + near.params.lattice_m
    assert set(all_floor.level.tolist()) == {0}
    places = len(all_floor.xy_m), 120.0 * 30.0 / 3.0**2
    assert abs(places[0] - places[1]) <= 300.0 / 3.0 / 2  # half of the squares on the edge
    assert len(near.xy_m) < 0.6 * len(all_floor.xy_m)


def test_the_level_is_that_whose_access_points_are_strong(rng: np.random.Generator) -> None:
    radio_map = survey(rng, lines_of(3.0, 15.0, 27.0), levels=(0, 2))
    localizer = GpWifi()
    for level in (0, 2):
        localizer.reset(brief(radio_map), rng)
        dbm = strength_dbm(np.array([[12.0, 10.0]]))[0]
        own, other = (dbm, dbm - 25.0) if level == 0 else (dbm - 25.0, dbm)
        rows = scan(1.0, np.concatenate([own, other]))
        assert localizer.step(Observation(1.0, {"wifi": rows})).level == level


def test_of_two_places_alike_one_is_answered_and_not_the_middle(rng: np.random.Generator) -> None:
    """Two wings 160 m apart receive the same access points alike; a scan fits both, and nobody is in between."""
    wing_m = lines_of(3.0, 15.0, 27.0)
    shifts_m = np.array([0.0, 160.0])
    both_m = np.concatenate([wing_m + np.array([shift_m, 0.0]) for shift_m in shifts_m])
    one = survey(rng, wing_m)
    readings = np.tile(np.column_stack([one.access_point, one.rssi_dbm, one.age_s]), (2, 1))
    counts = np.tile(np.diff(one.first), 2)
    alike = survey_of_readings(both_m, 0, np.zeros(len(both_m), dtype=np.int64), counts, readings, surveyed=True)
    off_m = {}
    for answer_m in (30.0, np.inf):
        localizer = GpWifi(GpWifiParams(answer_m=answer_m))
        localizer.reset(brief(alike), rng)
        estimate = localizer.step(Observation(1.0, {"wifi": scan(1.0, strength_dbm(np.array([[8.0, 6.0]]))[0])}))
        off_m[answer_m] = np.abs(estimate.xy_m[0] - 8.0 - shifts_m).min()
        assert estimate.sigma_m is not None and estimate.sigma_m > 40.0
    assert off_m[30.0] < 20.0 < 50.0 < off_m[np.inf]


def test_a_pause_longer_than_a_way_across_begins_anew(rng: np.random.Generator) -> None:
    known = survey(rng, lines_of(3.0, 15.0, 27.0))
    here, there = (strength_dbm(np.array([[x_m, 15.0]]))[0] for x_m in (4.0, 36.0))
    localizer, fresh = GpWifi(), GpWifi()
    localizer.reset(brief(known), rng)
    fresh.reset(brief(known), rng)
    localizer.step(Observation(1.0, {"wifi": scan(1.0, here)}))
    again = localizer.step(Observation(901.0, {"wifi": scan(901.0, there)}))
    first = fresh.step(Observation(1.0, {"wifi": scan(1.0, there)}))
    np.testing.assert_allclose(again.xy_m, first.xy_m, atol=0.5)


def test_an_offset_of_the_device_is_learned(rng: np.random.Generator) -> None:
    localizer = GpWifi(GpWifiParams(offset_sigma_db=4.0, trust=1.0))
    localizer.reset(brief(survey(rng, lines_of(3.0, 15.0, 27.0))), rng)
    for k in range(8):
        dbm = strength_dbm(np.array([[20.0, 10.0]]))[0] - 6.0
        localizer.step(Observation(2.0 * k, {"wifi": scan(2.0 * k, dbm)}))
    assert -9.0 < float(localizer.debug()["offset_db"]) < -3.0


def test_before_the_first_scan_it_answers_the_start_and_what_it_cannot_use_changes_nothing(
    rng: np.random.Generator,
) -> None:
    localizer, radio_map = GpWifi(), survey(rng, lines_of(3.0))
    start = Start(np.array([3.0, 5.0]), 0)
    localizer.reset(brief(radio_map, start), rng)
    answer = localizer.step(Observation(0.0, {"wifi": np.zeros((0, 5))}))
    assert answer.xy_m.tolist() == [3.0, 5.0]
    answer = localizer.step(Observation(0.2, {"wifi": np.array([[0.2, 99.0, -40.0, 2412.0, 0.1]])}))
    assert np.hypot(*(answer.xy_m - start.xy_m)) < 3.0  # an access point that no one surveyed
    with pytest.raises(UnsuitableError, match="needs a radio map"):
        localizer.reset(brief(None), rng)
    with pytest.raises(UnsuitableError, match="radio survey of level 3"):
        localizer.reset(brief(radio_map, dataclasses.replace(start, level=3)), rng)
