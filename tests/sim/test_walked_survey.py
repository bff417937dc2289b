from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from pdrbench.recording import RadioMap
from pdrbench_sim.buildings.office import make_office
from pdrbench_sim.people.route import navigation_mesh
from pdrbench_sim.radio.networks import OFFICE_NETWORKS, make_networks
from pdrbench_sim.radio.walked_survey import SurveyParams, draw_survey, survey_walking
from pdrbench_sim.radio.wlan import Receiver


@pytest.fixture(scope="module")
def building():
    return make_office(np.random.default_rng(2), num_levels=2, area_m2=1200.0)


@pytest.fixture(scope="module")
def networks(building):
    return make_networks(np.random.default_rng(3), building, OFFICE_NETWORKS)


SURVEY = SurveyParams(0.1, 0.0, Receiver())


def survey(networks, building, params: SurveyParams) -> RadioMap:
    return survey_walking(np.random.default_rng(5), networks, navigation_mesh(building), params)


def test_a_denser_survey_has_more_scans_on_every_level(networks, building):
    sparse, dense = (survey(networks, building, dataclasses.replace(SURVEY, m_per_m2=m)) for m in (0.05, 0.2))
    assert len(dense) > 2.5 * len(sparse)
    for one in (sparse, dense):
        assert set(one.level.tolist()) == {0, 1}
        assert building.contains(one.xy_m, one.level).all()
        assert not one.surveyed


def test_an_old_survey_knows_fewer_of_the_senders_of_today(networks, building):
    known = {
        months: np.isin(
            survey(networks, building, dataclasses.replace(SURVEY, months=months)).access_point, networks.id
        )
        for months in (0.0, 12.0)
    }
    assert known[0.0].all()
    assert known[12.0].mean() == pytest.approx(0.95**12, abs=0.15)


def test_another_phone_reports_other_strengths(networks, building):
    ours, theirs = (
        survey(networks, building, dataclasses.replace(SURVEY, receiver=one)) for one in (Receiver(), Receiver(-5.0))
    )
    np.testing.assert_array_equal(ours.xy_m, theirs.xy_m)
    assert ours.rssi_dbm.mean() - theirs.rssi_dbm.mean() == pytest.approx(5.0, abs=0.1)


def test_surveys_differ_within_what_was_asked_for():
    drawn = [draw_survey(np.random.default_rng(seed), (0.04, 0.16), (0.0, 12.0)) for seed in range(50)]
    assert all(0.04 <= one.m_per_m2 <= 0.16 and 0 <= one.months <= 12 for one in drawn)
    assert np.median([one.m_per_m2 for one in drawn]) == pytest.approx(0.08, abs=0.02)
