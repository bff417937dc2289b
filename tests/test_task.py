"""What a task owes to its walks, units of replication, groups, folds; what a localizer asks of its briefing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench.errors import RecordingError, UnsuitableError
from pdrbench.localizer import Briefing, Carrier
from pdrbench.recording import RadioMap, Recording
from pdrbench.registry import make_task
from pdrbench.sensors import sensor_spec
from pdrbench.task import Task
from pdrbench.trajectory import Start, Trajectory

TASK = Task(
    id="Parts-v0",
    summary="",
    description="",
    sensors=(),
    capacity={},
    period_s=1.0,
    start="pose",
    walks={"train": ("a", "b", "c"), "test": ("d", "e")},
    load=lambda walk: pytest.fail("no walk is loaded"),
    tell_start=lambda recording: Start(np.zeros(2), 0),
    licence="MIT",
    source="generated",
)
UNITS = {"a": "1", "b": "1", "c": "2", "d": "3", "e": "1"}


def test_every_walk_has_a_unit_and_folds_part_whole_units() -> None:
    assert replace(TASK, units=UNITS, folds={"a": 0, "b": 0, "c": 1}).units["c"] == "2"
    with pytest.raises(RecordingError, match="walk 'e' has no unit"):
        replace(TASK, units=dict.fromkeys("abcd", "1"))
    with pytest.raises(RecordingError, match="walk 'c' has no fold"):
        replace(TASK, folds={"a": 0, "b": 1})
    with pytest.raises(RecordingError, match="unit '1' lies in two folds"):
        replace(TASK, units=UNITS, folds={"a": 0, "b": 1, "c": 1})
    assert replace(TASK, groups={"d": ("later",)}).groups == {"d": ("later",)}


def test_without_a_start_and_a_building_a_silent_localizer_is_in_the_middle_of_the_survey() -> None:
    """On the level with the most scans; an outlier moves it little. Without a survey nothing is known."""
    xy_m = np.array([[0.0, 0.0], [1.0, 4.0], [2.0, 5.0], [3.0, 6.0], [900.0, 7.0], [50.0, 50.0]])
    level, none = np.array([0, 1, 1, 1, 1, 2]), np.zeros(0)
    survey = RadioMap(xy_m, level, np.zeros(6, int), np.zeros(7, int), none.astype(int), none, none)
    walk = Recording("d", None, {}, Trajectory(none, np.zeros((0, 2)), none.astype(int), none.astype(bool)))
    for radio_map, middle in ((lambda _: survey, ([2.5, 5.5], 1)), (TASK.radio_map, ([0.0, 0.0], 0))):
        fallback = replace(TASK, start="unknown", radio_map=radio_map).fallback(walk)
        assert (fallback.xy_m.tolist(), fallback.level) == middle


@pytest.mark.parametrize(
    ("env", "kind", "num_units"),
    [("FootVicon-v1", "person", 1), ("IpinPhone-v1", "route", 4), ("MallPhone-v2", "outing", 31)],
)
def test_units_of_environments(env: str, kind: str, num_units: int) -> None:
    task = make_task(env)
    assert (task.unit_kind, len({task.units[walk] for walk in task.walks["test"]})) == (kind, num_units)


SENSORS = {"accel": replace(sensor_spec("accel"), rate_hz=50.0), "gyro": replace(sensor_spec("gyro"), rate_hz=None)}


@pytest.mark.parametrize(
    ("mounting", "carrier", "why"),
    [
        ("hand", "foot", "is carried in the hand"),
        ("", "foot", "may be carried anywhere"),
        ("foot", "phone", "needs a phone"),
    ],
)
def test_a_device_carried_elsewhere_is_declined(mounting: str, carrier: Carrier, why: str) -> None:
    briefing = Briefing(None, SENSORS, 0.2, mounting=mounting)
    with pytest.raises(UnsuitableError, match=why):
        briefing.require(carrier=carrier)
    briefing.require(carrier=briefing.carrier)


def test_a_slow_sensor_is_declined_where_its_rate_is_known() -> None:
    briefing = Briefing(None, SENSORS, 0.2)
    briefing.require(sensors=("accel", "gyro"), min_rate_hz=50.0)
    with pytest.raises(UnsuitableError, match=r"'accel' at 80 Hz or more; this one has 50 Hz"):
        briefing.require(sensors=("gyro", "accel"), min_rate_hz=80.0)
