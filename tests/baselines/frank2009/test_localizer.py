from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from sample_buildings import bare_ring

from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing, Observation
from pdrbench.recording import RadioMap
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_baselines.frank2009.localizer import FingerprintingParams, Frank2009, Frank2009Params, WlanFrank2009
from pdrbench_sim.foot.known_walk import walk

PLACES = [[0.0, 0.0], [10.0, 0.0], [20.0, 0.0], [0.0, 30.0]]
STRENGTHS = {1: [-40, -60, -80, -90], 2: [-80, -60, -40, -90], 3: [-90, -90, -90, -40]}
SENSORS = {name: sensor_spec(name) for name in ("accel", "gyro", "mag", "wifi")}


def survey(places: list[list[float]] = PLACES) -> RadioMap:
    return RadioMap(
        xy_m=places,
        level=[0, 0, 0, 1],
        walk=[0, 1, 2, 3],
        first=[0, 3, 6, 9, 12],
        access_point=np.tile(sorted(STRENGTHS), 4),
        rssi_dbm=np.array([STRENGTHS[ap][place] for place in range(4) for ap in sorted(STRENGTHS)], dtype=float),
        age_s=np.zeros(12),
    )


def brief(sensors: tuple[str, ...] = ("wifi",), start: Start | None = None, **changes: object) -> Briefing:
    briefing = Briefing(None, {name: SENSORS[name] for name in sensors}, 0.1, start, survey(), mounting="foot")
    return replace(briefing, **changes)  # type: ignore[arg-type]


def scan(t_s: float, place: int, age_s: float = 0.0) -> FloatArray:
    """The fingerprint of a place."""
    return np.array([[t_s, ap, dbm[place], 2412.0, age_s] for ap, dbm in STRENGTHS.items()], dtype=float)


def answer(localizer: WlanFrank2009, *scans: FloatArray, now_s: float = 1.0) -> list[float]:
    rows = np.concatenate(scans) if scans else np.zeros((0, 5))
    return localizer.step(Observation(now_s, {"wifi": rows})).xy_m.tolist()


@pytest.fixture
def wlan(rng: np.random.Generator) -> WlanFrank2009:
    localizer = WlanFrank2009()
    localizer.reset(brief(), rng)
    return localizer


def test_a_surveyed_scan_is_found_again(rng: np.random.Generator) -> None:
    localizer = WlanFrank2009(FingerprintingParams(votes=False))
    localizer.reset(brief(), rng)
    for place, xy_m in enumerate(PLACES):
        estimate = localizer.step(Observation(1.0 + place, {"wifi": scan(1.0 + place, place)}))
        assert estimate.xy_m.tolist() == xy_m
        assert estimate.level == (1 if place == 3 else 0)


def test_one_scan_that_disagrees_is_outvoted(wlan: WlanFrank2009) -> None:
    """F5."""
    found = [answer(wlan, scan(t_s, place)) for t_s, place in enumerate((0, 0, 2, 1, 1), start=1)]
    assert found == [PLACES[0], PLACES[0], PLACES[0], PLACES[1], PLACES[1]]


def test_before_the_first_scan_it_answers_the_start_or_the_middle(
    wlan: WlanFrank2009, rng: np.random.Generator
) -> None:
    assert answer(wlan) == [10.0, 0.0]  # of the level with most of the survey
    wlan.reset(brief(start=Start(np.array([3.0, 4.0]), 0)), rng)
    assert answer(wlan) == [3.0, 4.0]


def test_keeps_its_answer_without_a_known_access_point(wlan: WlanFrank2009) -> None:
    before = answer(wlan, scan(1.0, 2))
    assert answer(wlan, np.array([[2.0, 99.0, -30.0, 2412.0, 0.0]])) == before == PLACES[2]
    assert answer(wlan, scan(3.0, 0, age_s=20.0)) == before  # no reading of this scan is recent


def test_scans_are_taken_in_the_order_of_their_times(wlan: WlanFrank2009, rng: np.random.Generator) -> None:
    """Within an observation in any order; a duplicate changes nothing; older ones than the last are ignored."""
    shuffled = answer(wlan, scan(3.0, 1), scan(1.0, 0), scan(2.0, 0))
    assert shuffled == PLACES[0]  # 0, 0, 1: outvoted
    assert answer(wlan, scan(3.0, 1), scan(2.5, 1)) == PLACES[0]
    assert answer(wlan, scan(4.0, 1)) == PLACES[1]
    twice = WlanFrank2009()
    twice.reset(brief(), rng)
    assert answer(twice, scan(1.0, 0), scan(1.0, 0), scan(2.0, 1)) == PLACES[1]  # not 0 by two votes


