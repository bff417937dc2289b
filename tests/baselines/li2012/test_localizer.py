from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest

from pdrbench import episode
from pdrbench.building import WALL, Building, FloorPolygon
from pdrbench.episode import Episode
from pdrbench.errors import UnsuitableError
from pdrbench.inertial import to_world
from pdrbench.inertial.quaternions import inverse, multiply
from pdrbench.localizer import Briefing, Observation
from pdrbench.metrics import score
from pdrbench.registry import make_localizer, make_task
from pdrbench.sensors import sensor_spec
from pdrbench.task import no_survey
from pdrbench.trajectory import Start
from pdrbench_baselines.li2012.localizer import GENERIC, Li2012, Li2012Params
from pdrbench_baselines.li2012.map_filter import StepModel, StepModelFilterParams
from pdrbench_baselines.li2012.user_heading import facing

STEP_HZ = 1.9
SMALL = Li2012Params(filter=StepModelFilterParams(num_particles=500))
GENERIC_ONE = dataclasses.replace(SMALL, generic=True)
Rows = dict[str, np.ndarray]


@pytest.fixture(scope="module")
def alley() -> Building:
    """60 m to the east, 2 m wide, around (0, 0)."""
    outline = [[-5, -1], [60, -1], [60, 1], [-5, 1]]
    return Building("alley", (FloorPolygon("way", outline, [WALL] * 4, 0.0, 0),))  # type: ignore[arg-type]


def carried(seconds: float, *, rest: tuple[float, float] = (0, 0), rate_hz: float = 50.0, pocket: bool = False) -> Rows:
    """A phone that goes up and down with the steps of a pedestrian who walks east, except for a rest."""
    t_s = np.arange(round(seconds * rate_hz)) / rate_hz
    walks = (t_s < rest[0]) | (t_s >= rest[1])
    swing = 3.0 * np.sin(2 * np.pi * STEP_HZ * t_s) * walks
    attitude = facing(0.0)
    if pocket:
        attitude = multiply(attitude, np.array([0.5, 0.5, -0.5, 0.5]))
    attitude = np.tile(attitude, (len(t_s), 1))
    force = to_world(inverse(attitude), np.column_stack([0 * t_s, 0 * t_s, 9.81 + swing]))
    field = to_world(inverse(attitude), np.tile([0.0, 31.0, -30.0], (len(t_s), 1)))
    rows = {"accel": force, "gyro": np.zeros((len(t_s), 3)), "mag": field, "rotation": attitude}
    return {name: np.column_stack([t_s, values]) for name, values in rows.items()}


def briefed(
    building: Building | None,
    sensors: tuple[str, ...] = ("accel", "rotation"),
    *,
    start: Start | None = None,
    mounting: str = "hand",
    rate_hz: float = 50.0,
) -> Briefing:
    specs = {name: dataclasses.replace(sensor_spec(name), rate_hz=rate_hz) for name in sensors}
    return Briefing(building, specs, 0.2, start or Start(np.zeros(2), 0), mounting=mounting)


def play(localizer: Li2012, briefing: Briefing, rows: Mapping[str, np.ndarray], seed: int = 0) -> np.ndarray:
    """(K, 2) answers every 0.2 s."""
    localizer.reset(briefing, np.random.default_rng(seed))
    end_s, answers = float(rows["accel"][-1, 0]), []
    for k in range(int(end_s / 0.2) + 1):
        low, high = 0.2 * (k - 1), 0.2 * k
        due = {name: rows[name][(rows[name][:, 0] > low) & (rows[name][:, 0] <= high)] for name in briefing.sensors}
        answers.append(localizer.step(Observation(high, due)).xy_m)
    return np.array(answers)


def test_a_walk_down_an_alley(alley: Building) -> None:
    answers = play(Li2012(GENERIC_ONE), briefed(alley), carried(20.0))
    expected_m = 20.0 * STEP_HZ * GENERIC.length_m(STEP_HZ)
    assert answers[-1, 0] == pytest.approx(expected_m, abs=2.5)  # two steps are not known yet, 1.0 m of spread
    assert np.abs(answers[:, 1]).max() < 0.8
    assert (np.diff(answers[:, 0]) > -0.2).all()


@pytest.mark.parametrize("rate_hz", [20.0, 100.0, 400.0])
def test_any_rate_gives_the_same_walk(alley: Building, rate_hz: float) -> None:
    one = play(Li2012(GENERIC_ONE), briefed(alley), carried(15.0))
    other = play(Li2012(GENERIC_ONE), briefed(alley, rate_hz=rate_hz), carried(15.0, rate_hz=rate_hz))
    assert other[-1] == pytest.approx(one[-1], abs=0.9)  # a step more or less


