from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pdrbench.errors import UnsuitableError
from pdrbench.localizer import Briefing, Observation
from pdrbench.recording import RadioMap
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_baselines.wifi_knn import WifiKnn

PLACES = [[0.0, 0.0], [10.0, 0.0], [20.0, 0.0], [0.0, 30.0]]
STRENGTHS = {1: [-40, -60, -80, -90], 2: [-80, -60, -40, -90], 3: [-90, -90, -90, -40]}


def brief(*, radio_map: bool = True) -> Briefing:
    access_point = np.tile(sorted(STRENGTHS), len(PLACES))
    survey = RadioMap(
        xy_m=PLACES,
        level=[0, 0, 0, 1],
        walk=[0, 0, 0, 1],
        first=[0, 3, 6, 9, 12],
        access_point=access_point,
        rssi_dbm=np.array([STRENGTHS[ap][place] for place in range(4) for ap in sorted(STRENGTHS)], dtype=float),
        age_s=np.zeros(12),
    )
    spec = sensor_spec("wifi")
    return Briefing(None, {"wifi": spec}, 0.2, None, survey if radio_map else None)


def scan(t_s: float, **dbm: float) -> np.ndarray:
    return np.array([[t_s, float(name[2:]), value, 2412.0, 0.0] for name, value in dbm.items()])


def observe(localizer: WifiKnn, rows: np.ndarray, now_s: float = 1.0) -> tuple[list[float], int]:
    estimate = localizer.step(Observation(now_s, {"wifi": rows}))
    return estimate.xy_m.tolist(), estimate.level


def test_a_surveyed_scan_is_found_again(rng: np.random.Generator) -> None:
    localizer = WifiKnn()
    localizer.reset(brief(), rng)
    for place, xy_m in enumerate(PLACES):
        rows = scan(1.0 + place, **{f"ap{ap}": float(dbm[place]) for ap, dbm in STRENGTHS.items()})
        found, level = observe(localizer, rows)
        assert found == pytest.approx(xy_m, abs=1e-3)
        assert level == (1 if place == 3 else 0)


def test_a_walk_on_a_level_without_a_survey_is_declined(rng: np.random.Generator) -> None:
    for level in (0, 1):
        WifiKnn().reset(dataclasses.replace(brief(), start=Start(np.zeros(2), level)), rng)
    with pytest.raises(UnsuitableError, match="radio survey of level 2"):
        WifiKnn().reset(dataclasses.replace(brief(), start=Start(np.zeros(2), 2)), rng)


def test_it_holds_its_answer_without_a_known_access_point_and_the_start_before_a_scan(rng: np.random.Generator) -> None:
    localizer = WifiKnn()
    localizer.reset(brief(), rng)
    before = observe(localizer, scan(1.0, ap1=-40, ap2=-80, ap3=-90))
    assert observe(localizer, scan(2.0, ap99=-30)) == before
    assert observe(localizer, np.zeros((0, 5))) == before
    localizer = WifiKnn()
    localizer.reset(brief(), rng)
    assert observe(localizer, np.zeros((0, 5))) == ([10.0, 0.0], 0)
    localizer.reset(dataclasses.replace(brief(), start=Start(np.array([1.0, 2.0]), 1)), rng)
    assert observe(localizer, np.zeros((0, 5))) == ([1.0, 2.0], 1)


def test_a_scan_in_two_parts_is_one_scan(rng: np.random.Generator) -> None:
    whole, parts = WifiKnn(), WifiKnn()
    for localizer in (whole, parts):
        localizer.reset(brief(), rng)
    rows = scan(1.0, ap1=-60, ap2=-60, ap3=-90)
    observe(parts, rows[:1])
    assert observe(parts, rows[1:]) == observe(whole, rows)
