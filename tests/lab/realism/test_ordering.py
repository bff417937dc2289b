"""The order of localizers: the task is `MallPhone-v2` in all but its walks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench.building import Building, FloorPolygon
from pdrbench.errors import UnsuitableError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Briefing
from pdrbench.recording import RadioMap, Recording, SensorStream
from pdrbench.registry import localizers, make_localizer, make_task
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Trajectory
from pdrbench_lab.realism import ordering
from pdrbench_lab.realism.block import CLUSTER

SURVEY = RadioMap(
    xy_m=[[0.0, 0.0], [10.0, 0.0]],
    level=[0, 0],
    walk=[0, 1],
    first=[0, 1, 2],
    access_point=[7, 8],
    rssi_dbm=[-50.0, -50.0],
    age_s=[0.0, 0.0],
)


def straight(name: str, metres: float = 3.0) -> Recording:
    """Five waypoints ahead, `metres` apart, 4 s each, with a phone at rest that receives no scan."""
    t_s = 4.0 * np.arange(5)
    reference = Trajectory(
        t_s=t_s, xy_m=np.column_stack([metres * np.arange(5), np.zeros(5)]), level=np.zeros(5), surveyed=np.ones(5)
    )
    spec = sensor_spec("accel")
    rows = np.column_stack([np.arange(0, 16, 0.02), np.tile([0.0, 0.0, 9.81], (800, 1))])
    streams = {"accel": SensorStream(spec, rows), "wifi": SensorStream(sensor_spec("wifi"), np.zeros((0, 5)))}
    return Recording(id=name, building=None, streams=streams, reference=reference)


def test_staying_at_the_start_errs_by_the_mean_distance_of_the_scored_waypoints() -> None:
    """3, 6, 9 and 12 m; the first waypoint is given and not scored."""
    task = ordering.mall_task([straight("one"), straight("two", 1.0)], lambda recording: SURVEY)
    assert ordering.mean_error_m("stay", task, "one") == pytest.approx(7.5)
    assert ordering.mean_error_m("stay", task, "two") == pytest.approx(2.5)


def test_the_briefing_is_that_of_the_environment() -> None:
    task, model = ordering.mall_task([straight("one")], lambda recording: SURVEY), make_task(ordering.ENVIRONMENT)
    for name in ("sensors", "capacity", "period_s", "start"):
        assert getattr(task, name) == getattr(model, name)
    briefing = task.brief(task.load("one"))
    assert briefing.radio_map is SURVEY
    assert briefing.start is not None and briefing.start.heading_rad is None


def test_every_suitable_localizer_takes_part() -> None:
    """But the oracle, those for shoes (any accelerometer will do), and those that take seconds for every survey."""
    hall = Building("hall", (FloorPolygon("hall", [(-5, -5), (20, -5), (20, 5), (-5, 5)], [-1] * 4, 0.0, 0),))
    task = ordering.mall_task([replace(straight("one"), building=hall)], lambda recording: SURVEY)
    briefing = task.brief(task.load("one"))
    ours = [name for name, entry in localizers().items() if entry.package == "pdrbench"]
    apart = ("foot_ins", "frank2009", "fusion", "learned", "oracle", "gp_wifi")
    found = {name for name in ours if _can_play(name, briefing) and not name.startswith(apart)}
    assert found == {name.partition("?")[0] for name in ordering.LOCALIZERS}


def _can_play(name: str, briefing: Briefing) -> bool:
    try:
        make_localizer(name).reset(briefing, np.random.default_rng(0))
    except UnsuitableError:
        return False
    return True


def test_the_walks_of_a_survey_keep_away_from_its_gaps(monkeypatch: pytest.MonkeyPatch) -> None:
    """Walks beside each other, 5 m apart: the first choose the gaps, and none of the others lies near one."""
    made: list[int] = []

    def mall_walk(seed: int, floor: int, number: int) -> Recording:
        made.append(number)
        walk = straight(f"walk-{number}-floor-{floor}")
        moved_m = walk.reference.xy_m + np.array([0.0, 5.0 * (number - ordering.FIRST_SURVEYED)])
        return replace(walk, reference=replace(walk.reference, xy_m=moved_m))

    monkeypatch.setattr(ordering, "mall_walk", mall_walk)
    walks = ordering.survey_with_gaps(seed=1, floor=0)
    assert len(walks) == ordering.SURVEY_WALKS
    assert min(made) == ordering.FIRST_SURVEYED
    nearest_m = min(walk.xy_m[:, 1].min() for walk in walks) - 5.0 * (ordering.GAPS - 1)
    assert nearest_m >= 10.0  # gaps are at most 6 m along x from the middle of a walk, and 15 m wide: sqrt(225 - 36)


def test_each_floor_is_one_cluster(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        ordering, "mall_walk", lambda _, floor, number: straight(f"walk-{number}-floor-{floor}", 1.0 + floor)
    )
    monkeypatch.setattr(ordering, "survey_of", lambda walks: SURVEY)
    monkeypatch.setattr(ordering, "survey_with_gaps", lambda seed, floor: [])
    monkeypatch.setattr(ordering, "LOCALIZERS", ("stay",))
    monkeypatch.setattr(ordering, "FLOORS", 2)
    ordering._survey.cache_clear()
    found = ordering.synthetic(seed=1, count=5)
    ordering._survey.cache_clear()
    assert found["stay"] == pytest.approx([2.5, 2.5, 2.5, 5.0, 5.0])  # 5 walks on 2 floors
    assert found[f"stay{CLUSTER}"].tolist() == [0, 0, 0, 1, 1]
    assert found[ordering.ORDER_NAME] == pytest.approx([3.5])


def test_tau_is_one_for_equal_orders_and_its_interval_knows_how_sure_they_are(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of three pairs one is swapped: (2 - 1) / 3. Two competitors that exchange places from unit to unit widen it."""
    monkeypatch.setattr(ordering, "LOCALIZERS", ("a", "b", "c"))
    monkeypatch.setattr(ordering, "DRAWS", 200)
    one = {"a": [1.0, 1.1], "b": [2.0, 2.1], "c": [3.0, 3.1]}
    assert ordering.tau_interval(_values(one), _values(one)) == (1.0, 1.0, 1.0)
    swapped = {"a": [2.0, 2.1], "b": [1.0, 1.1], "c": [3.0, 3.1]}
    assert ordering.tau_interval(_values(one), _values(swapped)) == pytest.approx((1 / 3, 1 / 3, 1 / 3))
    unsure = {"a": [1.0, 2.6], "b": [2.0, 2.0], "c": [3.0, 3.0]}
    assert ordering.tau_interval(_values(one), _values(unsure)) == pytest.approx((1.0, 1 / 3, 1.0))


def _values(errors: dict[str, list[float]]) -> dict[str, FloatArray]:
    """Two units of one walk each."""
    values = {name: np.array(each) for name, each in errors.items()}
    clusters = {f"{name}{CLUSTER}": np.arange(2.0) for name in errors}
    return {**values, **clusters, ordering.ORDER_NAME: np.array([each.mean() for each in values.values()])}
