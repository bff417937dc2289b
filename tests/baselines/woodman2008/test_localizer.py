from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.errors import PdrbenchError
from pdrbench.filters import FilterError
from pdrbench.geometry import wrap_rad
from pdrbench.localizer import Briefing, Observation
from pdrbench.recording import RadioMap
from pdrbench.registry import make_localizer
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_baselines.woodman2008.drift import DriftParams
from pdrbench_baselines.woodman2008.localizer import Woodman2008, Woodman2008Params
from pdrbench_baselines.woodman2008.params import WoodmanFilterParams

NO_STRIDE, NO_SCAN = np.zeros((0, 4)), np.zeros((0, 5))


def rectangle(x0: float, y0: float, x1: float, y1: float) -> list[list[float]]:
    return [[x0, y0], [x1, y0], [x1, y1], [x0, y1]]


@pytest.fixture(scope="module")
def corridor() -> Building:
    """A corridor of 40 m by 2 m and, behind a door at x = 30, a room of 8 m by 8 m north of it."""
    w = WALL
    outline = [[0, 0], [40, 0], [40, 2], [31, 2], [30, 2], [0, 2]]
    room = [[26, 2], [30, 2], [31, 2], [34, 2], [34, 10], [26, 10]]
    return Building(
        "corridor",
        (
            FloorPolygon("corridor", outline, [w, w, w, 1, w, w], 0.0, 0),
            FloorPolygon("room", room, [w, 0, w, w, w, w], 0.0, 0),
        ),
    )


def brief(building: Building | None, *sensors: str, start: Start | None = None, survey: bool = False) -> Briefing:
    return Briefing(
        building=building,
        sensors={name: sensor_spec(name) for name in sensors},
        period_s=0.2,
        start=start,
        radio_map=_survey() if survey else None,
    )


def _survey() -> RadioMap:
    """Access point 7 was received in the room, 9 in the west of the corridor."""
    return RadioMap(
        xy_m=np.array([[30.0, 6.0], [2.0, 1.0]]),
        level=[0, 0],
        walk=[0, 1],
        first=[0, 1, 2],
        access_point=[7, 9],
        rssi_dbm=[-50.0, -50.0],
        age_s=[0.0, 0.0],
    )


def stride(length_m: float, turn_rad: float = 0.0, height_m: float = 0.0, t_s: float = 1.0) -> Observation:
    return Observation(t_s, {"stride": np.array([[t_s, length_m, height_m, turn_rad]]), "wifi": NO_SCAN})


def scan(*readings: tuple[int, float], t_s: float = 1.0) -> Observation:
    rows = np.array([[t_s, access_point, rssi_dbm, 2412.0, 0.0] for access_point, rssi_dbm in readings])
    return Observation(t_s, {"stride": NO_STRIDE, "wifi": rows})


def begun(building: Building, rng: np.random.Generator, start: Start | None, **options: Any) -> Woodman2008:
    localizer = Woodman2008(Woodman2008Params(**options))
    localizer.reset(brief(building, "stride", start=start), rng)
    return localizer


def at(x_m: float, y_m: float, heading_rad: float | None = 0.0, radius_m: float = 0.0) -> Start:
    return Start(np.array([x_m, y_m]), 0, heading_rad, radius_m)


def test_tracks_a_given_start_through_a_door(corridor: Building, rng: np.random.Generator) -> None:
    localizer = begun(corridor, rng, at(1.0, 1.0))
    xy_m = np.array([1.0, 1.0])
    for turn_rad, length_m in [(0.0, 1.4)] * 21 + [(math.pi / 2, 1.2), (0.0, 1.2), (0.0, 1.2)]:
        estimate = localizer.step(stride(length_m, turn_rad))
        xy_m = xy_m + length_m * np.array([turn_rad == 0 and xy_m[1] == 1, turn_rad > 0 or xy_m[1] > 1])
    assert estimate.converged
    # 24 strides of 0.15 m noise are 0.7 m along the corridor; the door, 1 m wide, leaves 0.3 m of it
    assert estimate.xy_m == pytest.approx(xy_m, abs=0.75)
    assert estimate.heading_rad == pytest.approx(math.pi / 2, abs=math.radians(10))
    assert estimate.sigma_m is not None and 0.05 < estimate.sigma_m < 0.7


