from __future__ import annotations

import numpy as np
import pytest

from pdrbench.localizer import Briefing, Observation
from pdrbench.sensors import sensor_spec
from pdrbench.trajectory import Start
from pdrbench_baselines.dead_reckoning import DeadReckoning, DeadReckoningParams


def brief(*sensors: str, heading_rad: float | None = 0.0, start: bool = True) -> Briefing:
    return Briefing(
        building=None,
        sensors={name: sensor_spec(name) for name in sensors},
        period_s=0.2,
        start=Start(np.array([5.0, 5.0]), 2, heading_rad) if start else None,
    )


def test_strides_turn_first_and_then_move(rng: np.random.Generator) -> None:
    localizer = DeadReckoning()
    localizer.reset(brief("stride"), rng)
    square = [[1.0, 2.0, 0.0, 0.0], [2.0, 2.0, 0.0, np.pi / 2], [3.0, 2.0, 0.0, np.pi / 2], [4.0, 2.0, 0.0, np.pi / 2]]
    expected = [[7, 5], [7, 7], [5, 7], [5, 5]]
    for row, xy_m in zip(square, expected, strict=True):
        estimate = localizer.step(Observation(row[0], {"stride": np.array([row])}))
        assert estimate.xy_m == pytest.approx(xy_m)


def test_rise_counts_as_levels(rng: np.random.Generator) -> None:
    localizer = DeadReckoning(DeadReckoningParams(level_height_m=3.0))
    localizer.reset(brief("stride"), rng)
    climb = np.array([[1.0, 0.6, 0.33, 0.0]] * 10)
    assert localizer.step(Observation(1.0, {"stride": climb[:4]})).level == 2
    assert localizer.step(Observation(2.0, {"stride": climb[:2]})).level == 3
    assert localizer.step(Observation(3.0, {"stride": climb})).level == 4


def test_phone_steps_go_where_the_top_edge_points(rng: np.random.Generator) -> None:
    localizer = DeadReckoning(DeadReckoningParams(step_length_m=0.5))
    localizer.reset(brief("accel", "rotation", heading_rad=None), rng)
    t_s = np.arange(0, 10, 0.02)
    accel = np.column_stack([t_s, 0 * t_s, 0 * t_s, 9.81 + 3 * np.sin(2 * np.pi * 2 * t_s)])  # two steps a second
    half = np.sqrt(0.5)
    west = np.column_stack([t_s, np.tile([half, 0, 0, half], (len(t_s), 1))])
    for now_s in np.arange(0.2, 10.01, 0.2):
        due = (t_s > now_s - 0.2 - 1e-9) & (t_s <= now_s - 1e-9)
        estimate = localizer.step(Observation(now_s, {"accel": accel[due], "rotation": west[due]}))
    assert estimate.xy_m[1] == pytest.approx(5.0)
    assert estimate.xy_m[0] == pytest.approx(5.0 - 20 * 0.5, abs=0.51)  # the last step may not be visible yet
