"""The order of localizers: the task is `MallPhone-v0` in all but its walks."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pdrbench.building import Building, FloorPolygon
from pdrbench.errors import UnsuitableError
from pdrbench.localizer import Briefing
from pdrbench.recording import RadioMap, Recording, SensorStream
from pdrbench.registry import localizers, make_localizer, make_task, registered_task
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Trajectory
from pdrbench_sim.realism import ordering

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
    assert ordering.mean_error_m("stay-v0", task, "one") == pytest.approx(7.5)
    assert ordering.mean_error_m("stay-v0", task, "two") == pytest.approx(2.5)


def test_the_briefing_is_that_of_the_environment() -> None:
    task, model = ordering.mall_task([straight("one")], lambda recording: SURVEY), make_task(ordering.ENVIRONMENT)
    for name in ("sensors", "capacity", "period_s", "start"):
        assert getattr(task, name) == getattr(model, name)
    briefing = task.brief(task.load("one"))
    assert briefing.radio_map is SURVEY
    assert briefing.start is not None and briefing.start.heading_rad is None


def test_every_suitable_localizer_takes_part() -> None:
    """But the oracle, step counters, variants, those for shoes (any accelerometer will do), those that need torch."""
    hall = Building("hall", (FloorPolygon("hall", [(-5, -5), (20, -5), (20, 5), (-5, 5)], [-1] * 4, 0.0, 0),))
    task = ordering.mall_task([replace(straight("one"), building=hall)], lambda recording: SURVEY)
    briefing = task.brief(task.load("one"))
    ours = [name for name, entry in localizers().items() if entry.package == "pdrbench"]
    apart = ("foot_ins", "frank2009", "learned", "oracle", "step_count", "li2012_")
    found = {name for name in ours if _can_play(name, briefing) and not name.startswith(apart)}
    assert found == set(ordering.LOCALIZERS)


def _can_play(name: str, briefing: Briefing) -> bool:
    try:
        make_localizer(name).reset(briefing, np.random.default_rng(0))
    except UnsuitableError:
        return False
    return True


def test_floors_are_surveyed_by_walks_that_are_not_played(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[int, int]] = []
    played: list[float] = []

    def mall_walk(seed: int, floor: int, number: int, *, median_s: float = 29.0) -> Recording:
        made.append((floor, number))
        if number < ordering.FIRST_SURVEYED:
            played.append(median_s)
        return straight(f"walk-{number}-floor-{floor}", metres=1.0 + floor)

    monkeypatch.setattr(ordering, "mall_walk", mall_walk)
    monkeypatch.setattr(ordering, "survey_of", lambda walks: SURVEY if len(walks) == ordering.SURVEY_WALKS else None)
    monkeypatch.setattr(ordering, "LOCALIZERS", ("stay-v0",))
    ordering._survey.cache_clear()
    found = ordering.synthetic(seed=1, count=5)
    ordering._survey.cache_clear()
    assert found["stay-v0"] == pytest.approx([2.5, 2.5, 2.5, 5.0, 5.0])  # 5 walks on 2 floors
    assert found[ordering.ORDER_NAME] == pytest.approx([3.5])
    assert len(set(made)) == len(made) == 5 + 2 * ordering.SURVEY_WALKS
    assert played == [13.0] * 5  # as the recorded walks with all sensors; survey walks are longer


@pytest.mark.data
@pytest.mark.long(seconds=12)
def test_recorded_walks_on_surveyed_levels(data_root: Path) -> None:
    """16 of the 33 test walks; the mean errors are those that `compare` prints for `MallPhone-v0` on these walks."""
    if not (data_root / "ilc20").is_dir():
        pytest.skip("ilc20 is not under PDRBENCH_DATA")
    registered_task.cache_clear()
    found = ordering.real("judge")
    assert {len(found[name]) for name in ordering.LOCALIZERS} == {16}
    assert found[ordering.ORDER_NAME] == pytest.approx([2.4, 2.5, 9.3, 6.2, 85.1, 9.8], abs=0.3)
