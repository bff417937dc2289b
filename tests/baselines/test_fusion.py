"""Clouds over a radio map whose field is known."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Estimate, Observation
from pdrbench.radio import survey_of_readings
from pdrbench.recording import RadioMap
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_baselines.backward import BackwardSampler, StoredCloud, mean_of
from pdrbench_baselines.foot_ins.localizer import FootInsRobust
from pdrbench_baselines.fusion.cloud import Cloud
from pdrbench_baselines.fusion.localizer import Fusion
from pdrbench_baselines.fusion.lost import LostParams, ScanBelief
from pdrbench_baselines.fusion.middle import geometric_median
from pdrbench_baselines.fusion.open_space import open_space
from pdrbench_baselines.fusion.radio import MIN_LOG, RadioEvidence, fraction_off_survey
from pdrbench_baselines.gp_wifi.field import SignalMap
from pdrbench_baselines.gp_wifi.fingerprints import FingerprintEvidence, FingerprintParams
from pdrbench_baselines.gp_wifi.localizer import GpWifiParams
from pdrbench_baselines.gp_wifi.scan_places import ScanPlaces
from pdrbench_baselines.learned.map_filter import LearnedMapFilterParams
from pdrbench_baselines.learned.reckoning import Move
from pdrbench_sim.foot.known_walk import walk

RING = np.array([(0.0, 0.0), (30.0, 0.0), (30.0, 20.0), (0.0, 20.0)])
PLACES = np.array([[2.0, 2.0], [28.0, 2.0], [2.0, 18.0], [28.0, 18.0], [15.0, 10.0]])  # of access points, on each level
THROUGH_FLOOR_DB = 20.0
LEVELS = (0, 1)


FLOORS = tuple(FloorPolygon(f"hall{level}", RING, np.full(4, WALL), 4.0 * level, level) for level in LEVELS)
BOTH = Building("halls", FLOORS)  # without stairs
ONE = tuple(Building(floor.id, (floor,)) for floor in FLOORS)  # as of a plan that is walked on level by level


def heard_dbm(xy_m: FloatArray, level: int) -> FloatArray:
    """(N, 10) of the access points of both levels."""
    away_m2 = ((xy_m[:, None, :] - PLACES[None]) ** 2).sum(axis=2) + 4.0
    own = -38.0 - 12.5 * np.log10(away_m2)
    return np.concatenate([own - THROUGH_FLOOR_DB * (level != home) for home in LEVELS], axis=1)


def sweep(xy_m: tuple[float, float], level: int, t_s: float, offset_db: float = 0.0) -> FloatArray:
    dbm = heard_dbm(np.array([xy_m]), level)[0] + offset_db
    known = np.flatnonzero(dbm > -88.0)
    rest = np.zeros(len(known))
    return np.column_stack([rest + t_s, known + 1.0, dbm[known], rest, rest])


@pytest.fixture(scope="module")
def radio() -> RadioEvidence:
    rng = np.random.default_rng(4)
    xy_m = np.array([[x, y] for y in (4.0, 10.0, 16.0) for x in np.arange(1.0, 30.0, 2.0)])
    rows, counts = [], []
    for level in LEVELS:
        for dbm in heard_dbm(xy_m, level) + 2.0 * rng.standard_normal((len(xy_m), 10)):
            known = np.flatnonzero(dbm > -88.0)
            rows.append(np.column_stack([known + 1.0, dbm[known], np.zeros(len(known))]))
            counts.append(len(known))
    level = np.repeat(LEVELS, len(xy_m))
    survey = survey_of_readings(np.tile(xy_m, (2, 1)), level, level, counts, np.concatenate(rows), surveyed=True)
    return RadioEvidence(survey, BOTH, GpWifiParams(), 2.0)


def clouds(radio: RadioEvidence, first: FloatArray) -> list[Cloud]:
    params = LearnedMapFilterParams(num_particles=3000)
    made = [Cloud(ONE[level], np.random.default_rng(level), params, level, radio) for level in LEVELS]
    for cloud in made:
        cloud.begin_over(first)
    return made


def test_likelihoods_are_spread_by_the_error_of_the_map_and_no_further(radio: RadioEvidence) -> None:
    one = np.full((len(radio.xy_m), len(radio.prior)), -np.inf)
    middle = int(np.argmin(((radio.xy_m - (15.0, 10.0)) ** 2).sum(axis=1) + 99.0 * radio.level))
    one[middle] = 0.0
    spread = np.exp(radio._spread(one)[:, 0])
    away_m2 = ((radio.xy_m - radio.xy_m[middle]) ** 2).sum(axis=1)
    assert (spread[radio.level == 1] < 1e-9).all()
    beside = (radio.level == 0) & (away_m2 < 5.0**2)
    np.testing.assert_allclose(spread[beside], np.exp(-0.5 * away_m2[beside] / 2.0**2), atol=0.15)


def test_scans_find_level_and_place_of_a_walker_whose_start_is_not_known(radio: RadioEvidence) -> None:
    """A walk along the upper hall, 1 m a second: the cloud there is likelier, and ends near the walker."""
    radio.begin(1.0)
    found: list[Cloud] = []
    for second in range(21):
        place_m = (4.0 + second, 13.0)
        for likelihood in radio.update(sweep(place_m, 1, float(second))) if second % 4 == 0 else ():
            if not found:
                found = clouds(radio, likelihood)
            else:
                for cloud in found:
                    cloud.weigh_by(likelihood, 0.003)
        for cloud in found:
            cloud.move(np.array([1.0, 0.0]), 0.1**2 * np.eye(2))
    lower, upper = found
    assert upper.log_evidence > lower.log_evidence + 1.0
    assert upper.level == 1 and np.hypot(*(upper.xy_m - (25.0, 13.0))) < 4.0 and upper.sigma_m < 6.0


def test_on_a_map_of_all_levels_one_cloud_finds_the_level(radio: RadioEvidence) -> None:
    radio.begin(1.0)
    cloud = Cloud(BOTH, np.random.default_rng(0), LearnedMapFilterParams(num_particles=3000), 0, radio)
    assert cloud.levels == {0, 1}
    for second in range(0, 40, 4):
        for likelihood in radio.update(sweep((8.0, 14.0), 1, float(second))):
            if second:
                cloud.weigh_by(likelihood, 0.003)
            else:
                cloud.begin_over(likelihood)
    assert cloud.level == 1 and np.hypot(*(cloud.xy_m - (8.0, 14.0))) < 4.0


def test_the_offset_of_a_device_is_found(radio: RadioEvidence) -> None:
    params = LearnedMapFilterParams(num_particles=3000)
    for offset_db in (-6.0, 6.0):
        radio.begin(3.0)
        cloud = Cloud(BOTH, np.random.default_rng(0), params, 0, radio)
        cloud.begin_near(np.array([15.0, 10.0]))
        for second in range(0, 60, 4):
            for likelihood in radio.update(sweep((15.0, 10.0), 0, float(second), offset_db)):
                cloud.weigh_by(likelihood, 0.0)
        assert np.sign(offset_db) * cloud.mean_offset_db > 1.0


def test_evidence_is_that_of_importance_weights(radio: RadioEvidence) -> None:
    """A scan that says the same of every place adds nothing, one that is e times as unlikely everywhere takes 1."""
    (cloud, _) = clouds(radio, np.zeros((len(radio.xy_m), len(radio.prior))))
    before = cloud.log_evidence
    assert before == pytest.approx(np.log((radio.level == 0).sum()))
    cloud.weigh_by(np.zeros((len(radio.xy_m), len(radio.prior))), 0.0)
    assert cloud.log_evidence == pytest.approx(before)
    above = np.where(radio.level == 0, -1.0, 0.0)[:, None] * np.ones(len(radio.prior))
    cloud.weigh_by(above, 0.0)
    assert cloud.log_evidence == pytest.approx(before - 1.0)


def test_one_who_was_carried_away_is_found_again(radio: RadioEvidence) -> None:
    radio.begin(1.0)
    params = LearnedMapFilterParams(num_particles=3000)
    cloud = Cloud(BOTH, np.random.default_rng(0), params, 0, radio)
    cloud.begin_near(np.array([3.0, 3.0]))
    for second in range(0, 160, 4):
        for likelihood in radio.update(sweep((27.0, 17.0), 0, float(second))):
            cloud.weigh_by(likelihood, 0.003)
    assert np.hypot(*(cloud.xy_m - (27.0, 17.0))) < 5.0


def test_sensor_resetting_finds_again_whom_scans_with_a_floor_would_leave_lost(radio: RadioEvidence) -> None:
    """A scan is 81 times as likely at one place as anywhere else: as many are there as that says."""
    there = np.isclose(np.hypot(*(radio.xy_m - (27.0, 17.0)).T) + 99.0 * radio.level, 0.0, atol=1.2 * radio.lattice_m)
    likelihood = np.where(there, 0.0, -np.log(81.0))[:, None] * np.ones(len(radio.prior))
    near = []
    for resets in (False, True):
        params = LearnedMapFilterParams(num_particles=3000)
        cloud = Cloud(BOTH, np.random.default_rng(0), params, 0, radio)
        cloud.begin_near(np.array([3.0, 3.0]))
        cloud.weigh_by(likelihood, 0.01, resets=resets)
        near.append(float((np.hypot(*(cloud.particles_xy_m - (27.0, 17.0)).T) < 8.0).mean()))
    put = np.exp(likelihood[:, 0]) ** 2
    lost = 0.01 * put.sum() / np.exp(likelihood[:, 0]).sum()
    expected = lost / (lost + 0.99 / 81.0) * put[there].sum() / put.sum()
    assert near[1] == pytest.approx(expected, abs=4 * np.sqrt(expected / 3000)) and near[0] < 0.1 < 0.3 < near[1]


@pytest.mark.parametrize("off_deg", [0.0, 45.0])
def test_whom_walls_keep_where_the_compass_led_is_found_by_scans_alone(radio: RadioEvidence, off_deg: float) -> None:
    """A walk along the hall; the compass is off, and the cloud on the map does not believe that it can be so far."""
    radio.begin(10.0)
    params = LearnedMapFilterParams(num_particles=2000, bias_sigma_rad=0.05)
    cloud = Cloud(ONE[0], np.random.default_rng(0), params, 0, radio)
    start_m = np.array([3.0, 3.0])
    cloud.begin_near(start_m)
    belief = ScanBelief(LostParams(), 0.1, radio, Start(start_m, 0), np.random.default_rng(2))
    move_m = np.array([math.cos(math.radians(off_deg)), math.sin(math.radians(off_deg))])
    for second in range(1, 25):
        cloud.move(move_m, 0.1**2 * np.eye(2))
        for likelihood in radio.update(sweep((3.0 + second, 3.0), 0, float(second))) if second % 2 == 0 else ():
            gain = cloud.weigh_by(likelihood, 0.0)
            belief.weigh_by(likelihood, float(second), cloud.xy_m, 0, gain)
    true_m = np.array([27.0, 3.0])
    if off_deg == 0.0:
        assert belief.lead < 4.0 and np.hypot(*(cloud.xy_m - true_m)) < 2.0
        return
    assert belief.lead > belief.params.lead and np.hypot(*(cloud.xy_m - true_m)) > 8.0
    assert np.hypot(*(belief.draw(1000).xy_m.mean(axis=0) - true_m)) < 6.0
    cloud.take(belief.draw(1000))
    near = np.hypot(*(cloud.particles_xy_m - true_m).T) < 7.0
    assert 0.3 < near.mean() <= 0.5
    (likelihood,) = radio.update(sweep((27.0, 3.0), 0, 40.0))
    cloud.weigh_by(likelihood, 0.0)
    assert np.hypot(*(cloud.xy_m - true_m)) < 6.0


def test_no_place_beside_the_geometric_median_is_nearer_in_the_mean() -> None:
    rng = np.random.default_rng(3)
    xy_m = np.concatenate([rng.standard_normal((60, 2)), rng.normal((30.0, -20.0), 1.0, (20, 2))])
    median_m = geometric_median(xy_m)

    def mean_away_m(place_m: FloatArray) -> float:
        return float(np.hypot(*(xy_m - place_m).T).mean())

    for angle_rad in np.linspace(0.0, 2 * np.pi, 12):
        beside_m = median_m + 0.2 * np.array([np.cos(angle_rad), np.sin(angle_rad)])
        assert mean_away_m(median_m) < mean_away_m(beside_m)
    assert mean_away_m(median_m) < mean_away_m(xy_m.mean(axis=0)) - 1.0


def test_a_scan_far_from_every_fingerprint_says_less() -> None:
    params = FingerprintParams()
    places = ScanPlaces(np.zeros((1, 2)), np.zeros(1, dtype=int), np.ones(1), 2.0, 0.1, 1e4)
    near, far = (params.honest(replace(places, nearest=distance)) for distance in (0.05, 0.5))
    assert near.spread_m < far.spread_m and near.astray < 0.01 < 0.5 < far.astray
    beside = np.array([[1.0, 1.0], [80.0, 0.0]]), np.zeros(2, dtype=int)
    (at_near, off_near), (at_far, off_far) = (np.log(each.density_per_m2(*beside)) for each in (near, far))
    assert at_near - off_near > at_far - off_far + 3.0


def test_fingerprints_of_surveyed_places_sharpen_what_a_scan_says(radio: RadioEvidence) -> None:
    """A scan at a surveyed place: with fingerprints more of the likelihood is within 3 m of it, on its level."""
    within = (((radio.xy_m - (15.0, 10.0)) ** 2).sum(axis=1) < 3.0**2) & (radio.level == 1)

    def fraction() -> float:
        (log_likelihood,) = radio.update(sweep((15.0, 10.0), 1, 0.0))
        likelihood = np.exp(log_likelihood[:, len(radio.prior) // 2])
        return float(likelihood[within].sum() / likelihood.sum())

    radio.begin(1.0)
    without = fraction()
    wifi = sensor_spec("wifi")
    radio.fingerprints = FingerprintEvidence(radio.radio_map, wifi, FingerprintParams(), radio.xy_m, radio.level)
    try:
        radio.begin(1.0, 1.0)
        assert fraction() > without + 0.1
        radio.begin(1.0, 0.0)
        assert fraction() == without
    finally:
        radio.fingerprints = None


def test_one_outlier_of_a_few_lines_does_not_draw_the_revised_past() -> None:
    past = BackwardSampler()
    state = np.zeros((20, 4))
    state[:2, 0] = 40.0
    nothing = np.zeros(20, dtype=int)
    past.follow(StoredCloud(0.0, state, nothing, nothing, np.ones(20)), 0.0)
    past.answered(0.0, Estimate(xy_m=np.zeros(2), level=0, sigma_m=1.0))
    by_mean, by_median = (
        past.revised(np.random.default_rng(0), middle=middle, num_lines=400)[0, 1]
        for middle in (mean_of, geometric_median)
    )
    assert by_mean == pytest.approx(4.0, abs=1.2)  # 400 draws of 40 m in one of ten: 0.6 m
    assert abs(by_median) < 0.3


def test_fields_do_not_depend_on_what_was_asked_for_before(radio: RadioEvidence) -> None:
    params = GpWifiParams().field
    one, other = (SignalMap(radio.radio_map, BOTH, params) for _ in range(2))
    assert one.nbytes == 0
    asked = np.array([7, 2, 4711, 2])
    one.prepare(np.array([3]), 1)
    for part, whole in zip(one.prepare(asked, 1), other.prepare(asked, 1), strict=True):
        assert (part is None) == (whole is None)
        if part is not None and whole is not None:
            np.testing.assert_array_equal(part.at, whole.at)
            np.testing.assert_allclose(part.mean_dbm, whole.mean_dbm, atol=1e-3)
            np.testing.assert_allclose(part.variance_db2, whole.variance_db2, rtol=1e-4)


def test_a_scan_of_new_access_points_is_weighed_strongest_first(radio: RadioEvidence) -> None:
    new, rows = RadioEvidence(radio.radio_map, BOTH, radio.params, 1.0), sweep((15.0, 10.0), 1, 0.0)
    new.begin(1.0, max_work=0.0)
    parts = list(new.update(rows))
    while new.waits:
        parts += new.update(rows[:0])
    best = np.argmax(np.sum(parts, axis=0).sum(axis=1))
    assert 1 < len(parts) <= len(rows) and new.level[best] == 1 and math.dist(new.xy_m[best], (15.0, 10.0)) < 4.0


def test_of_what_is_left_a_scan_says_the_same(radio: RadioEvidence) -> None:
    def second_scan(evidence: RadioEvidence, *levels: int, offset: int | None = None) -> FloatArray:
        evidence.begin(1.0)
        list(evidence.update(sweep((15.0, 10.0), 1, 0.0)))
        evidence.focus(levels, np.array([offset in (None, k) for k in range(5)]))
        (likelihood,) = evidence.update(sweep((18.0, 10.0), 1, 4.0))
        return likelihood

    both, unsurveyed = second_scan(radio, *LEVELS), second_scan(radio, 7)
    np.testing.assert_array_equal(unsurveyed, both)
    upper, here = second_scan(radio, 1, offset=2), radio.level == 1
    np.testing.assert_allclose(upper[here, 2], both[here, 2] - both[here, 2].max())
    upper[here, 2] = MIN_LOG
    assert (upper == MIN_LOG).all()


@pytest.fixture(scope="module")
def corridor() -> RadioMap:
    """A survey along one line of 40 m on two levels, whose places were interpolated."""
    xy_m = np.column_stack([np.arange(0.0, 40.0, 2.0), np.full(20, 10.0)])
    rows, counts = [], []
    for level in LEVELS:
        for dbm in heard_dbm(xy_m, level):
            known = np.flatnonzero(dbm > -88.0)
            rows.append(np.column_stack([known + 1.0, dbm[known], np.zeros(len(known))]))
            counts.append(len(known))
    level = np.repeat(LEVELS, len(xy_m))
    return survey_of_readings(np.tile(xy_m, (2, 1)), level, level, counts, np.concatenate(rows), surveyed=False)


def test_open_space_holds_survey_and_start(corridor: RadioMap) -> None:
    start = Start(np.array([500.0, 0.0]), level=4)
    space = open_space(corridor, start)
    assert space.levels == (0, 1, 4)
    assert space.contains(np.vstack([corridor.xy_m, [start.xy_m]]), 4).all()
    assert open_space(None, start).levels == (4,)


def test_without_a_plan_people_are_likelier_to_walk_where_the_survey_was_walked(corridor: RadioMap) -> None:
    open_radio = RadioEvidence(corridor, None, GpWifiParams(), 2.0)
    beside_m = np.abs(open_radio.xy_m[:, 1] - 10.0)
    inside = (open_radio.xy_m[:, 0] > 0.0) & (open_radio.xy_m[:, 0] < 38.0)
    along, aside = open_radio.walked[inside & (beside_m < 1.5)], open_radio.walked[inside & (beside_m > 8.0)]
    assert along.min() > aside.max() + 0.3 and np.ptp(along) < 0.1  # between scans as at them
    assert not RadioEvidence(corridor, BOTH, GpWifiParams(), 2.0).walked.any()


def test_a_survey_says_how_often_the_next_walker_is_where_nobody_surveyed() -> None:
    along = np.arange(0.5, 60.0, 3.0)

    def survey(*ways: tuple[float, float, float]) -> RadioMap:
        xy_m = np.concatenate([np.column_stack([x_m + dx * along, y_m + (1 - dx) * along]) for x_m, y_m, dx in ways])
        walk, num = np.repeat(np.arange(len(ways)), len(along)), len(xy_m)
        return RadioMap(
            xy_m, np.zeros(num, int), walk, np.zeros(num + 1, int), np.zeros(0, int), np.zeros(0), np.zeros(0)
        )

    assert fraction_off_survey(survey((0, 0, 1), (0, 1, 1))) == 1.0  # the same way twice tells nothing of others
    assert fraction_off_survey(survey((0, 0, 1), (0, 90, 1))) == 1.0
    # two ways of twelve squares from one corner, and two that go on from their middle: of the former 0, 1 and 5 to 11
    # are on or beside another, of the latter 0 to 6
    assert fraction_off_survey(survey((0, 0, 1), (0, 0, 0), (30, 0, 1), (0, 30, 0))) == pytest.approx(1 - (9 + 7) / 24)


def test_scans_in_quick_succession_count_together_as_one(radio: RadioEvidence) -> None:
    """Three scans within two seconds say what one says; those two seconds apart say it each."""

    def said(times_s: tuple[float, ...]) -> float:
        radio.begin(1.0)
        return sum(float(np.ptp(one)) for t in times_s for one in radio.update(sweep((8.0, 14.0), 1, t)))

    first = said((0.0,))
    assert said((0.0, 0.6, 1.2, 1.8)) == pytest.approx(2.0 * first, rel=0.01)
    assert said((0.0, 2.0)) == pytest.approx(2.0 * first, rel=0.01)


def test_without_a_plan_or_a_survey_a_known_start_is_enough() -> None:
    sensors = {name: sensor_spec(name) for name in ("accel", "gyro", "rotation", "wifi")}
    briefing = Briefing(None, sensors, 0.2, start=Start(np.zeros(2), level=2), mounting="hand")
    localizer = Fusion()
    localizer.reset(briefing, np.random.default_rng(0))
    rows = {name: np.zeros((0, len(spec.columns))) for name, spec in sensors.items()}
    estimate = localizer.step(Observation(0.2, rows))
    assert estimate.level == 2 and np.hypot(*estimate.xy_m) < 0.5
    with pytest.raises(UnsuitableError, match="needs a known start, or a radio map"):
        localizer.reset(Briefing(None, sensors, 0.2, start=None, mounting="hand"), np.random.default_rng(0))


@pytest.mark.filterwarnings("ignore:fusion. the plan")
def test_whom_a_plan_does_not_fit_leaves_it() -> None:
    """One starts off the floor; one walks through a wall for twenty seconds; one who walks along the hall stays."""
    sensors = {name: sensor_spec(name) for name in ("accel", "gyro", "rotation")}
    localizer = Fusion()
    for x_m, step_m, was_wrong, is_wrong in (
        (-3.0, 0.5, True, True),
        (27.0, 1.0, False, True),
        (5.0, 1.0, False, False),
    ):
        start = Start(np.array([x_m, 10.0]), level=0)
        localizer.reset(Briefing(ONE[0], sensors, 0.2, start=start, mounting="hand"), np.random.default_rng(0))
        assert bool(localizer.debug()["plan_is_wrong"]) == was_wrong
        for second in range(1, 21):
            localizer._walk(
                Move(float(second), np.array([step_m, 0.0]), 0.01 * np.eye(2), stands=False, is_guess=False)
            )
        assert bool(localizer.debug()["plan_is_wrong"]) == is_wrong
        assert localizer._estimate(20.0).xy_m[0] == pytest.approx(x_m + 20.0 * step_m, abs=3.0)


def shoe_answers(localizer: Fusion | FootInsRobust, building: Building | None, heading_rad: float | None) -> FloatArray:
    """(K, 2) of a shoe that walks 20 strides of 1.3 m along x from (1, 0); the last row is of the revised past."""
    motion = walk(20)
    sensors = {name: replace(sensor_spec(name), rate_hz=200.0) for name in ("accel", "gyro")}
    start = Start(np.array([1.0, 0.0]), 0, heading_rad=heading_rad)
    localizer.reset(Briefing(building, sensors, 0.5, start=start, mounting="foot"), np.random.default_rng(0))
    rows = {name: np.column_stack([motion.t_s, getattr(motion, name)]) for name in ("accel", "gyro")}
    found = []
    for now_s in np.arange(0.5, motion.t_s[-1], 0.5):
        part = {name: one[(one[:, 0] > now_s - 0.5) & (one[:, 0] <= now_s)] for name, one in rows.items()}
        found.append(localizer.step(Observation(float(now_s), part)).xy_m)
    revised = localizer.revise()
    assert revised is not None
    return np.array([*found, revised[-1, 1:3]])


def test_without_a_plan_a_shoe_is_answered_by_its_filter_alone() -> None:
    np.testing.assert_array_equal(
        shoe_answers(Fusion(), None, 0.3), shoe_answers(FootInsRobust(), None, 0.3), strict=True
    )


@pytest.mark.parametrize("heading_rad", [0.0, 0.15, None])
def test_walls_lead_a_shoe_whose_heading_is_off_or_unknown(heading_rad: float | None) -> None:
    """By 0.15 rad the filter alone ends 3.9 m beside the corridor; without a heading its frame is turned at random."""
    corridor = Building(
        "corridor", (FloorPolygon("way", RING[:, :] * [1.0, 0.1] - [0.0, 1.0], np.full(4, WALL), 0.0, 0),)
    )
    found = shoe_answers(Fusion(), corridor, heading_rad)
    assert np.hypot(*(found[-2:] - [27.0, 0.0]).T).max() < 1.0
    assert np.abs(found[:, 1]).max() < 1.0
