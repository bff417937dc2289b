from __future__ import annotations

import numpy as np
import pytest

from pdrbench_lab.realism import gait
from pdrbench_sim.foot.known_walk import walk


def coloured(rng, count, beta):
    """Noise whose power falls as 1 / f^beta."""
    spectrum = np.fft.rfft(rng.standard_normal(count))
    spectrum[1:] *= np.fft.rfftfreq(count)[1:] ** (-beta / 2)
    spectrum[0] = 0.0
    return np.fft.irfft(spectrum, count)


@pytest.mark.parametrize(("beta", "exponent"), [(0.0, 0.5), (0.66, 0.83), (1.0, 1.0), (2.0, 1.5)])
def test_the_exponent_of_known_noise_is_known(beta, exponent):
    # alpha = (beta + 1) / 2. A series of 4096 gives it to about 0.04, the mean of ten to 0.013; short boxes add 0.03.
    rng = np.random.default_rng(4)
    found = [gait.dfa_exponent(coloured(rng, 4096, beta)) for _ in range(10)]
    assert np.mean(found) == pytest.approx(exponent, abs=0.05)


def test_the_exponent_does_not_depend_on_scale_or_mean():
    series = coloured(np.random.default_rng(5), 512, 0.66)
    assert gait.dfa_exponent(1.1 + 0.03 * series) == pytest.approx(gait.dfa_exponent(series), abs=1e-9)


@pytest.mark.parametrize("count", [0, 1, 30])
def test_a_short_series_has_no_exponent(count):
    assert np.isnan(gait.dfa_exponent(np.arange(float(count))))


def test_equal_strides_do_not_vary():
    motion = walk(30, length_m=1.4)
    time_cv, length_cv = gait.variation(motion.t_s, motion.accel, motion.gyro)
    # Sampled at 200 Hz, strides of 1.1 s differ by a sample: 5 ms are 0.4 %.
    assert time_cv < 0.006
    assert length_cv < 0.01


def test_a_walk_of_few_strides_has_no_statistics():
    motion = walk(5, length_m=1.4)
    assert np.isnan(gait.variation(motion.t_s, motion.accel, motion.gyro)).all()


def test_stride_times_of_long_walks_remember_as_published():
    exponents = np.array([gait.dfa_exponent(gait._stride_times(1, number)) for number in range(8)])
    assert 0.73 < np.median(exponents) < 0.93


def test_shuffling_steps_makes_the_row_fail():
    rule = gait.GAIT.statistics[0].rule
    exponents = gait.GAIT.controls["shuffled steps"].synthetic(1, 8)["dfa"]
    assert np.median(exponents) == pytest.approx(0.5, abs=0.08)
    assert not rule.low <= np.median(exponents) <= rule.high


def test_the_same_seed_gives_the_same_values():
    one, same, other = (gait.synthetic(seed, 2) for seed in (3, 3, 4))
    assert {name for name in one if ":" not in name} == {statistic.name for statistic in gait.GAIT.statistics}
    for name in one:
        assert one[name].tobytes() == same[name].tobytes()
        assert ":" in name or not np.array_equal(one[name], other[name])
    more = gait.synthetic(3, 3)
    for name in one:
        assert one[name].tobytes() == more[name][:2].tobytes()


def test_recorded_walks_vary_by_some_percent(data_root):
    for part in ("fit", "judge"):
        values = gait.real(part)
        time_cv = values["stride_time_cv"][np.isfinite(values["stride_time_cv"])]
        assert len(time_cv) >= 3
        assert 1.0 < np.median(time_cv) < 6.0
