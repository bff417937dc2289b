from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdrbench.errors import PdrbenchError
from pdrbench.inertial import LevelTracker, PeakStepDetector, VerticalParams
from pdrbench.inertial.vertical import SCALE_HEIGHT_M, LevelChange
from pdrbench.io.log import Log
from pdrbench_formats.detect import read

RATE_HZ = 10.0
FLOORS_M = {-1: -3.5, 0: 0.0, 1: 4.0, 2: 7.5}
SPEED_MPS = {"stairs": 0.3, "lift": 1.1, "escalator": 0.3}


class Climber:
    """Somebody who walks for 30 s, goes to another level and walks on; a barometer with the noise of phones.

    Attributes:
        baro, steps_s: What a tracker is given.
        arrives_s: When the other level is reached.
    """

    def __init__(self, rng: np.random.Generator, rise_m: float, way: str, air_hpa: float = 0.0) -> None:
        t_s = np.arange(0.0, 90.0, 1 / RATE_HZ)
        self.arrives_s = 30.0 + max(abs(rise_m), 0.1) / SPEED_MPS[way]
        height_m = rise_m * np.clip((t_s - 30.0) / (self.arrives_s - 30.0), 0.0, 1.0)
        pressure_hpa = 985.0 * np.exp(-height_m / SCALE_HEIGHT_M) + air_hpa * (t_s > 70.0)
        self.baro = np.column_stack([t_s, pressure_hpa + 0.015 * rng.standard_normal(len(t_s))])
        steps_s = np.arange(0.0, 90.0, 0.55)
        rides = (steps_s > 29.0) & (steps_s < self.arrives_s + 1.0) & (way != "stairs")
        self.steps_s = steps_s[~rides]

    def tracked(self, tracker: LevelTracker, pieces: int = 1) -> list[LevelChange]:
        changes = []
        for rows in np.array_split(self.baro, pieces):
            within = (self.steps_s >= rows[0, 0]) & (self.steps_s < rows[-1, 0] + 1 / RATE_HZ)
            changes += tracker.update(rows, self.steps_s[within])
        return changes


@pytest.mark.parametrize("way", SPEED_MPS)
@pytest.mark.parametrize("level", [-1, 1, 2])
def test_a_level_is_reached_and_the_way_is_known(rng: np.random.Generator, way: str, level: int) -> None:
    climber = Climber(rng, FLOORS_M[level], way)
    tracker = LevelTracker(0, FLOORS_M)
    changes = climber.tracked(tracker)
    assert tracker.level == level == sum(change.levels for change in changes)
    assert sum(change.rise_m for change in changes) == pytest.approx(FLOORS_M[level])
    assert changes[-1].way == way
    middle_s = 30.0 + abs(FLOORS_M[level]) / SPEED_MPS[way] * (0.5 if abs(level) == 1 else 0.75)
    assert abs(changes[-1].t_s - middle_s) < 3.0
    assert tracker.height_m == pytest.approx(FLOORS_M[level], abs=0.3)


@pytest.mark.parametrize("level", [-1, 1])
def test_unknown_heights_are_learned(rng: np.random.Generator, level: int) -> None:
    tracker = LevelTracker(5)
    Climber(rng, 1.25 * FLOORS_M[level], "stairs").tracked(tracker)
    assert tracker.level == 5 + level


@pytest.mark.parametrize("air_hpa", [-0.3, 0.3])
def test_a_door_is_no_stair(rng: np.random.Generator, air_hpa: float) -> None:
    """It changes the pressure by 2.5 m at once; without limits of speed it is taken for a level."""
    climber = Climber(rng, 0.0, "stairs", air_hpa)
    tracker = LevelTracker(0, FLOORS_M)
    assert climber.tracked(tracker) == []
    assert tracker.height_m == pytest.approx(0.0, abs=0.5)
    unlimited = LevelTracker(0, FLOORS_M, VerticalParams(stairs_mps=99.0, lift_mps=99.0, surge_mps=99.0))
    assert climber.tracked(unlimited)


def test_a_lift_in_a_gap_is_noticed_and_impossible_pressures_are_left_out(rng: np.random.Generator) -> None:
    climber = Climber(rng, FLOORS_M[2], "lift")
    silent = (climber.baro[:, 0] > 28.0) & (climber.baro[:, 0] < 45.0)
    climber.baro = climber.baro[~silent]
    climber.baro[50:60, 1] = 0.0
    tracker = LevelTracker(0, FLOORS_M)
    assert [change.levels for change in climber.tracked(tracker)] == [2]
    assert tracker.level == 2


def test_weather_is_followed(rng: np.random.Generator) -> None:
    t_s = np.arange(0.0, 3600.0, 0.5)
    falling = np.column_stack([t_s, 1000.0 - 1.5 * t_s / 3600 + 0.02 * rng.standard_normal(len(t_s))])  # by 12 m
    tracker = LevelTracker(0, FLOORS_M)
    assert tracker.update(falling, np.arange(0.0, 3600.0, 0.6)) == []


def test_any_chunks_give_the_same(rng: np.random.Generator) -> None:
    climber = Climber(rng, FLOORS_M[2], "stairs")
    whole = climber.tracked(LevelTracker(0, FLOORS_M))
    assert climber.tracked(LevelTracker(0, FLOORS_M), pieces=237) == whole


def test_what_cannot_be_meant_is_refused() -> None:
    with pytest.raises(PdrbenchError, match=r"level 7, where it begins; known are -1, 0, 1, 2"):
        LevelTracker(7, FLOORS_M)
    with pytest.raises(PdrbenchError, match="settle_s must be positive"):
        VerticalParams(settle_s=0.0)


@pytest.mark.data
def test_no_level_is_made_up_in_recorded_walks(data_root: Path) -> None:
    """IPIN 2023 Track 3: these logs stay on one level each, so only changes that are none can be seen."""
    logs = sorted((data_root / "ipin2023_track3" / "logs").glob("*repetition01.txt"))
    if not logs:
        pytest.skip("ipin2023_track3 is not here")
    for path in logs[::4]:
        log = read(path)
        assert isinstance(log, Log)
        accel, baro = log.rows["accel"], log.rows["baro"]
        steps_s = PeakStepDetector(1 / float(np.median(np.diff(accel[:, 0])))).update(accel)
        assert len(steps_s) > 50
        assert LevelTracker(int(log.reference.level[0])).update(baro, steps_s) == [], path.name
