from __future__ import annotations

import itertools

import numpy as np
import pytest

from pdrbench.episode import Episode
from pdrbench.errors import UnknownNameError
from pdrbench.localizer import Estimate
from pdrbench_envs.campus import environment
from pdrbench_envs.generated import start_pose
from pdrbench_lab.papers.woodman2008.lab_stride import environment as lab_stride
from pdrbench_lab.papers.woodman2008.lab_stride.lab import ROOMS, in_tracked_wing, tracked_outline


@pytest.fixture(scope="module")
def lost():
    return lab_stride.task()


@pytest.fixture(scope="module")
def wifi():
    return lab_stride.task_wifi()


@pytest.fixture(scope="module")
def walks(lost):
    """A walk of two splits, by id."""
    return {walk: lost.load(walk) for walk in (lost.split("val")[0], lost.split("test")[0])}


def passes_of(recording) -> list[np.ndarray]:
    """Rows of the reference of every visit of the tracked wing."""
    inside = in_tracked_wing(recording.building, recording.reference.xy_m, recording.reference.level)
    rows = np.flatnonzero(inside)
    return np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)


def check_is_the_walk_of_the_paper(recording) -> None:
    """Claim W1: 16 minutes, about 870 strides, six passes of about 28 strides, other levels between them."""
    reference, building = recording.reference, recording.building
    assert 750 <= len(recording.streams["stride"].rows) <= 1000
    assert 15.5 * 60 <= reference.t_s[-1] <= 19 * 60
    visits = passes_of(recording)
    assert len(visits) == 6
    assert 22 <= np.mean([len(visit) for visit in visits]) <= 36
    levels = [set(reference.level[a[-1] : b[0]].tolist()) for a, b in itertools.pairwise(visits)]
    assert sum(len(between) > 1 for between in levels) >= 4
    away_m = reference.xy_m - tracked_outline(building).mean(axis=0)
    assert np.hypot(*away_m[0]) > 25
    use = {zone.id: zone.kind for zone in building.zones}
    for visit in visits:
        polygons = building.locate(reference.xy_m[visit], reference.level[visit])
        kinds = {use.get(building.polygons[polygon].id) for polygon in polygons}
        assert "corridor" in kinds
        assert kinds & ROOMS


def test_both_environments_have_the_stated_walks(lost, wifi):
    assert {split: len(walks) for split, walks in lost.walks.items()} == {"train": 10, "val": 5, "test": 20}
    assert lost.walks == wifi.walks
    assert lost.start == wifi.start == "unknown"
    assert [[spec.name for spec in task.sensors] for task in (lost, wifi)] == [["stride"], ["stride", "wifi"]]
    ids = lost.split("test")
    assert list(ids) == sorted(ids)
    assert all(len(walk.removeprefix("test-")) == 12 for walk in ids)


def test_the_walk_is_that_of_the_paper(walks):
    for recording in walks.values():
        check_is_the_walk_of_the_paper(recording)


def test_an_unknown_walk_is_refused_with_the_nearest_id(lost):
    with pytest.raises(UnknownNameError, match=r"no walk of LabStrideLost-v2.*did you mean .val-"):
        lost.load("val-O3")


def test_every_walk_has_a_building_and_a_person_of_its_own(lost, walks):
    walks = [*walks.values(), lost.load(lost.split("train")[0])]
    assert len({recording.building.sha256 for recording in walks}) == 3
    assert len({recording.subject["height_m"] for recording in walks}) > 1


def test_strides_run_free_of_walls_and_end_on_the_floor(walks):
    for walk, recording in walks.items():
        building, _, rests = lab_stride._walk(*lab_stride.WALKS.place_of(walk))
        reached, is_free = building.move(rests.polygon[:-1], rests.xy_m[:-1], rests.xy_m[1:])
        assert (is_free & (reached == rests.polygon[1:])).all()
        np.testing.assert_allclose(rests.xy_m, recording.reference.xy_m, rtol=0, atol=5.1e-4)  # whole millimetres
        assert building.contains(rests.xy_m, building.level(rests.polygon)).all()


def test_every_stance_but_the_first_is_scored_at_the_observation_that_delivers_it(walks):
    for recording in walks.values():
        reference, report_times_s = recording.reference, recording.streams["stride"].t_s
        np.testing.assert_array_equal(reference.surveyed, np.arange(len(reference)) > 0)
        waited_s = reference.t_s[1:] - report_times_s
        assert (waited_s > -1e-6).all()
        assert (waited_s < 0.2).all()


def test_a_localizer_that_integrates_error_free_strides_is_right_at_every_reference(lost, monkeypatch):
    monkeypatch.setattr(environment, "measure", lambda true_rows, rng, errors: true_rows)
    recording = lost.load(lost.split("val")[0])
    start = start_pose(recording)
    episode = Episode(recording, lost)
    assert episode.briefing.start is None
    xy_m, heading_rad, found = start.xy_m.copy(), start.heading_rad, {}
    while not episode.done:
        observation = episode.observe()
        for _, length_m, _, turn_rad in observation["stride"]:
            heading_rad += turn_rad
            xy_m = xy_m + length_m * np.array([np.cos(heading_rad), np.sin(heading_rad)])
        episode.submit(Estimate(xy_m, 0))
        found[round(observation.now_s, 6)] = xy_m
    scored = recording.reference.scored()
    # Rounding of 900 strides: 0.3 mm each makes a centimetre, 0.03 mrad each a milliradian of 100 m.
    np.testing.assert_allclose([found[round(t_s, 6)] for t_s in scored.t_s.tolist()], scored.xy_m, rtol=0, atol=0.3)


def test_the_wifi_environment_adds_one_scan_at_the_start(wifi, walks):
    for walk, recording in walks.items():
        with_scan = wifi.load(walk)
        assert with_scan.streams["stride"].rows.tobytes() == recording.streams["stride"].rows.tobytes()
        rows = with_scan.streams["wifi"].rows
        assert len(rows) >= 1
        np.testing.assert_array_equal(rows[:, 0], 0.0)
        assert len(np.unique(rows[:, 1])) == len(rows)
        episode = Episode(with_scan, wifi)
        np.testing.assert_array_equal(episode.observe()["wifi"], rows)
        assert wifi.load(walk).streams["wifi"].rows.tobytes() == rows.tobytes()


def test_the_wifi_environment_gives_the_survey_of_the_building_and_nothing_of_the_walk(wifi, walks):
    recording = wifi.load(next(iter(walks)))
    briefing = wifi.brief(recording)
    assert briefing.start is None
    survey = briefing.radio_map
    apart_m = np.hypot(*(survey.xy_m - recording.reference.xy_m[0]).T)
    assert apart_m.min() > 0
    assert set(recording.streams["wifi"].rows[:, 1]) <= set(survey.access_point.tolist())
    assert len(np.unique(survey.access_point)) >= 30