def test_five_hertz_are_too_few(alley: Building) -> None:
    with pytest.raises(UnsuitableError, match="record it faster"):
        Li2012().reset(briefed(alley, rate_hz=5.0), np.random.default_rng(0))


def test_a_phone_put_down_for_a_minute_goes_nowhere(alley: Building) -> None:
    answers = play(Li2012(GENERIC_ONE), briefed(alley), carried(80.0, rest=(10.0, 70.0)))
    assert answers[int(68 / 0.2)] == pytest.approx(answers[int(14 / 0.2)], abs=1e-9)
    walked_m = answers[-1, 0] - answers[int(68 / 0.2), 0]
    assert walked_m == pytest.approx(10.0 * STEP_HZ * GENERIC.length_m(STEP_HZ), rel=0.25)


def test_without_a_rotation_vector_the_gyroscope_will_do(alley: Building) -> None:
    rows = carried(15.0)
    with_rotation = play(Li2012(GENERIC_ONE), briefed(alley), rows)
    with_gyro = play(Li2012(GENERIC_ONE), briefed(alley, ("accel", "gyro", "mag")), rows)
    assert with_gyro[-1] == pytest.approx(with_rotation[-1], abs=0.5)
    start = Start(np.zeros(2), 0, heading_rad=0.0)
    alone = play(Li2012(GENERIC_ONE), briefed(alley, ("accel", "gyro"), start=start), rows)
    assert alone[-1] == pytest.approx(with_rotation[-1], abs=0.5)


def test_in_a_pocket_the_given_heading_relates_phone_and_walker(alley: Building) -> None:
    start = Start(np.zeros(2), 0, heading_rad=0.0)
    answers = play(Li2012(GENERIC_ONE), briefed(alley, start=start, mounting="pocket"), carried(15.0, pocket=True))
    assert answers[-1, 0] > 14.0
    assert abs(answers[-1, 1]) < 0.8


def test_all_particles_are_depleted_at_the_end_of_the_alley(alley: Building) -> None:
    """Steps lead beyond the end of the building: particles are redrawn where they were, and counted."""
    localizer = Li2012(
        Li2012Params(StepModelFilterParams(num_particles=50, heading_sigma_rad=0.0, length_fraction=0.0), generic=True)
    )
    answers = play(localizer, briefed(alley, start=Start(np.array([58.0, 0.0]), 0)), carried(10.0))
    assert localizer.debug()["resets"] >= 1
    assert alley.contains(answers, 0).mean() > 0.9
    assert np.isfinite(answers).all()


def test_a_personal_model_is_where_the_next_walk_begins(alley: Building) -> None:
    first = Li2012(SMALL)
    play(first, briefed(alley), carried(5.0))
    model = first.personal_model()
    second = Li2012(Li2012Params(StepModelFilterParams(num_particles=500, delta_a=0.0, delta_b=0.0)), model=model)
    play(second, briefed(alley), carried(5.0))
    assert second.debug()["step_model"] == pytest.approx([model.a_m_per_hz, model.b_m])
    mine = StepModel(0.2, 0.5)
    assert Li2012(GENERIC_ONE).personal_model() == GENERIC
    fixed = Li2012(GENERIC_ONE, model=mine)
    play(fixed, briefed(alley), carried(5.0))
    assert fixed.personal_model() == mine


def test_extrapolation_removes_the_wait_for_the_next_step(alley: Building) -> None:
    rows = carried(15.0)
    lagging, now = (
        play(Li2012(dataclasses.replace(GENERIC_ONE, carries_on=on)), briefed(alley), rows) for on in (False, True)
    )
    speed_mps = STEP_HZ * GENERIC.length_m(STEP_HZ)
    later = slice(25, None)
    ahead_s = (now[later, 0] - lagging[later, 0]).mean() / speed_mps
    assert 0.4 < ahead_s < 0.9  # 0.37 s until a step is known, half a step on average until the next one is


@pytest.mark.data
def test_real_walks_in_a_mall(data_root: Path) -> None:
    """Five val walks on the floors of one mall: 1.8 m with the map, 2.8 m without when this was written."""
    task = dataclasses.replace(make_task("MallPhone-v2"), radio_map=no_survey)  # of which the localizer reads nothing
    walks = [walk for walk in task.split("val") if walk.startswith("site1")][::12]
    mean_m: dict[str, list[float]] = {"li2012?generic=true": [], "li2012?map=false": []}
    for recording in map(task.load, walks):
        for name, errors_m in mean_m.items():
            rng = np.random.default_rng(0)
            result = episode.play(make_localizer(name), Episode(recording, task), rng, name=name, seed=0)
            scores = score(result.estimates, recording.reference, recording.building, task.fallback(recording))
            errors_m.append(scores["mean_m"])
    with_map_m, without_m = map(np.mean, mean_m.values())
    assert with_map_m < 2.0
    assert with_map_m < 0.9 * without_m
