from __future__ import annotations

import collections

import numpy as np
import pytest

from pdrbench.episode import Episode
from pdrbench.errors import UnknownNameError
from pdrbench.geometry import FloatArray
from pdrbench.localizer import Estimate
from pdrbench.recording import Recording
from pdrbench.registry import make_task
from pdrbench.task import HELD_OUT
from pdrbench_envs.campus import environment
from pdrbench_envs.campus.buildings import BUILDINGS
from pdrbench_envs.campus.environment import FEET, PEOPLE, STRIDES
from pdrbench_envs.campus.walks import CampusWalks

ALL = (STRIDES, FEET, PEOPLE)
SECRET = "0123456789abcdef" * 4


def levels_of(recording: Recording) -> set[int]:
    return set(recording.reference.level.tolist())


@pytest.mark.parametrize("of", ALL, ids=lambda of: of.env)
def test_splits_are_large_and_kinds_come_equally_often(of: CampusWalks) -> None:
    task = make_task(of.env, secret=SECRET)
    assert {split: len(walks) for split, walks in task.walks.items()} == {
        "train": 100,
        "val": 40,
        "test": 100,
        HELD_OUT: of.held_out,
    }
    for walks in task.walks.values():
        for number, kinds in enumerate((tuple(BUILDINGS), of.people)):
            counted = collections.Counter(task.groups[walk][number] for walk in walks)
            assert set(counted) == set(kinds)
            assert max(counted.values()) - min(counted.values()) <= 1


@pytest.mark.parametrize("of", ALL, ids=lambda of: of.env)
def test_two_walks_of_three_change_level_whatever_the_kind(of: CampusWalks) -> None:
    task = make_task(of.env)
    walks = [walk for walks in task.walks.values() for walk in walks]
    for number in range(2):
        changes = collections.defaultdict(list)
        for walk in walks:
            changes[task.groups[walk][number]].append(of.changes_level(walk))
        for found in changes.values():
            assert 0.55 < np.mean(found) < 0.78
    assert np.mean([of.changes_level(walk) for walk in walks]) == pytest.approx(2 / 3, abs=0.02)


@pytest.fixture(scope="module")
def strides() -> list[Recording]:
    """Six walks in the five kinds of buildings, of which two stay on their level."""
    task = make_task(STRIDES.env)
    return [task.load(f"val-{index:02d}") for index in range(6)]


def test_a_walk_uses_stairs_where_it_is_said_to(strides: list[Recording]) -> None:
    changes = [STRIDES.changes_level(one.id) for one in strides]
    assert [len(levels_of(one)) > 1 for one in strides] == changes
    assert changes.count(False) == 2


def test_every_walk_has_a_building_and_a_person_of_its_own_and_drifts_by_metres(strides: list[Recording]) -> None:
    assert len({one.building.sha256 for one in strides if one.building}) == len(strides)
    assert len({one.building.name for one in strides if one.building}) == len(strides)
    assert len({one.subject["height_m"] for one in strides if one.subject}) > 1
    for one in strides:
        error_m = np.hypot(*(integrated(one) - one.reference.scored().xy_m).T)
        assert 0.3 < error_m.max() < 60  # 1.9 % of 150 m out and back, and a heading that drifts


def test_strides_are_delivered_while_the_foot_rests_and_walks_take_two_to_four_minutes(
    strides: list[Recording],
) -> None:
    for one in strides:
        waited_s = one.reference.t_s[1:] - one.streams["stride"].t_s
        assert (waited_s > -1e-6).all() and (waited_s < 0.2).all()
        assert one.building is not None
        assert one.building.contains(one.reference.xy_m, one.reference.level).all()
        assert 110 < one.end_s < 245


def integrated(recording: Recording) -> FloatArray:
    """(S, 2) places of a localizer that integrates every stride, when the reference is scored."""
    task = make_task(STRIDES.env)
    episode = Episode(recording, task)
    start = episode.briefing.start
    assert start is not None and start.heading_rad is not None
    xy_m, heading_rad, found = start.xy_m.copy(), start.heading_rad, {}
    while not episode.done:
        observation = episode.observe()
        for _, length_m, _, turn_rad in observation["stride"]:
            heading_rad += turn_rad
            xy_m = xy_m + length_m * np.array([np.cos(heading_rad), np.sin(heading_rad)])
        episode.submit(Estimate(xy_m, 0))
        found[round(observation.now_s, 6)] = xy_m
    return np.array([found[t_s] for t_s in recording.reference.scored().t_s])


def test_error_free_strides_lead_to_every_place_of_the_reference(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(environment, "measure", lambda true_rows, rng, errors: true_rows)
    recording = make_task(STRIDES.env).load("val-03")
    # Rounding: N strides each 0.3 mm and, from there on, 0.03 mrad; of 200 strides a few millimetres.
    np.testing.assert_allclose(integrated(recording), recording.reference.scored().xy_m, atol=0.05)


def test_the_start_is_given_with_the_heading_of_the_first_stride(strides: list[Recording]) -> None:
    for one in strides:
        start = make_task(STRIDES.env).brief(one).start
        first_m = one.reference.xy_m[1] - one.reference.xy_m[0]
        assert start is not None
        # Places are whole millimetres, and the first stride is three decimetres or longer.
        assert start.heading_rad == pytest.approx(np.arctan2(first_m[1], first_m[0]), abs=5e-3)
        np.testing.assert_array_equal(start.xy_m, one.reference.xy_m[0])


def test_an_unknown_walk_is_refused_with_the_nearest_id() -> None:
    with pytest.raises(UnknownNameError, match=r"no walk of CampusStride-v1.*did you mean .train-"):
        make_task(STRIDES.env).load("train-O3")


@pytest.fixture(scope="module")
def phone() -> Recording:
    return make_task(PEOPLE.env).load("val-06")


def test_a_lost_walk_is_the_same_one_without_a_start(phone: Recording) -> None:
    lost = make_task("CampusPhoneLost-v1")
    assert lost.walks == make_task(PEOPLE.env).walks
    walk = lost.load(phone.id)
    for name in set(phone.streams) - {"level_change"}:
        np.testing.assert_array_equal(walk.streams[name].rows, phone.streams[name].rows)
    np.testing.assert_array_equal(walk.reference.xy_m, phone.reference.xy_m)
    scored_s = walk.reference.t_s[walk.reference.surveyed]
    assert scored_s[0] >= phone.streams["wifi"].t_s[0] + lost.period_s
    assert lost.brief(walk).start is None


def test_a_phone_is_briefed_with_where_it_is_carried_and_a_survey_of_all_levels(phone: Recording) -> None:
    task = make_task(PEOPLE.env)
    briefing = task.brief(phone)
    assert briefing.start is not None and briefing.start.heading_rad is None
    assert briefing.mounting == phone.mounting == "bag" == task.groups[phone.id][1]
    assert briefing.radio_map is not None and briefing.building is not None
    assert set(briefing.radio_map.level.tolist()) == set(briefing.building.levels)
    assert set(phone.streams) == {spec.name for spec in task.sensors}


def test_a_unit_on_the_foot_is_scored_where_it_rests() -> None:
    task = make_task(FEET.env)
    walk = task.load("val-01")
    step = walk.reference.t_s / task.period_s
    np.testing.assert_allclose(step, np.round(step), atol=1e-6)
    assert len(levels_of(walk)) > 1
    assert task.brief(walk).start is not None