def test_converges_from_an_unknown_start_on_the_floor_plan_alone(corridor: Building, rng: np.random.Generator) -> None:
    """28 m straight on, then left for 5 m: a door is there only for a start at x = 2.5 towards the east."""
    localizer = begun(corridor, rng, None)
    estimate = localizer.step(Observation(0.2, {"stride": NO_STRIDE}))
    assert estimate.converged is False
    for turn_rad, length_m in [(0.0, 1.4)] * 20 + [(math.pi / 2, 1.2)] + [(0.0, 1.2)] * 3:
        estimate = localizer.step(stride(length_m, turn_rad))
    assert estimate.converged
    assert estimate.xy_m == pytest.approx([30.5, 5.8], abs=1.0)  # the door is 1 m wide, the corridor 2 m
    assert localizer.debug()["num_clusters"] == 1
    assert localizer.debug()["deaths"] == 0


def test_a_single_cluster_is_accepted_once_it_has_lasted(corridor: Building, rng: np.random.Generator) -> None:
    localizer = begun(corridor, rng, at(1.0, 1.0), steady_strides=5)
    assert localizer.step(stride(1.0)).converged
    walk = [(0.0, 1.4)] * 20 + [(math.pi / 2, 1.2), (0.0, 1.2), (0.0, 1.2)] + [(0.0, 0.1)] * 8
    first = {}
    for steady_strides in (1, 3):
        localizer = begun(corridor, np.random.default_rng(3), None, steady_strides=steady_strides)
        claims = [bool(localizer.step(stride(length_m, turn_rad)).converged) for turn_rad, length_m in walk]
        first[steady_strides] = claims.index(True)
    assert first[3] == first[1] + 2


def test_one_scan_narrows_the_prior_down(corridor: Building, rng: np.random.Generator) -> None:
    briefing = brief(corridor, "stride", "wifi", survey=True)
    localizer = Woodman2008()
    localizer.reset(briefing, rng)
    waiting = localizer.step(Observation(0.2, {"stride": NO_STRIDE, "wifi": NO_SCAN}))
    assert waiting.xy_m == pytest.approx(corridor.centre().xy_m)
    assert waiting.converged is False
    assert localizer.debug()["particles_xy_m"].shape == (0, 2)
    localizer.step(scan((7, -60.0), (9, -80.0)))
    assert (localizer.debug()["particles_polygon"] == 1).all()
    before = localizer.debug()["num_particles"]
    localizer.step(scan((7, -60.0), t_s=2.0))  # a second scan: only the first is looked at
    assert localizer.debug()["num_particles"] == before
    weak = Woodman2008(Woodman2008Params(wifi_threshold_dbm=-50.0))
    weak.reset(briefing, rng)
    weak.step(scan((7, -60.0)))
    assert set(weak.debug()["particles_polygon"]) == {0, 1}


def test_a_scan_that_arrives_in_parts_is_one(corridor: Building, rng: np.random.Generator) -> None:
    localizer = Woodman2008()
    localizer.reset(brief(corridor, "stride", "wifi", survey=True), rng)
    localizer.step(scan((8, -60.0)))  # not in the survey: the whole building
    assert set(localizer.debug()["particles_polygon"]) == {0, 1}
    localizer.step(scan((7, -60.0)))
    assert (localizer.debug()["particles_polygon"] == 1).all()


def test_a_stride_before_the_scan_starts_everywhere(corridor: Building, rng: np.random.Generator) -> None:
    for options, first in (({}, stride(1.0)), ({"use_wifi": False}, scan((7, -60.0)))):
        localizer = Woodman2008(Woodman2008Params(**options))
        localizer.reset(brief(corridor, "stride", "wifi", survey=True), rng)
        localizer.step(first)
        localizer.step(scan((7, -60.0), t_s=2.0))
        assert set(localizer.debug()["particles_polygon"]) == {0, 1}


def test_heights_are_looked_at_unless_switched_off(rng: np.random.Generator) -> None:
    w = WALL
    flat = FloorPolygon("flat", rectangle(0, 0, 10, 10), [w, 1, w, w], 0.0, 0)
    dais = FloorPolygon("dais", rectangle(10, 0, 20, 10), [w, w, w, 0], 0.3, 0)
    hall = Building("hall", (flat, dais))
    for use_height in (True, False):
        localizer = begun(hall, rng, at(9.5, 5.0), use_height=use_height)
        localizer.step(stride(0.4, height_m=0.3))
        found = localizer.debug()
        fraction = found["particles_weight"][found["particles_polygon"] == 1].sum() / found["particles_weight"].sum()
        assert (fraction > 0.95) if use_height else (0.1 < fraction < 0.9)


