"""Walks with other strides, on which the missed gates of the paper are looked into."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from pdrbench.building import Building
from pdrbench.filters import kld_bound, normal_quantile
from pdrbench.geometry import FloatArray, wrap_rad
from pdrbench.recording import Recording, SensorStream
from pdrbench.sensors.stride import STRIDE
from pdrbench.trajectory import Trajectory
from pdrbench_lab.papers.single_scans import receive
from pdrbench_lab.papers.woodman2008.experiments import DELTA, TRACKING_BINS
from pdrbench_lab.papers.woodman2008.misses import exact_strides, without_drift
from pdrbench_lab.papers.woodman2008.shared_field import SharedField
from pdrbench_sim.radio.wlan import PropagationParams, make_radio_field


@pytest.fixture
def walk() -> Recording:
    """Six strides of a metre, each turned by 0.3 rad and a tread up, 10 % short and 0.02 rad too far as reported."""
    heading_rad = wrap_rad(2.5 + 0.3 * np.arange(7))
    step_m = np.column_stack([np.cos(heading_rad[1:]), np.sin(heading_rad[1:])])
    reference = Trajectory(
        t_s=np.arange(7.0),
        xy_m=np.vstack([np.zeros(2), np.cumsum(step_m, axis=0)]),
        level=np.zeros(7),
        surveyed=np.ones(7),
        heading_rad=heading_rad,
        z_m=0.2 * np.arange(7),
    )
    rows = np.column_stack([np.arange(1.0, 7.0), np.full(6, 0.9), np.full(6, 0.1), np.full(6, 0.32)])
    return Recording(id="walk", building=None, streams={"stride": SensorStream(STRIDE, rows)}, reference=reference)


def test_exact_strides_lead_along_the_walk(walk: Recording) -> None:
    _, length_m, height_m, turn_rad = exact_strides(walk).streams["stride"].rows.T
    np.testing.assert_allclose(length_m, 1.0)
    np.testing.assert_allclose(height_m, 0.2)
    np.testing.assert_allclose(turn_rad, 0.3)  # also across -pi


def test_without_drift_only_the_common_turn_goes(walk: Recording) -> None:
    rows = walk.streams["stride"].rows.copy()
    rows[:, 3] += [0.01, -0.01, 0.02, -0.02, 0.0, 0.0]
    changed = without_drift(replace(walk, streams={"stride": SensorStream(STRIDE, rows)})).streams["stride"].rows
    np.testing.assert_allclose(changed[:, 3], 0.3 + np.array([0.01, -0.01, 0.02, -0.02, 0.0, 0.0]))
    np.testing.assert_array_equal(changed[:, :3], rows[:, :3])


def test_tracking_ends_where_500_particles_no_longer_do() -> None:
    """W15: the most bins for which the bound is at most the paper's maximum; ten are its 170 on average."""
    z = normal_quantile(DELTA)
    assert kld_bound(TRACKING_BINS, 0.05, z) <= 500 < kld_bound(TRACKING_BINS + 1, 0.05, z)
    assert kld_bound(10, 0.05, z) == 170


def test_what_reaches_a_place_is_computed_once_for_all_receivers(hangar: Building) -> None:
    """The bytes of a field of one's own; other access points are others."""
    known_dbm: dict[bytes, FloatArray] = {}
    xy_m = np.array([[3.0, 4.0], [30.0, 20.0]])
    place = np.zeros(2), np.zeros(2, dtype=np.int64), xy_m, np.zeros(2)
    for area_m2, num_asked in ((100.0, 1), (200.0, 2)):
        for detection_dbm in (-88.0, -76.0):
            params = PropagationParams(area_per_access_point_m2=area_m2, detection_dbm=detection_dbm)
            plain = make_radio_field(np.random.default_rng(1), hangar, params=params)
            shared = SharedField.of(plain, known_dbm)
            for seed in (2, 3):
                scans = [receive(one, np.random.default_rng(seed), *place) for one in (plain, shared)]
                assert scans[0].tobytes() == scans[1].tobytes()
        assert len(known_dbm) == num_asked
