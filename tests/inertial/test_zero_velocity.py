"""Zero-velocity detectors: closed forms, invariances, causality."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from pdrbench.inertial import DETECTORS, Detector, Rest, RestDetector, detect
from pdrbench.inertial.zero_velocity import GRAVITY_MPS2, soft_sigma, statistic, window_rows
from pdrbench_sim.foot.known_walk import walk

SCALES = (0.01, 0.002, GRAVITY_MPS2)


def resting(count: int = 40) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    t_s = np.arange(count) / 200
    return t_s, np.tile([0.0, 0.0, GRAVITY_MPS2], (count, 1)), np.zeros((count, 3))


def test_closed_forms() -> None:
    _, accel, gyro = resting()
    rate = np.array([0.03, -0.04, 0.12])  # of size 0.13
    for kind in ("are", "shoe"):
        value = statistic(kind, accel, np.tile(rate, (40, 1)), 5, *SCALES)
        np.testing.assert_allclose(value, (0.13 / 0.002) ** 2, rtol=1e-12)
    assert np.abs(statistic("mv", accel, np.tile(rate, (40, 1)), 5, *SCALES)).max() < 1e-20

    heavier = accel * 1.01  # 1 % of gravity too much: detected by statistics with gravity, not by the variance
    excess = (0.01 * GRAVITY_MPS2 / 0.01) ** 2
    for kind, expected in (("mag", excess), ("shoe", excess), ("mv", 0.0), ("are", 0.0)):
        np.testing.assert_allclose(statistic(kind, heavier, gyro, 5, *SCALES), expected, rtol=1e-9, atol=1e-20)

    shaken = accel.copy()
    shaken[:, 0] += 0.5 * (-1.0) ** np.arange(40)  # over four samples of +-d the variance is d^2
    np.testing.assert_allclose(statistic("mv", shaken, gyro, 4, *SCALES)[3:], (0.5 / 0.01) ** 2, rtol=1e-12)


@pytest.mark.parametrize("kind", DETECTORS)
def test_axes_do_not_matter(kind: str, measure: Any, rng: Any) -> None:
    t_s, accel, gyro = measure(walk(2, turn_rad=0.5), rng)
    turn = Rotation.random(rng=rng)
    plain = detect(t_s, accel, gyro, DETECTORS[kind])
    turned = detect(t_s, turn.apply(accel), turn.apply(gyro), DETECTORS[kind])
    np.testing.assert_allclose(turned.statistic, plain.statistic, rtol=1e-9, atol=1e-9)
    np.testing.assert_array_equal(turned.is_rest, plain.is_rest)


@pytest.mark.parametrize("kind", DETECTORS)
def test_pieces_give_the_same_bytes(kind: str, measure: Any, rng: Any) -> None:
    measured = measure(walk(3), rng)
    whole = RestDetector(DETECTORS[kind], 200.0).update(*measured)
    stream = RestDetector(DETECTORS[kind], 200.0)
    cuts = sorted([0, 1, 2, 3, 9, *rng.integers(0, len(measured.t_s), 30).tolist(), len(measured.t_s)])
    parts = [stream.update(*(v[a:b] for v in measured)) for a, b in pairwise(cuts)]
    for name in Rest._fields:
        together = np.concatenate([getattr(part, name) for part in parts])
        assert together.tobytes() == getattr(whole, name).tobytes()


@pytest.mark.parametrize("kind", DETECTORS)
def test_a_walking_foot_rests_where_it_does(kind: str, measure: Any, rng: Any) -> None:
    """All true rests except while the window fills and by chance; hardly any where the foot is fastest.

    Acceleration alone cannot distinguish the even part of a swing from a rest.
    """
    motion = walk(10, turn_rad=0.3)
    rest = detect(*measure(motion, rng), DETECTORS[kind])
    assert rest.is_rest[motion.is_rest].mean() > 0.75
    fast = np.linalg.norm(motion.velocity_mps, axis=1) > 1.5
    assert rest.is_rest[fast].mean() < 0.3
    if kind in ("shoe", "are"):
        assert not rest.is_rest[fast].any()
    if kind == "soft":  # it may report a rest, with a large sigma
        assert rest.sigma_mps[fast].min() > 1.0
        assert rest.sigma_mps[motion.is_rest].max() < rest.sigma_mps[fast].min()


def test_the_interval_has_to_last() -> None:
    """F6: within 0.6 m/s2 of g for 0.10 s; anything else begins anew."""
    t_s, accel, gyro = resting(100)
    accel[30] *= 1.07  # 0.69 m/s2 too much
    accel[60] *= 1.05  # 0.49: within
    is_rest = detect(t_s, accel, gyro, DETECTORS["interval"]).is_rest
    held = t_s - t_s[31] >= 0.10 - 1e-12
    expected = ((t_s >= 0.10 - 1e-12) & (t_s < t_s[30])) | held
    np.testing.assert_array_equal(is_rest, expected)


def test_only_a_foot_that_stands_still_has_an_angular_rate_of_zero() -> None:
    t_s, accel, gyro = resting(200)
    gyro[100] = [0.5, 0, 0]
    is_still = np.isfinite(detect(t_s, accel, gyro, DETECTORS["soft"]).rate_sigma_radps)
    still_s, window = DETECTORS["soft"].still_s, window_rows(DETECTORS["soft"].window_s, 200.0)
    assert not is_still[: round(still_s * 200)].any()
    assert is_still[round(still_s * 200) + 1 : 100].all()
    assert not is_still[100 : 100 + window + round(still_s * 200)].any()
    assert is_still[100 + window + round(still_s * 200) + 1 :].all()


def test_softness() -> None:
    soft = replace(DETECTORS["soft"], sigma_mps=0.03, lever_m=0.2, threshold=2e6)
    knee = np.full(1, 1e5)
    assert soft_sigma(np.zeros(1), np.array([0.2]), soft, knee)[0] == pytest.approx(0.05)  # 3, 4, 5
    assert soft_sigma(np.array([1e5]), np.array([0.2]), soft, knee)[0] == pytest.approx(0.10)  # halved at the knee
    assert np.isinf(soft_sigma(np.array([2e6]), np.zeros(1), soft, knee)[0])
    assert (np.diff(soft_sigma(np.geomspace(1.0, 1e6, 40), np.linspace(0, 3, 40), soft, knee)) > 0).all()


def test_settings_that_cannot_be() -> None:
    for wrong in ({"threshold": -1.0}, {"window_s": 0.0}, {"sigma_mps": np.nan}, {"lowest_knee": np.inf}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            replace(DETECTORS["soft"], **wrong)
    with pytest.raises(ValueError, match="no statistic"):
        detect(*resting(), Detector("shoo", 1.0))  # type: ignore[arg-type]


def test_a_stand_says_as_much_of_the_bias_as_it_is_long() -> None:
    """Information about a constant rate adds up to T^2 / sway^2, whatever the rate of the samples."""
    detector = replace(DETECTORS["soft"], sway_rad=0.003)
    for rate_hz in (60.0, 200.0):
        t_s = np.arange(0, 10, 1 / rate_hz)
        still = np.tile([0.0, 0.0, GRAVITY_MPS2], (len(t_s), 1))
        sigma = detect(t_s, still, np.zeros((len(t_s), 3)), detector).rate_sigma_radps
        assert np.isinf(sigma[t_s < detector.still_s - 0.02]).all()
        information = float(np.sum(1 / sigma**2))
        assert information == pytest.approx((10 / 0.003) ** 2, rel=0.02)