def played(localizer: Frank2009, briefing: Briefing, scans: list[FloatArray], *, strides: int = 25) -> FloatArray:
    """(K, 5) time, x, y, heading, sigma along a straight walk of a foot whose sensor x axis points forward."""
    motion = walk(strides, length_m=1.3)
    localizer.reset(briefing, np.random.default_rng(0))
    wifi = np.concatenate(scans) if scans else np.zeros((0, 5))
    signals = {
        name: np.column_stack([motion.t_s, rows]) for name, rows in (("accel", motion.accel), ("gyro", motion.gyro))
    }
    found = []
    for now_s in np.arange(0.0, motion.t_s[-1], 0.1):
        rows = {
            name: row[(row[:, 0] > now_s - 0.1 + 1e-9) & (row[:, 0] <= now_s + 1e-9)] for name, row in signals.items()
        }
        rows["wifi"] = wifi[(wifi[:, 0] > now_s - 0.1 + 1e-9) & (wifi[:, 0] <= now_s + 1e-9)]
        estimate = localizer.step(Observation(now_s, rows))
        heading_rad, sigma_m = (
            math.nan if value is None else value for value in (estimate.heading_rad, estimate.sigma_m)
        )
        found.append((now_s, *estimate.xy_m.tolist(), heading_rad, sigma_m))
    return np.array(found)


SHOE = ("accel", "gyro", "wifi")
POSE = Start(np.array([1.0, 2.0]), 0, heading_rad=0.5)


def test_without_scans_it_is_dead_reckoning_from_a_given_pose() -> None:
    found = played(Frank2009(), brief(SHOE, POSE), [])
    length_m = 25 * 1.3
    end = POSE.xy_m + length_m * np.array([math.cos(0.5), math.sin(0.5)])
    np.testing.assert_allclose(found[-1, 1:3], end, atol=0.03 * length_m)
    assert found[-1, 3] == pytest.approx(0.5, abs=0.05)
    assert found[-1, 4] > found[0, 4]


def test_the_first_place_is_that_of_the_first_scan_whatever_the_disc() -> None:
    """F12, also where the start is far from any fingerprint: a disc of the building's size carries no information."""
    far = Start(np.array([500.0, -300.0]), 0, radius_m=1000.0)
    found = played(Frank2009(), brief(SHOE, far), [scan(0.55, 1)], strides=2)
    assert found[3, 1:3].tolist() == [500.0, -300.0]
    np.testing.assert_allclose(found[7, 1:3], PLACES[1])
    assert found[7, 4] == pytest.approx(3.0)


def test_a_given_start_far_from_any_fingerprint_is_corrected_by_scans() -> None:
    start = Start(np.array([60.0, 0.0]), 0, heading_rad=0.0)
    found = played(Frank2009(), brief(SHOE, start), [scan(1.0 + k, 1) for k in range(24)])
    alone = played(Frank2009(), brief(SHOE, start), [])
    # Gain of each scan at least P / (P + R) = 0.25 / 9.25 for a given place, and more as steps add noise.
    assert abs(found[-1, 1] - 10.0) < 0.7 * abs(alone[-1, 1] - 10.0)


def test_wlan_corrects_the_steps_and_one_far_place_moves_the_robust_filter_less() -> None:
    scans = [scan(1.0 + k, 0) for k in range(4)]
    moved = []
    for params in (Frank2009Params(), Frank2009Params(degrees=3.0)):
        before = played(Frank2009(params), brief(SHOE, replace(POSE, xy_m=np.zeros(2))), scans, strides=8)
        single = Frank2009(replace(params, wlan=FingerprintingParams(votes=False)))
        after = played(single, brief(SHOE, replace(POSE, xy_m=np.zeros(2))), [*scans, scan(5.0, 3)], strides=8)
        moved.append(np.hypot(*(after[-1, 1:3] - before[-1, 1:3])))
    assert moved[0] > 0.3
    assert moved[1] < 0.5 * moved[0]


def test_no_answer_depends_on_a_map() -> None:
    """F14."""
    scans = [scan(1.0 + k, k % 3) for k in range(10)]
    one, other = (
        played(Frank2009(), brief(SHOE, POSE, building=plan), scans, strides=10) for plan in (None, bare_ring())
    )
    np.testing.assert_array_equal(one, other)