def test_depleted_particles_are_redrawn_nearby_then_farther(corridor: Building, rng: np.random.Generator) -> None:
    localizer = begun(corridor, rng, at(20.0, 1.0))
    localizer.step(stride(1.0))
    reach_m = []
    for death in range(1, 4):
        estimate = localizer.step(stride(60.0))  # out of the building, whichever way
        found = localizer.debug()
        assert found["deaths"] == death
        assert estimate.converged is False
        assert estimate.xy_m == pytest.approx([21.0, 1.0], abs=0.6)  # of the last live cloud
        assert np.ptp(found["particles_heading_rad"]) > 6.0  # all of 2 pi
        reach_m.append(np.hypot(*(found["particles_xy_m"] - estimate.xy_m).T).max())
    assert reach_m == pytest.approx([3.0, 6.0, 12.0], rel=0.05)
    assert estimate.sigma_m == pytest.approx(6.0)


def test_depleted_before_convergence_they_are_redrawn_at_the_start_then_everywhere(
    corridor: Building, rng: np.random.Generator
) -> None:
    localizer = Woodman2008()
    localizer.reset(brief(corridor, "stride", "wifi", survey=True), rng)
    localizer.step(scan((7, -60.0)))
    localizer.step(stride(60.0))
    assert set(localizer.debug()["particles_polygon"]) == {1}
    localizer.step(stride(60.0))
    assert set(localizer.debug()["particles_polygon"]) == {0, 1}
    assert localizer.debug()["deaths"] == 2


def test_survives_any_walk(corridor: Building, rng: np.random.Generator) -> None:
    """Out of the building, strides of zero and of negative length, rises that no floor has."""
    localizer = begun(corridor, rng, None)
    for length_m, turn_rad, height_m in [(5.0, 0.0, 0.0)] * 30 + [(0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (1.0, 0.0, 3.0)]:
        estimate = localizer.step(stride(length_m, turn_rad, height_m))
        assert np.isfinite(estimate.xy_m).all() and estimate.level == 0
    assert localizer.debug()["deaths"] > 0


def test_settings_that_cannot_be_are_refused(corridor: Building, rng: np.random.Generator) -> None:
    localizer = make_localizer("woodman2008?filter.max_particles=1000&cluster_eps_m=1.0")
    localizer.reset(brief(corridor, "stride"), rng)
    assert localizer.debug()["num_particles"] == 1000  # type: ignore[attr-defined]
    with pytest.raises(FilterError, match="kld_delta"):
        WoodmanFilterParams(kld_delta=2.0)
    with pytest.raises(PdrbenchError, match="cluster_eps_m must be positive"):
        Woodman2008Params(cluster_eps_m=0.0)


def test_learns_the_drift_of_a_walk(corridor: Building) -> None:
    """Every stride claims 0.5 degrees more than was turned; a corridor of 2 m takes that back."""
    drift = DriftParams(length_scale=1.0, sigma_rad=math.radians(0.3))
    localizer = Woodman2008(Woodman2008Params(learns_drift=True, drift=drift))
    localizer.reset(brief(corridor, "stride", start=at(1.0, 1.0, 0.0)), np.random.default_rng(4))
    for step in range(120):
        turn_rad = math.radians(0.5) + (math.pi if step % 30 == 29 else 0.0)
        localizer.step(stride(1.2, float(wrap_rad(turn_rad))))
    assert localizer.debug()["deaths"] == 0
    assert math.degrees(localizer._drift.mean_rad) == pytest.approx(0.5, abs=0.15)


def test_searching_has_settings_of_its_own(corridor: Building) -> None:
    """With a quarter of epsilon the prior takes about four times the particles; after convergence it does not."""
    counts = {}
    for learns_drift in (False, True):
        localizer = begun(corridor, np.random.default_rng(3), None, learns_drift=learns_drift)
        counts[learns_drift] = int(localizer.debug()["num_particles"])
    assert counts[True] == pytest.approx(4 * counts[False], rel=0.1)
